// Indirect light of a room: gathered from the walls once, then applied to any pattern.
//
// Every receiving point x looks at stratified points y of the surfaces; each one that it sees adds, per projector
// block that lights y, the irradiance at y times albedo (first bounce), and the share by which y's own indirect light
// counts (all further bounces, whose light is solved for on fewer receivers):
//
//   I(x) = sum_y rho(y) cos_x cos_y dA_y / (pi r^2) lobe(y) (E_direct(y) + A(y) + I(y)),  A = irradiance from the
//   surround
//
// Strata are split until they are small against their distance, and every one is sampled at a random point and its
// mirror image, so that the sum is unbiased and its error of second order in the size of the strata. The triangles of a
// mesh are such strata, sampled at three points; one of more triangles than strata is looked at along cosine-weighted
// rays instead. Direct light is reflected by the whole lobe of y; light that has bounced
// already as if it came evenly from everywhere. What a glossy x mirrors towards a
// camera is gathered per camera, in the same pass.
#pragma once

#include <Eigen/Dense>
#include <memory>
#include <span>
#include <string>
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
  // viewers: where the cameras stand; they count for glossy surfaces only.
  IndirectLight(std::shared_ptr<const Scene> scene, const std::vector<Emitter>& emitters, const Paint& paint,
                const Simulation& simulation, std::vector<Eigen::Vector3d> viewers, Progress& progress);

  const Receivers& receivers(int surface) const { return fine_.at[surface]; }
  // Share of the surround that a receiver sees, cosine-weighted.
  const Eigen::VectorXf& escape(int surface) const { return fine_.walls[surface].escape; }
  // At the receivers, (receivers, 4) each: per surface the indirect irradiance; then, per surface, what its gloss
  // mirrors towards the viewer, in the same units (empty where it has none).
  std::vector<Rgb> solve(std::span<const PictureLight> light, int viewer) const;

  // How much was computed, in words.
  std::string effort() const;

 private:
  using Weights = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  // Rows: receivers of one surface. [t]: light from surface t: per (projector, block) pair, per coarse receiver.
  struct Wall {
    std::vector<Weights> from_blocks, from_receivers;
    Eigen::VectorXf escape;
  };
  struct Standing {
    std::vector<Receivers> at;               // per surface
    std::vector<Wall> walls;                 // per surface
    std::vector<std::vector<Wall>> mirrors;  // [viewer][surface]; of glossy surfaces only
  };
  void list_pairs();
  Wall empty_wall(int surface, int rows) const;
  void gather(Standing& standing, int viewers, const char* stage, Progress& progress);
  void gather_at(Standing& standing, int surface, int index) const;
  void gather_rays(Standing& standing, int surface, int index, Random& random) const;
  struct Triangle {
    int surface, face;
    std::array<Eigen::Vector2d, 3> corners;  // (b1, b2) of the face
  };
  void gather_triangle(Standing& standing, const SurfacePoint& at, int row, const Triangle& part, Random& random,
                       int depth) const;
  // The light of y, which stands for `area`; nothing where it is not seen.
  void see(Standing& standing, const SurfacePoint& at, int row, const SurfacePoint& y, double area) const;
  bool by_rays(int surface) const;
  struct Cell {
    int surface;
    double u, v, du, dv;  // centre and size of a part of the chart
    Eigen::Vector3d centre;
    double diagonal;  // m
  };
  Cell cell_at(int surface, double u, double v, double du, double dv) const;
  void gather_cell(Standing& standing, const SurfacePoint& at, int row, const Cell& cell, Random& random,
                   int depth) const;
  void deposit(Standing& standing, const SurfacePoint& at, int row, const SurfacePoint& y, double weight) const;
  Rgb applied(const std::vector<Weights>& weights, int rows, const std::vector<Rgb>& sent) const;

  std::shared_ptr<const Scene> scene_;
  const std::vector<Emitter>& emitters_;
  const Paint& paint_;
  std::vector<Eigen::Vector3d> viewers_;
  int strata_ = 64;                       // along each side of a chart
  std::vector<std::vector<Cell>> cells_;  // per surface that has a chart
  std::uint64_t seed_ = 1;
  float ambient_ = 0;
  bool any_by_rays_ = false;
  std::int64_t entries_ = 0;                           // stored numbers
  std::vector<std::vector<std::vector<int>>> column_;  // [surface][projector][block], -1 = lights it not
  std::vector<std::vector<std::pair<int, int>>>
      pairs_;  // [surface][column] = projector, block; projector -1 = daylight
  Standing fine_, coarse_;
};

}  // namespace countershade::simdata
