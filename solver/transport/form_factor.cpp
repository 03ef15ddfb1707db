#include "solver/transport/form_factor.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "solver/transport/patch_flow.h"
#include "solver/transport/quadrature.h"

namespace countershade::solver {

namespace {

using V = Eigen::Vector3d;
using Corners = std::vector<V>;
constexpr double kPi = std::numbers::pi;

// Twice the vector area.
V area_vector(Polygon p) {
  V sum = V::Zero();
  for (std::size_t i = 1; i + 1 < p.size(); ++i) sum += (p[i] - p[0]).cross(p[i + 1] - p[0]);
  return sum;
}

double diameter(Polygon p) {
  double d = 0;
  for (std::size_t i = 0; i < p.size(); ++i)
    for (std::size_t j = i + 1; j < p.size(); ++j) d = std::max(d, (p[i] - p[j]).norm());
  return d;
}

V centre(Polygon p) {
  V sum = V::Zero();
  for (const V& x : p) sum += x;
  return sum / static_cast<double>(p.size());
}

// The part of a polygon on the side that `normal` points to (Sutherland & Hodgman 1974, one plane).
Corners clip(Polygon p, const V& origin, const V& normal, double tolerance) {
  Corners out;
  for (std::size_t i = 0; i < p.size(); ++i) {
    const V &a = p[i], &b = p[(i + 1) % p.size()];
    double ha = (a - origin).dot(normal), hb = (b - origin).dot(normal);
    if (std::abs(ha) < tolerance) ha = 0;
    if (std::abs(hb) < tolerance) hb = 0;
    if (ha >= 0) out.push_back(a);
    if ((ha > 0 && hb < 0) || (ha < 0 && hb > 0)) out.push_back(a + (b - a) * (ha / (ha - hb)));
  }
  return out;
}

// Smallest distance between two segments (Ericson 2005, 5.1.9).
double segment_distance(const V& p, const V& d1, const V& q, const V& d2) {
  const V r = p - q;
  const double a = d1.squaredNorm(), e = d2.squaredNorm(), f = d2.dot(r), c = d1.dot(r), b = d1.dot(d2);
  const double denominator = a * e - b * b;
  double s = denominator > 1e-14 * a * e ? std::clamp((b * f - c * e) / denominator, 0.0, 1.0) : 0.0;
  const double t = std::clamp((b * s + f) / e, 0.0, 1.0);
  s = std::clamp((b * t - c) / a, 0.0, 1.0);
  return (p + s * d1 - q - t * d2).norm();
}

// integral of ln sqrt(t^2 + h^2) dt
double log_primitive(double t, double h) {
  const double r2 = t * t + h * h;
  const double log_part = r2 > 0 ? 0.5 * t * std::log(r2) : 0;
  return log_part - t + (h > 0 ? h * std::atan(t / h) : 0);
}

// Mean over the segment q + t d (t in 0..1) of ln |x - q - t d|, in closed form.
struct SegmentLog {
  V q, e;
  double length;
  SegmentLog(const V& start, const V& d) : q(start), e(d / d.norm()), length(d.norm()) {}
  double operator()(const V& x) const {
    const double along = (x - q).dot(e);
    const double h = (x - q - along * e).norm();
    return (log_primitive(length - along, h) - log_primitive(-along, h)) / length;
  }
};

// Mean over two segments of ln r. Far segments by Gauss-Legendre of an order that the nearest singularity of the
// integrand in the complex plane asks for; near or touching ones by tanh-sinh between the points where it is singular.
double mean_log(const V& p, const V& d1, const V& q, const V& d2, double tolerance) {
  const double half = 0.5 * d1.norm(), gap = segment_distance(p, d1, q, d2);
  const SegmentLog inner(q, d2);
  const double ratio = gap / half, rho = ratio + std::sqrt(1 + ratio * ratio);
  const double wanted = std::ceil(std::log(1 / tolerance) / (2 * std::log(rho))) + 1;  // infinite where they touch
  if (wanted <= kMaxGaussOrder) {
    const GaussRule& rule = gauss_rule(std::max(1, static_cast<int>(wanted)));
    double sum = 0;
    for (int i = 0; i < rule.order; ++i) sum += rule.weight[i] * inner(p + rule.node[i] * d1);
    return sum;
  }
  double cuts[4] = {0, 1, 0, 0};
  int count = 2;
  for (const V& end : {q, V(q + d2)}) {  // feet of the other segment's ends
    const double s = (end - p).dot(d1) / d1.squaredNorm();
    if (s > 1e-9 && s < 1 - 1e-9) cuts[count++] = s;
  }
  std::sort(cuts, cuts + count);
  double sum = 0;
  for (int i = 0; i + 1 < count; ++i) sum += tanh_sinh(cuts[i], cuts[i + 1], [&](double s) { return inner(p + s * d1); });
  return sum;
}

double contour_flow(Polygon a, Polygon b, double tolerance) {
  double sum = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    const V da = a[(i + 1) % a.size()] - a[i];
    if (da.squaredNorm() == 0) continue;
    for (std::size_t j = 0; j < b.size(); ++j) {
      const V db = b[(j + 1) % b.size()] - b[j];
      const double dot = da.dot(db);
      if (std::abs(dot) <= 1e-15 * da.norm() * db.norm() || db.squaredNorm() == 0) continue;
      sum += dot * mean_log(a[i], da, b[j], db, tolerance);
    }
  }
  return sum / (2 * kPi);
}

// Area integral of cos cos / (pi r^2) over two parallelograms, Gauss-Legendre of `order` along each side.
double area_flow(Polygon a, Polygon b, int order) {
  const GaussRule& rule = gauss_rule(order);
  const V ua = a[1] - a[0], va = a[3] - a[0], ub = b[1] - b[0], vb = b[3] - b[0];
  const V na = ua.cross(va), nb = ub.cross(vb);
  double sum = 0;
  for (int i = 0; i < order; ++i)
    for (int j = 0; j < order; ++j) {
      const V x = a[0] + rule.node[i] * ua + rule.node[j] * va;
      double row = 0;
      for (int k = 0; k < order; ++k)
        for (int l = 0; l < order; ++l) {
          const V r = b[0] + rule.node[k] * ub + rule.node[l] * vb - x;
          const double r2 = r.squaredNorm();
          row += rule.weight[k] * rule.weight[l] * (r.dot(na) * -r.dot(nb)) / (r2 * r2);
        }
      sum += rule.weight[i] * rule.weight[j] * row;
    }
  return sum / kPi;
}

bool is_parallelogram(Polygon p) { return p.size() == 4 && (p[0] + p[2] - p[1] - p[3]).norm() < 1e-12 * (p[2] - p[0]).norm(); }

// Order of area quadrature that meets the tolerance, 0 = too near for it.
int area_order(Polygon a, Polygon b, double tolerance) {
  if (!is_parallelogram(a) || !is_parallelogram(b)) return 0;
  const double size = std::max(diameter(a), diameter(b)), distance = (centre(a) - centre(b)).norm();
  const double ratio = size / (2 * distance - size);
  for (int order = 2; order <= 5; ++order)
    if (ratio > 0 && 4 * std::pow(ratio, 2 * order) < tolerance) return order;
  return 0;
}

// A_a F_ab.
double flow(Polygon a, Polygon b, double tolerance) {
  const V na = area_vector(a), nb = area_vector(b);
  const double size = std::max(diameter(a), diameter(b));
  if (a.size() < 3 || b.size() < 3 || !(na.norm() > 0) || !(nb.norm() > 0)) return 0;
  const V ua = na.normalized(), ub = nb.normalized();
  const auto lowest = [](Polygon p, const V& origin, const V& n) {
    double low = HUGE_VAL;
    for (const V& x : p) low = std::min(low, (x - origin).dot(n));
    return low;
  };
  const double slack = 1e-12 * size;
  if (lowest(a, b[0], ub) >= -slack && lowest(b, a[0], ua) >= -slack) {
    const int order = area_order(a, b, tolerance);
    return std::max(0.0, order ? area_flow(a, b, order) : contour_flow(a, b, tolerance));
  }
  const Corners ca = clip(a, b[0], ub, slack), cb = clip(b, a[0], ua, slack);
  if (ca.size() < 3 || cb.size() < 3) return 0;
  return std::max(0.0, contour_flow(ca, cb, tolerance));
}

}  // namespace

