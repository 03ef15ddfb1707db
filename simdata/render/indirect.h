// Indirect light of a room: gathered from the walls once, then applied to any pattern.
//
// Every receiving point x looks at stratified points y of the other walls; each one that it sees adds, per projector
// block that lights y, the irradiance at y times albedo (first bounce), and the share by which y's own indirect light
// counts (all further bounces, whose light is solved for on a coarser grid of receivers):
//
//   I(x) = sum_y rho(y) cos_x cos_y dA_y / (pi r^2) (E_direct(y) + A(y) + I(y)),    A = irradiance from the surround
//
// Strata are split until they are small against their distance, and every one is sampled at a random point and its
// mirror image, so that the sum is unbiased and its error of second order in the size of the strata.
#pragma once

#include <Eigen/Dense>
#include <memory>
#include <span>
#include <vector>

#include "calib/base/progress.h"
#include "calib/base/random.h"
#include "simdata/render/emitter.h"
#include "simdata/render/receivers.h"
#include "simdata/render/scene.h"
#include "simdata/room/paint.h"

namespace countershade::simdata {

using Rgb = Eigen::Matrix<float, Eigen::Dynamic, 4, Eigen::RowMajor>;

class IndirectLight {
 public:
  IndirectLight(std::shared_ptr<const Scene> scene, const std::vector<Emitter>& emitters, const Paint& paint,
                const Simulation& simulation, Progress& progress);

  const ReceiverGrid& grid() const { return fine_.grid; }
  // Share of the surround that a receiver of the grid sees, cosine-weighted.
  const Eigen::VectorXf& escape(int surface) const { return fine_.walls[surface].escape; }
  // Indirect irradiance at the receivers of the grid, per surface (receivers, 4).
  std::vector<Rgb> solve(std::span<const PictureLight> light) const;

 private:
  using Weights = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  // Rows: receivers of one wall. [t]: light from wall t: per (projector, block) pair, per coarse receiver.
  struct Wall {
    std::vector<Weights> from_blocks, from_receivers;
    Eigen::VectorXf escape;
  };
  struct Receivers {
    ReceiverGrid grid;
    std::vector<Wall> walls;
  };
  void list_pairs(const std::vector<Emitter>& emitters);
  void gather(Receivers& receivers, const char* stage, Progress& progress) const;
  void gather_at(Receivers& receivers, int surface, int index) const;
  struct Cell {
    int surface;
    double u, v, du, dv;  // centre and size
  };
  void gather_cell(Wall& wall, const ChartPoint& at, int row, const Cell& cell, Random& random, int depth) const;
  void deposit(Wall& wall, int row, const ChartPoint& y, double weight) const;
  std::vector<Rgb> apply(const Receivers& receivers, const std::vector<Rgb>& blocks,
                         const std::vector<Rgb>& bounced) const;

  std::shared_ptr<const Scene> scene_;
  const std::vector<Emitter>& emitters_;
  const Paint& paint_;
  int strata_ = 64;
  std::uint64_t seed_ = 1;
  float ambient_ = 0;
  std::vector<std::vector<std::vector<int>>> column_;    // [surface][projector][block], -1 = lights it not
  std::vector<std::vector<std::pair<int, int>>> pairs_;  // [surface][column] = projector, block
  Receivers fine_, coarse_;
};

}  // namespace countershade::simdata
