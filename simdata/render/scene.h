// The surfaces of a room as light meets them: nearest hit and visibility (Embree inside).
#pragma once

#include <memory>
#include <vector>

#include "simdata/room/shape.h"

namespace countershade::simdata {

// What a ray meets first.
struct SceneHit {
  SurfacePoint at;     // surface = -1: the ray escapes
  double t = 0;        // x = origin + t direction
  bool front = false;  // the lit side; the back of a surface is black
};

class Scene {
 public:
  // transmission: per surface, the share of light from behind that passes (rear projection); none without it.
  static Result<std::shared_ptr<const Scene>> make(std::vector<std::shared_ptr<const Shape>> shapes,
                                                   std::vector<double> transmission = {});
  ~Scene();

  int size() const { return static_cast<int>(shapes_.size()); }
  const Shape& shape(int surface) const { return *shapes_[surface]; }
  double transmission(int surface) const { return transmission_.empty() ? 0 : transmission_[surface]; }
  // Diagonal of the box around all surfaces [m].
  double extent() const { return extent_; }
  // A point of a surface that has a chart.
  SurfacePoint point(int surface, double u, double v) const;
  // From anywhere, exact but for meshes of single precision.
  SceneHit look(const Ray& ray) const;
  // From the lit side of a surface.
  SceneHit hit(const SurfacePoint& from, const Eigen::Vector3d& direction) const;
  // Whether nothing stands between a point of a surface and a point in the room, or on surface `other`. `behind`: the
  // line leaves the surface on its back.
  bool visible(const SurfacePoint& from, const Eigen::Vector3d& to, int other = -1, bool behind = false) const;
  // Distance of a point from the nearest sample of a surface.
  double distance(int surface, const Eigen::Vector3d& x) const;

 private:
  struct Embree;
  Scene(std::vector<std::shared_ptr<const Shape>> shapes, std::vector<double> transmission,
        std::unique_ptr<Embree> embree);
  SurfacePoint located(int surface, const ShapeHit& hit) const;
  std::vector<std::shared_ptr<const Shape>> shapes_;
  std::vector<double> transmission_;
  std::unique_ptr<Embree> embree_;
  std::vector<std::vector<Eigen::Vector3d>> samples_;  // points of each surface, for distance()
  double extent_ = 1;
  bool has_mesh_ = false;
};

// Direction of the cosine-weighted hemisphere about `normal` for (a, b) in the unit square, tangent along `tangent`.
// The map of square to disc keeps neighbours together (Shirley & Chiu 1997), so that strata stay compact.
Eigen::Vector3d cosine_direction(const Eigen::Vector3d& normal, const Eigen::Vector3d& tangent, double a, double b);

}  // namespace countershade::simdata
