#include "solver/transport/polygon.h"

#include <algorithm>
#include <cmath>

namespace countershade::solver {

using V = Eigen::Vector3d;

V area_vector(Polygon p) {
  V sum = V::Zero();
  for (std::size_t i = 1; i + 1 < p.size(); ++i) sum += (p[i] - p[0]).cross(p[i + 1] - p[0]);
  return sum;
}

double diameter(Polygon p) {
  double d2 = 0;
  for (std::size_t i = 0; i < p.size(); ++i)
    for (std::size_t j = i + 1; j < p.size(); ++j) d2 = std::max(d2, (p[i] - p[j]).squaredNorm());
  return std::sqrt(d2);
}

V centre(Polygon p) {
  V sum = V::Zero();
  for (const V& x : p) sum += x;
  return sum / static_cast<double>(p.size());
}

Corners clip(Polygon p, const V& origin, const V& normal, double slack) {
  const auto height = [&](const V& x) {
    const double h = (x - origin).dot(normal);
    return std::abs(h) < slack ? 0.0 : h;
  };
  Corners out;
  for (std::size_t i = 0; i < p.size(); ++i) {
    const V &a = p[i], &b = p[(i + 1) % p.size()];
    const double ha = height(a), hb = height(b);
    if (ha >= 0) out.push_back(a);
    if ((ha > 0 && hb < 0) || (ha < 0 && hb > 0)) out.push_back(a + (b - a) * (ha / (ha - hb)));
  }
  return out;
}

}  // namespace countershade::solver
