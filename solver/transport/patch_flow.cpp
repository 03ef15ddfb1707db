#include "solver/transport/patch_flow.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "solver/transport/polygon.h"
#include "solver/transport/quadrature.h"

namespace countershade::solver {

namespace {

using V = Eigen::Vector3d;
constexpr double kPi = std::numbers::pi;

struct Segment {
  V start, along;
  V end() const { return start + along; }
};

// Where two segments come nearest: the parameter on the first, and the distance.
struct Approach {
  double s = 0, distance = 0;
};

// Ericson 2005 (Real-Time Collision Detection), 5.1.9.
Approach nearest_approach(const Segment& p, const Segment& q) {
  const V r = p.start - q.start;
  const double a = p.along.squaredNorm(), e = q.along.squaredNorm(), b = p.along.dot(q.along);
  const double f = q.along.dot(r), c = p.along.dot(r), denominator = a * e - b * b;
  double s = denominator > 1e-14 * a * e ? std::clamp((b * f - c * e) / denominator, 0.0, 1.0) : 0.0;
  const double t = std::clamp((b * s + f) / e, 0.0, 1.0);
  s = std::clamp((b * t - c) / a, 0.0, 1.0);
  return {s, (r + s * p.along - t * q.along).norm()};
}

// integral of ln sqrt(t^2 + h^2) dt
double log_primitive(double t, double h) {
  const double r2 = t * t + h * h;
  const double log_part = r2 > 0 ? 0.5 * t * std::log(r2) : 0;
  return log_part - t + (h > 0 ? h * std::atan(t / h) : 0);
}

// Mean over a segment of ln |x - y|, y on it, in closed form.
class MeanLog {
 public:
  explicit MeanLog(const Segment& q) : start_(q.start), length_(q.along.norm()) { direction_ = q.along / length_; }
  double operator()(const V& x) const {
    const double along = (x - start_).dot(direction_);
    const double h = (x - start_ - along * direction_).norm();
    return (log_primitive(length_ - along, h) - log_primitive(-along, h)) / length_;
  }

 private:
  V start_, direction_;
  double length_;
};

// Gauss-Legendre order whose error bound for an integrand that is analytic up to `gap` from a segment of half length
// `half` is the tolerance: rho^(-2 order), rho = the largest Bernstein ellipse free of singularities.
double gauss_order(double gap, double half, double tolerance) {
  const double ratio = gap / half, rho = ratio + std::sqrt(1 + ratio * ratio);
  return std::ceil(std::log(1 / tolerance) / (2 * std::log(rho))) + 1;  // infinite where they touch
}

// Mean over two segments of ln r. Far ones by Gauss-Legendre; near or touching ones by tanh-sinh between the places
// where the inner integral is not smooth: opposite the other segment's ends, and where the two pass each other.
double mean_log(const Segment& p, const Segment& q, double tolerance) {
  const Approach near = nearest_approach(p, q);
  const MeanLog inner(q);
  const double order = gauss_order(near.distance, 0.5 * p.along.norm(), tolerance);
  double sum = 0;
  if (order <= kMaxGaussOrder) {
    const GaussRule& rule = gauss_rule(static_cast<int>(order));
    for (int i = 0; i < rule.order; ++i) sum += rule.weight[i] * inner(p.start + rule.node[i] * p.along);
    return sum;
  }
  const double length2 = p.along.squaredNorm();
  std::array<double, 4> inside{(q.start - p.start).dot(p.along) / length2, (q.end() - p.start).dot(p.along) / length2,
                               near.s, 1};
  std::sort(inside.begin(), inside.end());
  double from = 0;
  for (double to : inside) {
    to = std::min(to, 1.0);
    if (to - from < 1e-9 && to < 1) continue;
    if (to > from) sum += tanh_sinh(from, to, [&](double s) { return inner(p.start + s * p.along); });
    from = std::max(from, to);
  }
  return sum;
}

// The contour integral; its sum cancels where the planes are nearly one, so that the tolerance must be tighter there.
double contour_flow(Polygon a, Polygon b, double tolerance) {
  const double flatness = 0.5 * (1 - area_vector(a).normalized().dot(area_vector(b).normalized()));
  tolerance = std::clamp(tolerance * flatness, 1e-13, 1e-2);
  double sum = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    const Segment p{a[i], a[(i + 1) % a.size()] - a[i]};
    for (std::size_t j = 0; j < b.size(); ++j) {
      const Segment q{b[j], b[(j + 1) % b.size()] - b[j]};
      const double dot = p.along.dot(q.along);
      if (std::abs(dot) > 1e-15 * p.along.norm() * q.along.norm()) sum += dot * mean_log(p, q, tolerance);
    }
  }
  return sum / (2 * kPi);
}

// A parallelogram, origin + s u + t v, or the triangle origin + s (u + t (v - u)); s, t in [0, 1].
struct Cell {
  V origin, u, v;
  bool triangle = false;
};

constexpr int kMaxAreaOrder = 5;

// Quadrature points of a cell; the weights sum to 1 (parallelogram) or 1/2 (triangle), times |u x v| = its area.
struct Points {
  int count = 0;
  V normal;  // u x v
  std::array<V, kMaxAreaOrder*(kMaxAreaOrder + 1)> x;
  std::array<double, kMaxAreaOrder*(kMaxAreaOrder + 1)> weight;

