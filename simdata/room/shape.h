// What a simulated room is made of: pieces of surface, each with a lit side and a chart.
#pragma once

#include <Eigen/Dense>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "calib/base/result.h"
#include "calib/file/rig.h"
#include "calib/geometry/screen.h"

namespace countershade::simdata {

// A point of a surface of the room.
struct SurfacePoint {
  int surface = -1;     // -1 = nowhere
  double u = 0, v = 0;  // chart
  int face = -1;        // of a mesh: triangle, and the weights of its second and third corner
  double b1 = 0, b2 = 0;
  Eigen::Vector3d x{0, 0, 0};        // world
  Eigen::Vector3d normal{0, 0, 1};   // unit, towards the lit side
  Eigen::Vector3d along_u{1, 0, 0};  // unit tangent
};

// Where a ray meets a shape.
struct ShapeHit {
  double t = 0;  // x = origin + t direction
  double u = 0, v = 0;
  int face = -1;
  double b1 = 0, b2 = 0;
};

class Shape {
 public:
  // kHollow: round, lit from inside; it sees itself. kBulging: round, lit from outside.
  enum class Form { kFlat, kHollow, kBulging, kMesh };

  virtual ~Shape() = default;
  virtual Form form() const = 0;
  bool sees_itself() const { return form() == Form::kHollow || form() == Form::kMesh; }
  // Point of the chart, (u, v) in [0, 1]^2; a mesh has none (a Bug).
  virtual SurfacePoint at(double u, double v) const = 0;
  // dA / (du dv) [m^2]; a mesh has none (a Bug).
  virtual double area_element(double u, double v) const = 0;
  // Whether u = 0 and u = 1 are the same line.
  virtual bool closed() const { return false; }
  // Size of a small cell of the chart about (u, v) [m].
  virtual double diagonal(double u, double v, double du, double dv) const;
  // Nearest intersection beyond t_near, from either side.
  virtual std::optional<ShapeHit> intersect(const Ray& ray, double t_near) const = 0;
  // No straight line between two points with this property crosses the shape between them.
  virtual bool encloses(const Eigen::Vector3d& x) const = 0;
  // Points all over it: a grid of the chart, rims included, or the corners of each face of a mesh.
  virtual std::vector<SurfacePoint> samples() const;
  // The point of a hit on this shape.
  virtual SurfacePoint at(const ShapeHit& hit) const { return at(hit.u, hit.v); }
};

class RectangleShape final : public Shape {
 public:
  RectangleShape(const Eigen::Vector3d& origin, const Eigen::Vector3d& along_u, const Eigen::Vector3d& along_v);
  Form form() const override { return Form::kFlat; }
  SurfacePoint at(double u, double v) const override;
  double area_element(double u, double v) const override { return plane_.area_element(u, v); }
  double diagonal(double u, double v, double du, double dv) const override;
  std::optional<ShapeHit> intersect(const Ray& ray, double t_near) const override;
  bool encloses(const Eigen::Vector3d& x) const override { return (x - plane_.origin()).dot(normal_) > -1e-9; }

 private:
  PlaneSurface plane_;
  Eigen::Vector3d normal_, tangent_;
};

// Part of a shape that turns about the vertical through `origin`, between two azimuths.
class RoundShape : public Shape {
 public:
  Form form() const override { return inside_ ? Form::kHollow : Form::kBulging; }
  SurfacePoint at(double u, double v) const override;
  bool closed() const override;
  std::optional<ShapeHit> intersect(const Ray& ray, double t_near) const override;

 protected:
  explicit RoundShape(const SimulatedSurface& s);
  struct Profile {  // in the half plane of one azimuth: distance from the axis, height, and the direction outward
    double radius, height, out, up;
  };
  virtual Profile profile(double v) const = 0;
  // Where a line, in coordinates about `origin`, meets the whole shape, nearest first.
  virtual std::optional<std::pair<double, double>> meets(const Ray& ray) const = 0;
  // v of a point of the whole shape; NaN for one of another nappe.
  virtual double v_of(const Eigen::Vector3d& x) const = 0;

  Eigen::Vector3d centre_;
  double first_ = 0, turn_ = 1;  // azimuths, rad
  bool inside_ = true;
};

// Of the side of a frustum: a cylinder where both radii are equal.
class FrustumShape final : public RoundShape {
 public:
  explicit FrustumShape(const SimulatedSurface& s);
  double area_element(double u, double v) const override;
  bool encloses(const Eigen::Vector3d& x) const override;

 private:
  double radius_at(double v) const { return bottom_ + v * (top_ - bottom_); }
  Profile profile(double v) const override;
  std::optional<std::pair<double, double>> meets(const Ray& ray) const override;
  double v_of(const Eigen::Vector3d& x) const override;
  double bottom_ = 1, top_ = 1, height_ = 1;
};

// Of a sphere, between two elevations.
class SphereShape final : public RoundShape {
 public:
  explicit SphereShape(const SimulatedSurface& s);
  double area_element(double u, double v) const override;
  bool encloses(const Eigen::Vector3d& x) const override;

 private:
  Profile profile(double v) const override;
  std::optional<std::pair<double, double>> meets(const Ray& ray) const override;
  double v_of(const Eigen::Vector3d& x) const override;
  double radius_ = 1, low_ = 0, rise_ = 1;  // elevations, rad
};

// Triangles. Corners that faces of different directions share stand there once per direction. (u, v): the bounding box
// along its two longest sides, for paint.
class MeshShape final : public Shape {
 public:
  struct Triangles {
    std::vector<Eigen::Vector3d> corners, normals;
    std::vector<Eigen::Vector3i> faces;
  };
  explicit MeshShape(Triangles triangles);
  const Triangles& triangles() const { return mesh_; }
  Form form() const override { return Form::kMesh; }
  SurfacePoint at(double, double) const override;
  double area_element(double, double) const override;
  SurfacePoint at(const ShapeHit& hit) const override;
  SurfacePoint at(int face, double b1, double b2) const;
  // Of the triangle hit.face alone, which need not be the nearest one.
  std::optional<ShapeHit> intersect_face(int face, const Ray& ray) const;
  std::optional<ShapeHit> intersect(const Ray& ray, double t_near) const override;
  bool encloses(const Eigen::Vector3d&) const override { return false; }
  std::vector<SurfacePoint> samples() const override;

 private:
  Triangles mesh_;
  Eigen::Vector3d low_, size_;
  int first_axis_ = 0, second_axis_ = 1;
};

// Errors: kBadValue for a shape without area and what read_mesh says.
Result<std::shared_ptr<const Shape>> make_shape(const SimulatedSurface& surface);
Result<std::vector<std::shared_ptr<const Shape>>> make_shapes(const Simulation& simulation);

}  // namespace countershade::simdata
