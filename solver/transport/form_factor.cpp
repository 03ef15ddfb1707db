#include "solver/transport/form_factor.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "solver/transport/patch_flow.h"
#include "solver/transport/polygon.h"

namespace countershade::solver {

namespace {

using V = Eigen::Vector3d;
constexpr double kPi = std::numbers::pi;

// sum_edges angle_e (n . gamma_e) / (2 pi) of a polygon that is seen from its lit side, all of it above the horizon.
double lambert_sum(const V& x, const V& n, Polygon b) {
  double sum = 0;
  V from = b.back() - x;
  for (const V& corner : b) {
    const V to = corner - x, cross = from.cross(to);
    const double sine = cross.norm();
    // Seen from their own line edges add nothing.
    if (sine > 1e-15 * from.norm() * to.norm()) sum -= std::atan2(sine, from.dot(to)) * n.dot(cross) / sine;
    from = to;
  }
  return std::max(0.0, sum / (2 * kPi));
}

}  // namespace

double form_factor(Polygon a, Polygon b) {
  const double area = 0.5 * area_vector(a).norm();
  return area > 0 ? patch_flow(a, b, 1e-11) / area : 0;
}

double point_form_factor(const V& x, const V& n, Polygon b) {
  const V nb = area_vector(b);
  double lowest = HUGE_VAL, highest = -HUGE_VAL, size = 0;
  for (const V& p : b) {
    const double h = (p - x).dot(n);
    lowest = std::min(lowest, h), highest = std::max(highest, h);
    size = std::max(size, (p - x).squaredNorm());
  }
  size = std::sqrt(size);
  const double slack = 1e-13 * size;
  // Behind b or in its plane; b below the horizon or on it.
  if (!(highest > slack) || !((x - b[0]).dot(nb) > slack * nb.norm())) return 0;
  if (lowest >= -slack) return lambert_sum(x, n, b);
  const Corners above = clip(b, x, n, slack);
  return above.size() < 3 ? 0 : lambert_sum(x, n, above);
}

double centre_form_factor(Polygon a, Polygon b) {
  const V na = area_vector(a).normalized(), nb = area_vector(b), r = centre(b) - centre(a);
  const double r2 = r.squaredNorm();
  if (!(r2 > 0)) return 0;
  return std::max(0.0, r.dot(na)) * std::max(0.0, -r.dot(nb) / 2) / (kPi * r2 * r2);
}

double opposite_rectangles(double w, double h, double d) {
  const double X = w / d, Y = h / d, x2 = 1 + X * X, y2 = 1 + Y * Y;
  const double log_part = 0.5 * std::log(x2 * y2 / (1 + X * X + Y * Y));
  const double outer =
      X * std::sqrt(y2) * std::atan(X / std::sqrt(y2)) + Y * std::sqrt(x2) * std::atan(Y / std::sqrt(x2));
  return 2 / (kPi * X * Y) * (log_part + outer - X * std::atan(X) - Y * std::atan(Y));
}

double adjacent_rectangles(double l, double a, double b) {
  const double W = a / l, H = b / l, w2 = W * W, h2 = H * H, s = w2 + h2;
  const double logs = std::log((1 + w2) * (1 + h2) / (1 + s)) + w2 * std::log(w2 * (1 + s) / ((1 + w2) * s)) +
                      h2 * std::log(h2 * (1 + s) / ((1 + h2) * s));
  const double angles = W * std::atan(1 / W) + H * std::atan(1 / H) - std::sqrt(s) * std::atan(1 / std::sqrt(s));
  return (angles + logs / 4) / (kPi * W);
}

}  // namespace countershade::solver
