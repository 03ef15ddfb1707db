#include <algorithm>
#include <cmath>
#include <numbers>

#include "solver/fit/geometry_parts.h"

namespace countershade::solver::parts {

namespace {

using Points = std::vector<Eigen::Vector3d>;

// Share of the values that lie outside the chart on each side: a few stray pixels must not widen it.
constexpr double kStrays = 0.0005;

struct Range {
  double low = 0, high = 0;
};

Range robust_range(const Points& points, const Eigen::Vector3d& axis) {
  std::vector<double> values;
  values.reserve(points.size());
  for (const auto& x : points) values.push_back(x.dot(axis));
  if (values.empty()) return {};
  const auto at = [&](double share) {
    const auto nth = values.begin() + static_cast<std::ptrdiff_t>(share * (values.size() - 1));
    std::nth_element(values.begin(), nth, values.end());
    return *nth;
  };
  return {at(kStrays), at(1 - kStrays)};
}

struct Edge {
  int a, b;
  Eigen::Vector3d direction;  // unit
  Eigen::Vector3d point;
};

// Unit normal to the lit side, where the camera (the origin) is.
Eigen::Vector3d lit_normal(const Eigen::Vector3d& w) {
  return -w.normalized();
}

// Signed distance of x from the plane, positive on the lit side.
double height(const Eigen::Vector3d& w, const Eigen::Vector3d& x) {
  return (1 - w.dot(x)) / w.norm();
}

// Planes meet where each one's points lie on the lit side of the other and reach its plane.
bool meets(const std::vector<Eigen::Vector3d>& planes, const std::vector<Points>& points, int a, int b, Edge& edge) {
  const Eigen::Vector3d na = lit_normal(planes[a]), nb = lit_normal(planes[b]);
  const Eigen::Vector3d cross = na.cross(nb);
  if (cross.norm() < 0.02) return false;  // within about one degree of parallel
  for (auto [on, other] : {std::pair{a, b}, std::pair{b, a}}) {
    std::vector<double> heights;
    for (const auto& x : points[on]) heights.push_back(height(planes[other], x));
    if (heights.empty()) return false;
    std::sort(heights.begin(), heights.end());
    const double low = heights[heights.size() / 100], high = heights[heights.size() * 99 / 100];
    if (low < -0.05 * high || low > 0.1 * high) return false;
  }
  Eigen::Matrix<double, 2, 3> A;
  A << planes[a].transpose(), planes[b].transpose();
  edge = {a, b, cross.normalized(), A.transpose() * (A * A.transpose()).inverse() * Eigen::Vector2d(1, 1)};
  return true;
}

// Chart axes of a plane: v along `along` (made to lie in the plane), u so that u x v is the lit normal.
struct Axes {
  Eigen::Vector3d u, v;
};
Axes axes_of(const Eigen::Vector3d& w, const Eigen::Vector3d& along) {
  const Eigen::Vector3d n = lit_normal(w);
  const Eigen::Vector3d v = (along - n * n.dot(along)).normalized();
  return {v.cross(n), v};
}

// A plane with its axes and the ranges of x . u and x . v that its chart covers.
struct Sheet {
  Axes axes;
  Range u, v;
};

std::shared_ptr<const PlaneSurface> surface_of(const Eigen::Vector3d& w, const Sheet& s) {
  const Eigen::Vector3d foot = w / w.squaredNorm();  // of the perpendicular from the camera
  const Eigen::Vector3d origin =
      foot + s.axes.u * (s.u.low - foot.dot(s.axes.u)) + s.axes.v * (s.v.low - foot.dot(s.axes.v));
  return std::make_shared<PlaneSurface>(origin, s.axes.u * (s.u.high - s.u.low), s.axes.v * (s.v.high - s.v.low));
}

}  // namespace

Charts make_charts(const std::vector<Eigen::Vector3d>& planes, const std::vector<Points>& points) {
  const int count = static_cast<int>(planes.size());
  std::vector<Edge> edges;
  for (int a = 0; a < count; ++a)
    for (int b = a + 1; b < count; ++b)
      if (Edge edge; meets(planes, points, a, b, edge)) edges.push_back(edge);

  // One direction for all charts that contain it: that of the first crease, downwards in the photo; else the photo's
  // own.
  Eigen::Vector3d main = edges.empty() ? Eigen::Vector3d::UnitY() : edges[0].direction;
  if (main.y() < 0) main = -main;
  std::vector<Sheet> sheets(count);
  std::vector<bool> shares_main(count);
  Range shared{HUGE_VAL, -HUGE_VAL};
  for (int p = 0; p < count; ++p) {
    shares_main[p] = !edges.empty() && std::abs(lit_normal(planes[p]).dot(main)) < 0.02;
    Eigen::Vector3d along = main;
    for (const Edge& e : edges)
      if (!shares_main[p] && (e.a == p || e.b == p)) along = e.direction;
    Sheet& sheet = sheets[p];
    sheet.axes = axes_of(planes[p], along);
    sheet.u = robust_range(points[p], sheet.axes.u);
    sheet.v = robust_range(points[p], sheet.axes.v);
    if (shares_main[p]) shared = {std::min(shared.low, sheet.v.low), std::max(shared.high, sheet.v.high)};
  }
  Charts charts;
  for (int p = 0; p < count; ++p)
    if (shares_main[p]) sheets[p].v = shared;
  for (const Edge& e : edges) {
    Crease crease{e.a, e.b, 0, 0, 0};
    bool common = true;
    for (int p : {e.a, e.b}) {
      Sheet& s = sheets[p];
      if (std::abs(s.axes.v.dot(e.direction)) < 0.999) {
        common = false;  // this crease runs across the chart; it ends the chart there but is no line u = const
        continue;
      }
      const double at = e.point.dot(s.axes.u);
      const bool low_side = std::abs(at - s.u.low) < std::abs(at - s.u.high);
      (low_side ? s.u.low : s.u.high) = at;
      (p == e.a ? crease.u_a : crease.u_b) = low_side ? 0 : 1;
    }
    crease.angle =
        std::numbers::pi - std::acos(std::clamp(lit_normal(planes[e.a]).dot(lit_normal(planes[e.b])), -1.0, 1.0));
    if (common) charts.screen.creases.push_back(crease);
  }
  for (int p = 0; p < count; ++p) {
    charts.planes.push_back(surface_of(planes[p], sheets[p]));
    charts.screen.surfaces.push_back(charts.planes.back());
  }
  return charts;
}

}  // namespace countershade::solver::parts
