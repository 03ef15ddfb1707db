#include "simdata/room/shape.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "calib/base/check.h"
#include "simdata/room/mesh.h"

namespace countershade::simdata {

namespace {

constexpr double kSlack = 1e-9;  // of a chart's rim, so that shapes which touch leave no gap

double radians(double degrees) {
  return degrees * std::numbers::pi / 180;
}
Eigen::Vector3d vector(const std::array<double, 3>& a) {
  return {a[0], a[1], a[2]};
}

// Horizontal direction of an azimuth, and the one that leads to larger azimuths.
Eigen::Vector3d outward(double azimuth) {
  return {std::sin(azimuth), 0, -std::cos(azimuth)};
}
Eigen::Vector3d sideways(double azimuth) {
  return {std::cos(azimuth), 0, std::sin(azimuth)};
}

// Fraction of the arc `first .. first + turn` at which a horizontal direction lies; outside [0, 1] beyond its ends.
double arc_fraction(const Eigen::Vector3d& d, double first, double turn) {
  constexpr double kFull = 2 * std::numbers::pi;
  double angle = std::fmod(std::atan2(d.x(), -d.z()) - first, kFull);
  if (angle < 0) angle += kFull;
  if (angle > turn && kFull - angle < kSlack * turn) angle = 0;
  return angle / turn;
}

// Real roots of a t^2 + 2 h t + c = 0 in rising order; none or one written twice where a = 0.
std::optional<std::pair<double, double>> roots(double a, double h, double c) {
  if (std::abs(a) < 1e-14 * (std::abs(h) + std::abs(c))) {
    if (h == 0) return std::nullopt;
    return std::pair(-c / (2 * h), -c / (2 * h));
  }
  const double discriminant = h * h - a * c;
  if (!(discriminant >= 0)) return std::nullopt;
  const double q = -(h + std::copysign(std::sqrt(discriminant), h));
  const double r0 = q / a, r1 = q == 0 ? r0 : c / q;
  return std::pair(std::min(r0, r1), std::max(r0, r1));
}

bool in_chart(double u, double v) {
  return u >= -kSlack && u <= 1 + kSlack && v >= -kSlack && v <= 1 + kSlack;
}

}  // namespace

double Shape::diagonal(double u, double v, double du, double dv) const {
  const auto at_clamped = [&](double a, double b) { return at(std::clamp(a, 0.0, 1.0), std::clamp(b, 0.0, 1.0)).x; };
  return (at_clamped(u + du / 2, v + dv / 2) - at_clamped(u - du / 2, v - dv / 2)).norm();
}

std::vector<SurfacePoint> Shape::samples() const {
  constexpr int kSteps = 64;
  std::vector<SurfacePoint> points;
  for (int j = 0; j <= kSteps; ++j)
    for (int i = 0; i <= kSteps; ++i) points.push_back(at(i / double{kSteps}, j / double{kSteps}));
  return points;
}

// ---- rectangle ----

RectangleShape::RectangleShape(const Eigen::Vector3d& origin, const Eigen::Vector3d& along_u,
                               const Eigen::Vector3d& along_v)
    : plane_(origin, along_u, along_v), normal_(plane_.normal(0, 0)), tangent_(along_u.normalized()) {}

SurfacePoint RectangleShape::at(double u, double v) const {
  SurfacePoint p;
  p.u = u, p.v = v;
  p.x = plane_.point(u, v);
  p.normal = normal_;
  p.along_u = tangent_;
  return p;
}

double RectangleShape::diagonal(double, double, double du, double dv) const {
  return (du * plane_.along_u() + dv * plane_.along_v()).norm();
}

std::optional<ShapeHit> RectangleShape::intersect(const Ray& ray, double t_near) const {
  const double slope = ray.direction.dot(normal_);
  if (slope == 0) return std::nullopt;
  const double t = (plane_.origin() - ray.origin).dot(normal_) / slope;
  if (!(t > t_near)) return std::nullopt;
  const Eigen::Vector2d c = plane_.chart_of(ray.origin + t * ray.direction);
  if (!in_chart(c.x(), c.y())) return std::nullopt;
  return ShapeHit{t, std::clamp(c.x(), 0.0, 1.0), std::clamp(c.y(), 0.0, 1.0)};
}

// ---- round ----

RoundShape::RoundShape(const SimulatedSurface& s)
    : centre_(vector(s.origin)),
      first_(radians(s.azimuth_deg[0])),
      turn_(radians(s.azimuth_deg[1] - s.azimuth_deg[0])),
      inside_(s.lit == "inside") {}

SurfacePoint RoundShape::at(double u, double v) const {
  const double azimuth = first_ + u * turn_;
  const Profile profile = this->profile(v);
  const Eigen::Vector3d away = outward(azimuth), up = Eigen::Vector3d::UnitY();
  const Eigen::Vector3d out = profile.out * away + profile.up * up;
  SurfacePoint p;
  p.u = u, p.v = v;
  p.x = centre_ + profile.radius * away + profile.height * up;
  p.normal = inside_ ? Eigen::Vector3d(-out) : out;
  p.along_u = sideways(azimuth);
  return p;
}

bool RoundShape::closed() const {
  return turn_ > 2 * std::numbers::pi * (1 - kSlack);
}

std::optional<ShapeHit> RoundShape::intersect(const Ray& ray, double t_near) const {
  const Ray about{ray.origin - centre_, ray.direction};
  const auto both = meets(about);
  if (!both) return std::nullopt;
  for (const double t : {both->first, both->second}) {
    if (!(t > t_near)) continue;
    const Eigen::Vector3d x = about.origin + t * about.direction;
    const double u = arc_fraction(x, first_, turn_), v = v_of(x);
    if (in_chart(u, v)) return ShapeHit{t, std::clamp(u, 0.0, 1.0), std::clamp(v, 0.0, 1.0)};
  }
  return std::nullopt;
}

FrustumShape::FrustumShape(const SimulatedSurface& s)
    : RoundShape(s), bottom_(s.radius), top_(s.shape == "cone" ? s.top_radius : s.radius), height_(s.height) {}

RoundShape::Profile FrustumShape::profile(double v) const {
  const double slant = std::hypot(height_, top_ - bottom_);
  return {radius_at(v), v * height_, height_ / slant, (bottom_ - top_) / slant};
}

double FrustumShape::area_element(double, double v) const {
  return radius_at(v) * turn_ * std::hypot(height_, top_ - bottom_);
}

// x^2 + z^2 = (bottom + slope y)^2.
std::optional<std::pair<double, double>> FrustumShape::meets(const Ray& ray) const {
  const Eigen::Vector3d &o = ray.origin, &d = ray.direction;
  const double slope = (top_ - bottom_) / height_, r = bottom_ + slope * o.y(), dr = slope * d.y();
  return roots(d.x() * d.x() + d.z() * d.z() - dr * dr, o.x() * d.x() + o.z() * d.z() - r * dr,
               o.x() * o.x() + o.z() * o.z() - r * r);
}

double FrustumShape::v_of(const Eigen::Vector3d& x) const {
  const double v = x.y() / height_;
  return radius_at(v) >= 0 ? v : std::nan("");
}

bool FrustumShape::encloses(const Eigen::Vector3d& x) const {
  const Eigen::Vector3d o = x - centre_;
  const double r = radius_at(o.y() / height_);
  return inside_ && r >= 0 && std::hypot(o.x(), o.z()) <= r * (1 + 1e-9) + 1e-12;
}

SphereShape::SphereShape(const SimulatedSurface& s)
    : RoundShape(s),
      radius_(s.radius),
      low_(radians(s.elevation_deg[0])),
      rise_(radians(s.elevation_deg[1] - s.elevation_deg[0])) {}

RoundShape::Profile SphereShape::profile(double v) const {
  const double cosine = std::cos(low_ + v * rise_), sine = std::sin(low_ + v * rise_);
  return {radius_ * cosine, radius_ * sine, cosine, sine};
}

double SphereShape::area_element(double, double v) const {
  return radius_ * radius_ * std::max(0.0, std::cos(low_ + v * rise_)) * turn_ * rise_;
}

std::optional<std::pair<double, double>> SphereShape::meets(const Ray& ray) const {
  return roots(ray.direction.squaredNorm(), ray.origin.dot(ray.direction),
               ray.origin.squaredNorm() - radius_ * radius_);
}

double SphereShape::v_of(const Eigen::Vector3d& x) const {
  return (std::asin(std::clamp(x.y() / radius_, -1.0, 1.0)) - low_) / rise_;
}

bool SphereShape::encloses(const Eigen::Vector3d& x) const {
  return inside_ && (x - centre_).norm() <= radius_ * (1 + 1e-9);
}

// ---- mesh ----

MeshShape::MeshShape(Triangles triangles) : mesh_(std::move(triangles)) {
  Eigen::AlignedBox3d box;
  for (const Eigen::Vector3d& x : mesh_.corners) box.extend(x);
  low_ = box.min(), size_ = box.sizes().cwiseMax(1e-12);
  int least = 0;
  size_.minCoeff(&least);
  first_axis_ = least == 0 ? 2 : 0, second_axis_ = least == 1 ? 2 : 1;
}

SurfacePoint MeshShape::at(double, double) const {
  CS_CHECK(false, "a mesh has no chart");
  return {};
}
double MeshShape::area_element(double, double) const {
  CS_CHECK(false, "a mesh has no chart");
  return 0;
}

SurfacePoint MeshShape::at(const ShapeHit& hit) const {
  return at(hit.face, hit.b1, hit.b2);
}

SurfacePoint MeshShape::at(int face, double b1, double b2) const {
  const Eigen::Vector3i& f = mesh_.faces[face];
  const Eigen::Vector3d &a = mesh_.corners[f[0]], ab = mesh_.corners[f[1]] - a, ac = mesh_.corners[f[2]] - a;
  SurfacePoint p;
  p.face = face, p.b1 = b1, p.b2 = b2;
  p.x = a + b1 * ab + b2 * ac;
  p.normal = ab.cross(ac).normalized();
  const Eigen::Vector3d side = std::abs(p.normal.y()) < 0.99 ? Eigen::Vector3d::UnitY() : Eigen::Vector3d::UnitZ();
  p.along_u = side.cross(p.normal).normalized();
  p.u = (p.x[first_axis_] - low_[first_axis_]) / size_[first_axis_];
  p.v = (p.x[second_axis_] - low_[second_axis_]) / size_[second_axis_];
  return p;
}

std::vector<SurfacePoint> MeshShape::samples() const {
  std::vector<SurfacePoint> points;
  for (int f = 0; f < static_cast<int>(mesh_.faces.size()); ++f)
    for (const auto& [b1, b2] : {std::pair{0.0, 0.0}, {1.0, 0.0}, {0.0, 1.0}}) points.push_back(at(f, b1, b2));
  return points;
}

// Moller & Trumbore 1997.
std::optional<ShapeHit> MeshShape::intersect_face(int face, const Ray& ray) const {
  const Eigen::Vector3i& f = mesh_.faces[face];
  const Eigen::Vector3d &a = mesh_.corners[f[0]], ab = mesh_.corners[f[1]] - a, ac = mesh_.corners[f[2]] - a;
  const Eigen::Vector3d p = ray.direction.cross(ac);
  const double determinant = ab.dot(p);
  if (determinant == 0) return std::nullopt;
  const Eigen::Vector3d s = ray.origin - a, q = s.cross(ab);
  const double b1 = s.dot(p) / determinant, b2 = ray.direction.dot(q) / determinant;
  ShapeHit hit;
  hit.t = ac.dot(q) / determinant, hit.face = face, hit.b1 = b1, hit.b2 = b2;
  return hit;
}

std::optional<ShapeHit> MeshShape::intersect(const Ray& ray, double t_near) const {
  std::optional<ShapeHit> nearest;
  for (int f = 0; f < static_cast<int>(mesh_.faces.size()); ++f) {
    const auto hit = intersect_face(f, ray);
    if (!hit || hit->b1 < -kSlack || hit->b2 < -kSlack || hit->b1 + hit->b2 > 1 + kSlack || !(hit->t > t_near))
      continue;
    if (!nearest || hit->t < nearest->t) nearest = hit;
  }
  return nearest;
}

// ---- from the rig file ----

Result<std::shared_ptr<const Shape>> make_shape(const SimulatedSurface& s) {
  if (s.shape == "mesh") {
    CS_TRY(MeshShape::Triangles triangles, read_mesh(s.mesh, s.mesh_scale, vector(s.origin)));
    return std::shared_ptr<const Shape>(std::make_shared<MeshShape>(std::move(triangles)));
  }
  if (s.shape == "sphere") return std::shared_ptr<const Shape>(std::make_shared<SphereShape>(s));
  if (s.shape == "cylinder" || s.shape == "cone")
    return std::shared_ptr<const Shape>(std::make_shared<FrustumShape>(s));
  const Eigen::Vector3d u = vector(s.along_u), v = vector(s.along_v);
  if (!(u.cross(v).norm() > 1e-6 * u.norm() * v.norm()) || !(u.norm() >= 1e-4) || !(v.norm() >= 1e-4))
    return error(ErrorCode::kBadValue,
                 "[[simulation.surface]] '{}': along_u and along_v span no area; they must be at least .1 mm long and "
                 "point in different directions",
                 s.id);
  return std::shared_ptr<const Shape>(std::make_shared<RectangleShape>(vector(s.origin), u, v));
}

Result<std::vector<std::shared_ptr<const Shape>>> make_shapes(const Simulation& simulation) {
  std::vector<std::shared_ptr<const Shape>> shapes;
  for (const SimulatedSurface& s : simulation.surfaces) {
    CS_TRY(shapes.emplace_back(), make_shape(s));
  }
  return shapes;
}

}  // namespace countershade::simdata
