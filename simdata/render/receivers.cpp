#include "simdata/render/receivers.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace countershade::simdata {

double Spacing::from_even(double t) const {
  if (first_ && last_) return (1 - std::cos(std::numbers::pi * t)) / 2;
  if (first_) return t * t;
  if (last_) return 1 - (1 - t) * (1 - t);
  return t;
}

double Spacing::to_even(double place) const {
  const double p = std::clamp(place, 0.0, 1.0);
  if (first_ && last_) return std::acos(1 - 2 * p) / std::numbers::pi;
  if (first_) return std::sqrt(p);
  if (last_) return 1 - std::sqrt(1 - p);
  return p;
}

namespace {

// Whether another surface comes near a side of the chart: at least at a quarter of its points.
bool meets(const Scene& scene, int surface, bool along_v, double place) {
  constexpr int kPoints = 12;
  const double near = 0.02 * scene.extent();
  int met = 0;
  for (int i = 0; i < kPoints; ++i) {
    const double w = (i + 0.5) / kPoints;
    const Eigen::Vector3d x = scene.point(surface, along_v ? place : w, along_v ? w : place).x;
    bool close = false;
    for (int s = 0; s < scene.size() && !close; ++s) close = s != surface && scene.distance(s, x) < near;
    met += close;
  }
  return 4 * met >= kPoints;
}

double length(const Scene& scene, int surface, bool along_u) {
  double sum = 0;
  Eigen::Vector3d former = scene.point(surface, along_u ? 0 : 0.5, along_u ? 0.5 : 0).x;
  for (int i = 1; i <= 16; ++i) {
    const double w = i / 16.0;
    const Eigen::Vector3d x = scene.point(surface, along_u ? w : 0.5, along_u ? 0.5 : w).x;
    sum += (x - former).norm();
    former = x;
  }
  return sum;
}

}  // namespace

Receivers::Receivers(const Scene& scene, int surface, int count) {
  mesh_ = dynamic_cast<const MeshShape*>(&scene.shape(surface));
  if (mesh_) {
    stand_on_mesh(*mesh_, surface);
    return;
  }
  const double aspect = std::clamp(length(scene, surface, true) / length(scene, surface, false), 0.5, 2.0);
  const int nu = std::max(4, static_cast<int>(std::lround(std::sqrt(count * aspect))));
  const int nv = std::max(4, static_cast<int>(std::lround(std::sqrt(count / aspect))));
  closed_ = scene.shape(surface).closed();
  u_ = Spacing(nu, !closed_ && meets(scene, surface, true, 0), !closed_ && meets(scene, surface, true, 1));
  v_ = Spacing(nv, meets(scene, surface, false, 0), meets(scene, surface, false, 1));
  for (int j = 0; j < nv; ++j)
    for (int i = 0; i < nu; ++i) points_.push_back(scene.point(surface, u_.place(i), v_.place(j)));
}

// At the corners, a little inside the faces about them, so that what they touch is beside them.
void Receivers::stand_on_mesh(const MeshShape& mesh, int surface) {
  const auto& [corners, normals, faces] = mesh.triangles();
  std::vector<SurfacePoint> at(corners.size());
  for (std::size_t f = 0; f < faces.size(); ++f)
    for (int k = 0; k < 3; ++k) {
      constexpr double kInside = 0.04;
      const double b1 = k == 1 ? 1 - 2 * kInside : kInside, b2 = k == 2 ? 1 - 2 * kInside : kInside;
      at[faces[f][k]] = mesh.at(static_cast<int>(f), b1, b2);
      at[faces[f][k]].surface = surface;
    }
  points_ = std::move(at);
}

Receivers::Stencil Receivers::stencil(const SurfacePoint& at) const {
  const auto index = [](int i) { return static_cast<std::uint16_t>(i); };
  if (mesh_) {
    const Eigen::Vector3i& f = mesh_->triangles().faces[at.face];
    const auto b1 = static_cast<float>(at.b1), b2 = static_cast<float>(at.b2);
    return {{index(f[0]), index(f[1]), index(f[2]), index(f[0])}, {1 - b1 - b2, b1, b2, 0}};
  }
  const double x = u_.number(at.u), y = v_.number(at.v);
  const int nu = u_.count(), floor_x = static_cast<int>(std::floor(x));
  const int ix = closed_ ? floor_x : std::clamp(floor_x, 0, nu - 2);
  const int iy = std::clamp(static_cast<int>(std::floor(y)), 0, v_.count() - 2);
  const int left = (ix + nu) % nu, right = (ix + 1) % nu;
  const float fx = static_cast<float>(x - ix), fy = static_cast<float>(y - iy);
  const int below = iy * nu, above = below + nu;
  return {{index(below + left), index(below + right), index(above + left), index(above + right)},
          {(1 - fx) * (1 - fy), fx * (1 - fy), (1 - fx) * fy, fx * fy}};
}

}  // namespace countershade::simdata