  Points(const Cell& cell, int order) : normal(cell.u.cross(cell.v)) {
    // One order more along s: the triangle's collapsed coordinates bring a factor s.
    const GaussRule &along_s = gauss_rule(order + cell.triangle), &along_t = gauss_rule(order);
    for (int i = 0; i < along_s.order; ++i)
      for (int j = 0; j < along_t.order; ++j) {
        const double s = along_s.node[i], t = along_t.node[j], w = along_s.weight[i] * along_t.weight[j];
        x[count] = cell.triangle ? V(cell.origin + s * (cell.u + t * (cell.v - cell.u)))
                                 : V(cell.origin + s * cell.u + t * cell.v);
        weight[count++] = cell.triangle ? s * w : w;
      }
  }
};

// Integral of cos cos / (pi r^2) over both areas.
double area_flow(const Points& a, const Points& b) {
  double sum = 0;
  for (int i = 0; i < a.count; ++i) {
    double row = 0;
    for (int j = 0; j < b.count; ++j) {
      const V r = b.x[j] - a.x[i];
      const double r2 = r.squaredNorm();
      row -= b.weight[j] * r.dot(a.normal) * r.dot(b.normal) / (r2 * r2);
    }
    sum += a.weight[i] * row;
  }
  return sum / kPi;
}

bool is_parallelogram(Polygon p) {
  return p.size() == 4 && (p[0] + p[2] - p[1] - p[3]).norm() < 1e-12 * (p[2] - p[0]).norm();
}

double area_flow(Polygon a, Polygon b, int order) {
  if (is_parallelogram(a) && is_parallelogram(b))
    return area_flow(Points({a[0], a[1] - a[0], a[3] - a[0]}, order), Points({b[0], b[1] - b[0], b[3] - b[0]}, order));
  double sum = 0;
  for (std::size_t i = 1; i + 1 < a.size(); ++i) {
    const Points points({a[0], a[i] - a[0], a[i + 1] - a[0], true}, order);
    for (std::size_t j = 1; j + 1 < b.size(); ++j)
      sum += area_flow(points, Points({b[0], b[j] - b[0], b[j + 1] - b[0], true}, order));
  }
  return sum;
}

// Order of area quadrature that meets the tolerance; 0 = too near for it.
int area_order(Polygon a, Polygon b, double size, double tolerance) {
  const double ratio = size / (2 * (centre(a) - centre(b)).norm() - size);
  if (!(ratio > 0)) return 0;
  double error = 4 * ratio * ratio;
  for (int order = 2; order <= kMaxAreaOrder; ++order)
    if ((error *= ratio * ratio) < tolerance) return order;
  return 0;
}

// Lowest and highest corner above a plane.
std::array<double, 2> heights(Polygon p, const V& origin, const V& normal) {
  std::array<double, 2> range{HUGE_VAL, -HUGE_VAL};
  for (const V& x : p) {
    const double h = (x - origin).dot(normal);
    range = {std::min(range[0], h), std::max(range[1], h)};
  }
  return range;
}

double visible_flow(Polygon a, Polygon b, double size, double tolerance) {
  const int order = area_order(a, b, size, tolerance);
  return std::max(0.0, order ? area_flow(a, b, order) : contour_flow(a, b, tolerance));
}

}  // namespace

double patch_flow(Polygon a, Polygon b, double tolerance) {
  if (a.size() < 3 || b.size() < 3) return 0;
  const double size = std::max(diameter(a), diameter(b)), slack = 1e-12 * size;
  V na = area_vector(a), nb = area_vector(b);
  // Thinner than rounding: no area.
  if (!(na.norm() > slack * diameter(a)) || !(nb.norm() > slack * diameter(b))) return 0;
  na.normalize(), nb.normalize();
  const auto a_over_b = heights(a, b[0], nb), b_over_a = heights(b, a[0], na);
  if (a_over_b[1] <= slack || b_over_a[1] <= slack) return 0;  // behind, or in one plane
  if (a_over_b[0] >= -slack && b_over_a[0] >= -slack) return visible_flow(a, b, size, tolerance);
  const Corners above_b = clip(a, b[0], nb, slack), above_a = clip(b, a[0], na, slack);
  if (above_b.size() < 3 || above_a.size() < 3) return 0;
  return visible_flow(above_b, above_a, size, tolerance);
}

}  // namespace countershade::solver
