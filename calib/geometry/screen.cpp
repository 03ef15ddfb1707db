#include "calib/geometry/screen.h"

#include <algorithm>
#include <cmath>

#include "calib/base/check.h"

namespace countershade {

PlaneSurface::PlaneSurface(const Eigen::Vector3d& origin, const Eigen::Vector3d& along_u,
                           const Eigen::Vector3d& along_v)
    : origin_(origin), along_u_(along_u), along_v_(along_v) {
  const Eigen::Vector3d cross = along_u.cross(along_v);
  area_ = cross.norm();
  CS_CHECK(area_ > 0 && std::isfinite(area_), "a plane's axes must span an area");
  normal_ = cross / area_;
  Eigen::Matrix<double, 3, 2> A;
  A << along_u, along_v;
  chart_from_world_ = (A.transpose() * A).inverse() * A.transpose();
}

std::optional<Hit> PlaneSurface::intersect(const Ray& ray, double margin) const {
  const double slope = ray.direction.dot(normal_);
  if (!(slope < 0)) return std::nullopt;  // parallel, or from behind
  const double t = (origin_ - ray.origin).dot(normal_) / slope;
  if (!(t > 0)) return std::nullopt;
  const Eigen::Vector2d c = chart_of(ray.origin + t * ray.direction);
  const double low = -margin, high = 1 + margin;
  if (c.x() < low || c.x() > high || c.y() < low || c.y() > high) return std::nullopt;
  return Hit{t, c.x(), c.y()};
}

Eigen::Vector2d PlaneSurface::chart_of(const Eigen::Vector3d& x) const {
  return chart_from_world_ * (x - origin_);
}

ChartPoint Screen::intersect(const Ray& ray) const {
  ChartPoint nearest;
  double t = HUGE_VAL;
  for (int s = 0; s < size(); ++s) {
    const std::optional<Hit> hit = surfaces[s]->intersect(ray);
    if (hit && hit->t < t) t = hit->t, nearest = {s, hit->u, hit->v};
  }
  return nearest;
}

Patches::Patches(std::vector<std::pair<int, int>> grid) : grid_(std::move(grid)) {
  for (const auto& [nu, nv] : grid_) {
    CS_CHECK(nu >= 1 && nv >= 1, "a surface needs at least one patch along each side");
    offset_.push_back(total_);
    total_ += nu * nv;
  }
}

int Patches::surface_of(int patch) const {
  CS_CHECK(patch >= 0 && patch < total_, "no such patch");
  return static_cast<int>(std::upper_bound(offset_.begin(), offset_.end(), patch) - offset_.begin()) - 1;
}

int Patches::index(const ChartPoint& c) const {
  CS_CHECK(c.surface >= 0 && c.surface < surfaces(), "a chart point on no surface");
  CS_CHECK(std::isfinite(c.u) && std::isfinite(c.v), "a chart point that is not finite");
  const auto [n_u, n_v] = grid_[c.surface];
  const int iu = std::clamp(static_cast<int>(std::clamp(c.u, 0.0, 1.0) * n_u), 0, n_u - 1);
  const int iv = std::clamp(static_cast<int>(std::clamp(c.v, 0.0, 1.0) * n_v), 0, n_v - 1);
  return index(c.surface, iu, iv);
}

ChartPoint Patches::centre(int patch) const {
  const int s = surface_of(patch), local = patch - offset_[s];
  return {s, (local % nu(s) + 0.5) / nu(s), (local / nu(s) + 0.5) / nv(s)};
}

Eigen::VectorXd patch_areas(const Screen& screen, const Patches& patches) {
  Eigen::VectorXd areas(patches.size());
  for (int i = 0; i < patches.size(); ++i) {
    const ChartPoint c = patches.centre(i);
    areas[i] = screen.surfaces[c.surface]->area_element(c.u, c.v) / patches.count(c.surface);
  }
  return areas;
}

std::array<Eigen::Vector3d, 4> patch_corners(const Screen& screen, const Patches& patches, int patch) {
  const ChartPoint c = patches.centre(patch);
  const Surface& surface = *screen.surfaces[c.surface];
  const double du = 0.5 / patches.nu(c.surface), dv = 0.5 / patches.nv(c.surface);
  return {surface.point(c.u - du, c.v - dv), surface.point(c.u + du, c.v - dv), surface.point(c.u + du, c.v + dv),
          surface.point(c.u - du, c.v + dv)};
}

}  // namespace countershade