double patch_flow(Polygon a, Polygon b, double tolerance) { return flow(a, b, tolerance); }

double form_factor(Polygon a, Polygon b) {
  const double area = 0.5 * area_vector(a).norm();
  return area > 0 ? flow(a, b, 1e-11) / area : 0;
}

double point_form_factor(const V& x, const V& n, Polygon b) {
  const V nb = area_vector(b);
  if ((x - b[0]).dot(nb) <= 0) return 0;  // behind it
  double lowest = HUGE_VAL, size = 0;
  for (const V& p : b) lowest = std::min(lowest, (p - x).dot(n)), size = std::max(size, (p - x).norm());
  Corners clipped;
  if (lowest < 0) {
    clipped = clip(b, x, n, 1e-14 * size);
    if (clipped.size() < 3) return 0;
    b = clipped;
  }
  double sum = 0;
  V from = b.back() - x;
  for (const V& corner : b) {
    const V to = corner - x, cross = from.cross(to);
    const double sine = cross.norm();
    if (sine > 0) sum += std::atan2(sine, from.dot(to)) * n.dot(cross) / sine;
    from = to;
  }
  return std::max(0.0, -sum / (2 * kPi));
}

double centre_form_factor(Polygon a, Polygon b) {
  const V na = area_vector(a).normalized(), nb = area_vector(b), r = centre(b) - centre(a);
  const double r2 = r.squaredNorm();
  if (!(r2 > 0)) return 0;
  return std::max(0.0, r.dot(na)) * std::max(0.0, -r.dot(nb) / 2) / (kPi * r2 * r2);
}

double opposite_rectangles(double w, double h, double d) {
  const double X = w / d, Y = h / d, x2 = 1 + X * X, y2 = 1 + Y * Y;
  return 2 / (kPi * X * Y) *
         (0.5 * std::log(x2 * y2 / (1 + X * X + Y * Y)) + X * std::sqrt(y2) * std::atan(X / std::sqrt(y2)) + Y * std::sqrt(x2) * std::atan(Y / std::sqrt(x2)) - X * std::atan(X) - Y * std::atan(Y));
}

double adjacent_rectangles(double l, double a, double b) {
  const double W = a / l, H = b / l, w2 = W * W, h2 = H * H, s = w2 + h2;
  const double logs = std::log((1 + w2) * (1 + h2) / (1 + s)) + w2 * std::log(w2 * (1 + s) / ((1 + w2) * s)) + h2 * std::log(h2 * (1 + s) / ((1 + h2) * s));
  return (W * std::atan(1 / W) + H * std::atan(1 / H) - std::sqrt(s) * std::atan(1 / std::sqrt(s)) + logs / 4) / (kPi * W);
}

}  // namespace countershade::solver
