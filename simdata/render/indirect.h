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
// rays instead.
//
// lobe(y) depends on where light comes from where y is glossy. For the direct light of a projector that is known. What
// y's gloss mirrors of the light of other surfaces and of the surround is followed backwards, one path per point y
// towards the room, to where it left a surface diffusely or after its first reflection; this is gathered at a third,
// smaller set of receivers. What a glossy x mirrors towards a camera is gathered per camera, in the same pass.
#pragma once

#include <Eigen/Dense>
#include <array>
#include <functional>
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
  // viewers: where the cameras stand; they count for glossy surfaces only. emitters and paint must outlive it. Error:
  // kBadValue when its numbers would take more than 8 GB (a mesh with many corners, glossy ones above all).
  static Result<std::unique_ptr<IndirectLight>> make(std::shared_ptr<const Scene> scene,
                                                     const std::vector<Emitter>& emitters, const Paint& paint,
                                                     const Simulation& simulation, std::vector<Eigen::Vector3d> viewers,
                                                     Progress& progress);

  const Receivers& receivers(int surface) const { return fine_.at[surface]; }
  // Share of the surround that a receiver sees, cosine-weighted.
  const Eigen::VectorXf& escape(int surface) const { return fine_.walls[0][surface].escape; }
  // The same of a glossy surface, weighted by what it mirrors towards a viewer.
  const Eigen::VectorXf& mirrored_escape(int surface, int viewer) const {
    return fine_.walls[1 + viewer][surface].escape;
  }
  // At the receivers, (receivers, 4) each: per surface the indirect irradiance; then, per surface, what its gloss
  // mirrors towards the viewer, in the same units (empty where it has none).
  std::vector<Rgb> solve(std::span<const PictureLight> light, int viewer) const;

  // How much was computed, in words.
  std::string effort() const;

 private:
  using Weights = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  // Rows: receivers of one surface. [t]: light from surface t: per (projector, block) pair, per coarse receiver.
  // escape: of the surround.
  struct Wall {
    std::vector<Weights> from_blocks, from_receivers;
    Eigen::VectorXf escape;
  };
  // [0: what receivers get, 1 + k: what their gloss mirrors of it towards viewer k][surface]; of mirrors, glossy
  // surfaces only.
  using Walls = std::vector<std::vector<Wall>>;
  struct Standing {
    std::vector<Receivers> at;  // per surface
    Walls walls;
  };
  // What gloss sends to receivers: the albedos on the way are in the weights, hence three of them.
  struct Mirrored {
    std::vector<Receivers> at;
    std::array<Walls, 3> channels;
  };
  // Light that leaves a point of surface t in one direction.
  struct Leaving {
    std::vector<std::pair<int, double>> blocks;  // column, weight
    Receivers::Stencil stencil;
    double diffuse = 0;  // of the light at the stencil
    void add_to(Wall& wall, int row, int t, double share) const;
  };
  // Called with each point y that a receiver sees, its share of the hemisphere, and whether its front is seen.
  using Visit = std::function<void(const SurfacePoint& y, double share, bool front, Random& random)>;
  struct Cell {
    int surface;
    double u, v, du, dv;  // centre and size of a part of the chart
    Eigen::Vector3d centre;
    double diagonal;  // m
  };
  struct Triangle {
    int surface, face;
    std::array<Eigen::Vector2d, 3> corners;  // (b1, b2) of the face
  };
  IndirectLight(std::shared_ptr<const Scene> scene, const std::vector<Emitter>& emitters, const Paint& paint,
                const Simulation& simulation, std::vector<Eigen::Vector3d> viewers);
  void list_pairs();
  void stand(bool draft);
  bool sends(int from, int to, bool by_gloss) const;
  // Numbers of what empty_walls would make.
  double numbers(const std::vector<Receivers>& at, std::size_t viewers, bool by_gloss) const;
  Walls empty_walls(const std::vector<Receivers>& at, std::size_t viewers, bool by_gloss) const;
  Wall empty_wall(int surface, int rows, bool by_gloss) const;
  bool by_rays(int surface) const;
  Cell cell_at(int surface, double u, double v, double du, double dv) const;

  void gather(Standing& standing, const char* stage, Progress& progress) const;
  void gather_mirrored(Progress& progress);
  template <class Each>
  void for_each_receiver(const std::vector<Receivers>& at, const char* stage, Progress& progress, Each each) const;
  void look_around(const Receivers& receivers, int surface, int index, const Visit& visit) const;
  void look_along_rays(const SurfacePoint& at, Random& random, const Visit& visit) const;
  void look_at_cell(const SurfacePoint& at, const Cell& cell, Random& random, int depth, const Visit& visit) const;
  void look_at_triangle(const SurfacePoint& at, const Triangle& part, Random& random, int depth,
                        const Visit& visit) const;
  // y stands for `area`; nothing where it is not seen.
  void see(const SurfacePoint& at, const SurfacePoint& y, double area, Random& random, const Visit& visit) const;

  void leave(const SurfacePoint& y, const Eigen::Vector3d& out, Leaving& light) const;
  // 1, then what x mirrors of y's light towards each viewer.
  void mirror(const SurfacePoint& x, const SurfacePoint& y, std::size_t count, std::vector<double>& shares) const;
  // What y sends of projectors' direct light, and diffusely of what receivers know; where it is glossy, what it mirrors
  // of other surfaces and of the surround, one path.
  void deposit(Walls& walls, const SurfacePoint& x, int row, const SurfacePoint& y, double share,
               const std::vector<double>& mirrored, Leaving& scratch) const;
  void deposit_mirrored(const SurfacePoint& x, int row, const SurfacePoint& y, double share, Random& random);

  Rgb applied(const std::vector<Weights>& weights, int rows, const std::vector<Rgb>& sent) const;
  // At the receivers `to`: what gloss mirrors of the surround and of blocks, or of coarse receivers.
  enum class Source { kBlocks, kReceivers };
  Rgb mirrored(int towards, int surface, Source source, const std::vector<Rgb>& sent, const Receivers& to) const;

  std::shared_ptr<const Scene> scene_;
  const std::vector<Emitter>& emitters_;
  const Paint& paint_;
  std::vector<Eigen::Vector3d> viewers_;
  int strata_ = 64;                       // along each side of a chart
  std::vector<std::vector<Cell>> cells_;  // per surface that has a chart
  std::uint64_t seed_ = 1;
  float ambient_ = 0;
  bool any_by_rays_ = false;
  double entries_ = 0;                                 // stored numbers
  std::vector<std::vector<std::vector<int>>> column_;  // [surface][projector][block], -1 = lights it not
  std::vector<std::vector<std::pair<int, int>>>
      pairs_;  // [surface][column] = projector, block; projector -1 = daylight
  Standing fine_, coarse_;
  Mirrored mirrored_;  // empty where nothing is glossy
};

}  // namespace countershade::simdata
