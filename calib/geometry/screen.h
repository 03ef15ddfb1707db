// The screen: surfaces with charts, and the creases where they meet.
#pragma once

#include <Eigen/Dense>
#include <array>
#include <memory>
#include <optional>
#include <vector>

#include "calib/geometry/pose.h"

namespace countershade {

// A point of a surface's chart. (u, v) in [0, 1]^2.
struct ChartPoint {
  int surface = -1;  // -1 = no surface
  double u = 0, v = 0;
};

struct Hit {
  double t = 0;  // x = origin + t direction
  double u = 0, v = 0;
};

// One smooth piece of the screen. The normal points to the lit side.
class Surface {
 public:
  virtual ~Surface() = default;
  virtual Eigen::Vector3d point(double u, double v) const = 0;
  virtual Eigen::Vector3d normal(double u, double v) const = 0;
  // Area of surface per unit of chart, dA / (du dv).
  virtual double area_element(double u, double v) const = 0;
  // Nearest intersection with t > 0 that meets the lit side inside the chart; `margin` widens the chart by that much.
  virtual std::optional<Hit> intersect(const Ray& ray, double margin = 0) const = 0;
};

// x(u, v) = origin + u along_u + v along_v; normal = along_u x along_v normalised. The axes need not be orthogonal.
class PlaneSurface final : public Surface {
 public:
  PlaneSurface(const Eigen::Vector3d& origin, const Eigen::Vector3d& along_u, const Eigen::Vector3d& along_v);
  Eigen::Vector3d point(double u, double v) const override { return origin_ + u * along_u_ + v * along_v_; }
  Eigen::Vector3d normal(double, double) const override { return normal_; }
  double area_element(double, double) const override { return area_; }
  std::optional<Hit> intersect(const Ray& ray, double margin = 0) const override;
  // (u, v) of the foot of the perpendicular from x.
  Eigen::Vector2d chart_of(const Eigen::Vector3d& x) const;
  const Eigen::Vector3d& origin() const { return origin_; }
  const Eigen::Vector3d& along_u() const { return along_u_; }
  const Eigen::Vector3d& along_v() const { return along_v_; }

 private:
  Eigen::Vector3d origin_, along_u_, along_v_, normal_;
  double area_ = 0;
  Eigen::Matrix<double, 2, 3> chart_from_world_;
};

// An edge that two charts share: the line u = u_a of one and u = u_b of the other (0 or 1). Both run along it with the
// same parameter v, in the same direction and with the same sampling; parts of a chart beyond the real wall are masked.
struct Crease {
  int surface_a = -1, surface_b = -1;
  double u_a = 0, u_b = 0;
  double angle = 0;  // dihedral angle between the lit sides, rad; pi = flat
};

struct Screen {
  std::vector<std::shared_ptr<const Surface>> surfaces;
  std::vector<Crease> creases;

  int size() const { return static_cast<int>(surfaces.size()); }
  Eigen::Vector3d point(const ChartPoint& c) const { return surfaces[c.surface]->point(c.u, c.v); }
  Eigen::Vector3d normal(const ChartPoint& c) const { return surfaces[c.surface]->normal(c.u, c.v); }
  // Nearest surface along the ray; surface = -1 where there is none.
  ChartPoint intersect(const Ray& ray) const;
};

// Uniform patches: surface s has nu[s] x nv[s] rectangles of its chart, index = offset(s) + iv * nu[s] + iu.
class Patches {
 public:
  Patches() = default;
  // grid[s] = {nu, nv} >= 1 each (a Bug otherwise).
  explicit Patches(std::vector<std::pair<int, int>> grid);
  int size() const { return total_; }
  int surfaces() const { return static_cast<int>(grid_.size()); }
  int nu(int surface) const { return grid_[surface].first; }
  int nv(int surface) const { return grid_[surface].second; }
  int count(int surface) const { return nu(surface) * nv(surface); }
  int offset(int surface) const { return offset_[surface]; }
  int surface_of(int patch) const;
  int index(int surface, int iu, int iv) const { return offset_[surface] + iv * nu(surface) + iu; }
  // Patch under a chart point; (u, v) outside [0, 1] is clamped.
  int index(const ChartPoint& c) const;
  ChartPoint centre(int patch) const;
  const std::vector<std::pair<int, int>>& grid() const { return grid_; }

 private:
  std::vector<std::pair<int, int>> grid_;
  std::vector<int> offset_;
  int total_ = 0;
};

// Area [screen unit^2] of each patch.
Eigen::VectorXd patch_areas(const Screen& screen, const Patches& patches);

// Corners of a patch of a plane, anticlockwise seen from the lit side: (u0,v0), (u1,v0), (u1,v1), (u0,v1).
std::array<Eigen::Vector3d, 4> patch_corners(const Screen& screen, const Patches& patches, int patch);

}  // namespace countershade
