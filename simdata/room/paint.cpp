#include "simdata/room/paint.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "calib/base/random.h"

namespace countershade::simdata {

namespace {

constexpr double kPi = std::numbers::pi;

double radians(double degrees) {
  return degrees * kPi / 180;
}

// The axis of a light-directing screen at a point.
Eigen::Vector3d axis_of(const SimulatedSurface& s, const SurfacePoint& at) {
  const Eigen::Vector3d along_v = at.normal.cross(at.along_u);
  return (at.normal + std::tan(radians(s.directing_tilt_deg[0])) * at.along_u +
          std::tan(radians(s.directing_tilt_deg[1])) * along_v)
      .normalized();
}

// Integral over the hemisphere of max(0, axis o)^m cos(o) / pi, by the midpoint rule in (cos^2, azimuth).
double directing_integral(const SimulatedSurface& s) {
  const Eigen::Vector3d axis = axis_of(s, SurfacePoint{});
  constexpr int kSteps = 400;
  double sum = 0;
  for (int j = 0; j < kSteps; ++j)
    for (int i = 0; i < kSteps; ++i) {
      const double cos2 = (j + 0.5) / kSteps, azimuth = 2 * kPi * (i + 0.5) / kSteps;
      const double sine = std::sqrt(1 - cos2);
      const Eigen::Vector3d o(sine * std::cos(azimuth), sine * std::sin(azimuth), std::sqrt(cos2));
      sum += std::pow(std::max(0.0, axis.dot(o)), s.directing);
    }
  return sum / (kSteps * kSteps);
}

// Integral over the hemisphere of ggx cos(in), for each of the table's directions out; the midpoint rule as above.
std::vector<double> albedo_table(double alpha) {
  constexpr int kTable = 64, kSteps = 160;
  std::vector<double> table;
  for (int k = 0; k < kTable; ++k) {
    const double cosine = std::max(1e-3, k / (kTable - 1.0));
    const Eigen::Vector3d out(std::sqrt(1 - cosine * cosine), 0, cosine);
    double sum = 0;
    for (int j = 0; j < kSteps; ++j)
      for (int i = 0; i < kSteps; ++i) {
        const double cos2 = (j + 0.5) / kSteps, azimuth = kPi * (i + 0.5) / kSteps;  // half: it is symmetric
        const double sine = std::sqrt(1 - cos2);
        const Eigen::Vector3d in(sine * std::cos(azimuth), sine * std::sin(azimuth), std::sqrt(cos2));
        sum += kPi * ggx(Eigen::Vector3d::UnitZ(), in, out, alpha);
      }
    table.push_back(sum / (kSteps * kSteps));
  }
  return table;
}

}  // namespace

double ggx(const Eigen::Vector3d& normal, const Eigen::Vector3d& in, const Eigen::Vector3d& out, double alpha) {
  const double ni = normal.dot(in), no = normal.dot(out);
  if (!(ni > 0 && no > 0)) return 0;
  const double nh = normal.dot((in + out).normalized()), a2 = alpha * alpha;
  const double base = nh * nh * (a2 - 1) + 1, D = a2 / (kPi * base * base);
  // Height-correlated Smith: G / (4 ni no) in one fraction.
  const double V = 0.5 / (no * std::sqrt(ni * ni * (1 - a2) + a2) + ni * std::sqrt(no * no * (1 - a2) + a2));
  return D * V;
}

Paint::Paint(const Simulation& simulation) : of_(simulation.surfaces), seed_(simulation.seed) {
  for (const SimulatedSurface& s : of_) {
    base_.emplace_back(static_cast<float>(s.albedo[0]), static_cast<float>(s.albedo[1]),
                       static_cast<float>(s.albedo[2]), 0.0f);
    glossy_albedo_.push_back(s.gloss > 0 ? albedo_table(s.roughness) : std::vector<double>());
    directing_scale_.push_back(s.directing > 0 ? 1 / directing_integral(s) : 1);
  }
}

// Slow waves, different on every surface and symmetric in nothing; cells by chance.
double Paint::texture(const SurfacePoint& at) const {
  const SimulatedSurface& s = of_[at.surface];
  double factor = 1;
  if (s.texture > 0)
    factor += s.texture * std::sin(2.9 * at.u + 1.7 * at.v + 0.8 + 1.9 * at.surface) *
              std::cos(4.3 * at.v - 1.1 * at.u + 0.3 * at.surface);
  if (s.patchwork > 0) {
    const auto cell = [](double u, int n) { return std::clamp(static_cast<int>(u * n), 0, n - 1); };
    const std::uint64_t key = cell(at.v, s.patchwork_cells[1]) * 4096ull + cell(at.u, s.patchwork_cells[0]);
    Random random(mix(seed_ ^ hash_name(s.id)) ^ key);
    factor *= 1 + s.patchwork * random.uniform(-1, 1);
  }
  return factor;
}

double Paint::directed(const SurfacePoint& at, const Eigen::Vector3d& out) const {
  const SimulatedSurface& s = of_[at.surface];
  if (s.directing == 0) return 1 - s.gloss;
  return (1 - s.gloss) * directing_scale_[at.surface] * std::pow(std::max(0.0, axis_of(s, at).dot(out)), s.directing);
}

double Paint::glossy(const SurfacePoint& at, const Eigen::Vector3d& in, const Eigen::Vector3d& out) const {
  const SimulatedSurface& s = of_[at.surface];
  return s.gloss > 0 ? s.gloss * kPi * ggx(at.normal, in, out, s.roughness) : 0;
}

double Paint::lobe(const SurfacePoint& at, const Eigen::Vector3d& in, const Eigen::Vector3d& out) const {
  return is_diffuse(at.surface) ? 1 : directed(at, out) + glossy(at, in, out);
}

Paint::Mirrored Paint::mirrored(const SurfacePoint& at, const Eigen::Vector3d& out, double a, double b) const {
  const double alpha = of_[at.surface].roughness;
  const Eigen::Vector3d across = at.normal.cross(at.along_u);
  const Eigen::Vector3d o(at.along_u.dot(out), across.dot(out), at.normal.dot(out));
  if (!(o.z() > 0)) return {};
  // The hemisphere of normals, stretched to that of a surface of roughness 1, seen from `out`: half a disc beside a
  // shortened one.
  const Eigen::Vector3d seen = Eigen::Vector3d(alpha * o.x(), alpha * o.y(), o.z()).normalized();
  const double sideways = std::hypot(seen.x(), seen.y());
  const Eigen::Vector3d s =
      sideways > 0 ? Eigen::Vector3d(-seen.y() / sideways, seen.x() / sideways, 0) : Eigen::Vector3d::UnitX();
  const Eigen::Vector3d t = seen.cross(s);
  const double radius = std::sqrt(a), p = radius * std::cos(2 * kPi * b), whole = radius * std::sin(2 * kPi * b);
  const double shortened = (1 + seen.z()) / 2, q = (1 - shortened) * std::sqrt(1 - p * p) + shortened * whole;
  const Eigen::Vector3d n = p * s + q * t + std::sqrt(std::max(0.0, 1 - p * p - q * q)) * seen;
  const Eigen::Vector3d normal = Eigen::Vector3d(alpha * n.x(), alpha * n.y(), std::max(0.0, n.z())).normalized();
  const Eigen::Vector3d i = 2 * o.dot(normal) * normal - o;
  if (!(i.z() > 0)) return {};
  const auto lambda = [&](double cosine) {  // Smith's
    return (std::sqrt(1 + alpha * alpha * (1 / (cosine * cosine) - 1)) - 1) / 2;
  };
  const double unmasked = (1 + lambda(o.z())) / (1 + lambda(o.z()) + lambda(i.z()));
  return {i.x() * at.along_u + i.y() * across + i.z() * at.normal, of_[at.surface].gloss * unmasked};
}

double Paint::evenly_lit(const SurfacePoint& at, const Eigen::Vector3d& out) const {
  if (is_diffuse(at.surface)) return 1;
  const std::vector<double>& table = glossy_albedo_[at.surface];
  if (table.empty()) return directed(at, out);
  const double x = std::clamp(at.normal.dot(out), 0.0, 1.0) * static_cast<double>(table.size() - 1);
  const std::size_t i = std::min(static_cast<std::size_t>(x), table.size() - 2);
  const double f = x - static_cast<double>(i);
  return directed(at, out) + of_[at.surface].gloss * (table[i] * (1 - f) + table[i + 1] * f);
}

double Paint::daylight(const SurfacePoint& at) const {
  const SimulatedSurface& s = of_[at.surface];
  const bool inside =
      at.u >= s.daylight_from[0] && at.u < s.daylight_to[0] && at.v >= s.daylight_from[1] && at.v < s.daylight_to[1];
  return inside ? s.daylight : 0;
}

}  // namespace countershade::simdata
