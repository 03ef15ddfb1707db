#include "simdata/render/scene.h"

#include <embree3/rtcore.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "calib/base/check.h"

namespace countershade::simdata {

namespace {

// Charts as Embree's own kind of geometry: bounds, hit, occlusion.
Eigen::AlignedBox3d bounds_of(const Shape& shape) {
  Eigen::AlignedBox3d box;
  for (const SurfacePoint& p : shape.samples()) box.extend(p.x);
  const Eigen::Vector3d slack = Eigen::Vector3d::Constant(0.01 * box.sizes().norm());  // what bulges between samples
  return {box.min() - slack, box.max() + slack};
}

void bounds_callback(const RTCBoundsFunctionArguments* args) {
  const Eigen::AlignedBox3d box = bounds_of(*static_cast<const Shape*>(args->geometryUserPtr));
  RTCBounds& out = *args->bounds_o;
  out.lower_x = static_cast<float>(box.min().x()), out.upper_x = static_cast<float>(box.max().x());
  out.lower_y = static_cast<float>(box.min().y()), out.upper_y = static_cast<float>(box.max().y());
  out.lower_z = static_cast<float>(box.min().z()), out.upper_z = static_cast<float>(box.max().z());
}

std::optional<ShapeHit> meet(const Shape& shape, const RTCRay& ray) {
  const Ray exact{{ray.org_x, ray.org_y, ray.org_z}, {ray.dir_x, ray.dir_y, ray.dir_z}};
  const auto hit = shape.intersect(exact, ray.tnear);
  return hit && hit->t < ray.tfar ? hit : std::nullopt;
}

void intersect_callback(const RTCIntersectFunctionNArguments* args) {
  if (!args->valid[0]) return;
  auto& query = *reinterpret_cast<RTCRayHit*>(args->rayhit);
  const auto hit = meet(*static_cast<const Shape*>(args->geometryUserPtr), query.ray);
  if (!hit) return;
  query.ray.tfar = static_cast<float>(hit->t);
  query.hit.u = static_cast<float>(hit->u), query.hit.v = static_cast<float>(hit->v);
  query.hit.geomID = args->geomID, query.hit.primID = 0, query.hit.instID[0] = args->context->instID[0];
}

void occluded_callback(const RTCOccludedFunctionNArguments* args) {
  if (!args->valid[0]) return;
  auto& ray = *reinterpret_cast<RTCRay*>(args->ray);
  if (meet(*static_cast<const Shape*>(args->geometryUserPtr), ray)) ray.tfar = -std::numeric_limits<float>::infinity();
}

}  // namespace

struct Scene::Embree {
  RTCDevice device = nullptr;
  RTCScene scene = nullptr;
  ~Embree() {
    if (scene) rtcReleaseScene(scene);
    if (device) rtcReleaseDevice(device);
  }

  void attach(RTCGeometry geometry) const {
    rtcCommitGeometry(geometry);
    rtcAttachGeometry(scene, geometry);
    rtcReleaseGeometry(geometry);
  }

  void add(const Shape& shape) const {
    if (shape.form() == Shape::Form::kFlat)
      add_rectangle(shape);
    else if (const auto* mesh = dynamic_cast<const MeshShape*>(&shape))
      add_mesh(*mesh);
    else
      add_round(shape);
  }

  void add_rectangle(const Shape& shape) const {
    RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_QUAD);
    auto* corner = static_cast<float*>(
        rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 3 * sizeof(float), 4));
    auto* index = static_cast<unsigned*>(
        rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT4, 4 * sizeof(unsigned), 1));
    const Eigen::Vector3d corners[4] = {shape.at(0, 0).x, shape.at(1, 0).x, shape.at(1, 1).x, shape.at(0, 1).x};
    for (int i = 0; i < 4; ++i) {
      index[i] = i;
      for (int k = 0; k < 3; ++k) corner[3 * i + k] = static_cast<float>(corners[i][k]);
    }
    attach(geometry);
  }

  void add_mesh(const MeshShape& mesh) const {
    const auto& [corners, normals, faces] = mesh.triangles();
    RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
    auto* corner = static_cast<float*>(rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                                                               3 * sizeof(float), corners.size()));
    auto* index = static_cast<unsigned*>(rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                                                                 3 * sizeof(unsigned), faces.size()));
    for (std::size_t i = 0; i < corners.size(); ++i)
      for (int k = 0; k < 3; ++k) corner[3 * i + k] = static_cast<float>(corners[i][k]);
    for (std::size_t i = 0; i < faces.size(); ++i)
      for (int k = 0; k < 3; ++k) index[3 * i + k] = faces[i][k];
    attach(geometry);
  }

  void add_round(const Shape& shape) const {
    RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_USER);
    rtcSetGeometryUserPrimitiveCount(geometry, 1);
    rtcSetGeometryUserData(geometry, const_cast<Shape*>(&shape));
    rtcSetGeometryBoundsFunction(
        geometry, [](const RTCBoundsFunctionArguments* args) { bounds_callback(args); }, nullptr);
    rtcSetGeometryIntersectFunction(geometry, intersect_callback);
    rtcSetGeometryOccludedFunction(geometry, occluded_callback);
    attach(geometry);
  }
};

Scene::Scene(std::vector<std::shared_ptr<const Shape>> shapes, std::vector<double> transmission,
             std::unique_ptr<Embree> embree)
    : shapes_(std::move(shapes)), transmission_(std::move(transmission)), embree_(std::move(embree)) {
  Eigen::AlignedBox3d box;
  for (const auto& shape : shapes_) {
    std::vector<Eigen::Vector3d> points;
    for (const SurfacePoint& p : shape->samples()) points.push_back(p.x);
    has_mesh_ |= shape->form() == Shape::Form::kMesh;
    for (const Eigen::Vector3d& x : points) box.extend(x);
    samples_.push_back(std::move(points));
  }
  extent_ = box.sizes().norm();
}
Scene::~Scene() = default;

Result<std::shared_ptr<const Scene>> Scene::make(std::vector<std::shared_ptr<const Shape>> shapes,
                                                 std::vector<double> transmission) {
  CS_CHECK(!shapes.empty(), "a room has surfaces");
  auto embree = std::make_unique<Embree>();
  // Embree's number of threads holds for all of TBB in this process: the default is all cores.
  embree->device = rtcNewDevice(nullptr);
  if (!embree->device) return error(ErrorCode::kUnsupported, "Embree does not start on this processor");
  embree->scene = rtcNewScene(embree->device);
  rtcSetSceneFlags(embree->scene, RTC_SCENE_FLAG_ROBUST);
  for (const auto& shape : shapes) embree->add(*shape);
  rtcCommitScene(embree->scene);
  return std::shared_ptr<const Scene>(new Scene(std::move(shapes), std::move(transmission), std::move(embree)));
}

SurfacePoint Scene::point(int surface, double u, double v) const {
  SurfacePoint p = shapes_[surface]->at(u, v);
  p.surface = surface;
  return p;
}

SurfacePoint Scene::located(int surface, const ShapeHit& hit) const {
  SurfacePoint p = shapes_[surface]->at(hit);
  p.surface = surface;
  return p;
}

namespace {

// Embree starts rays in single precision: from a flat surface a hair above it suffices, a curved one or a mesh would
// be met again.
template <class EmbreeRay>
void start(EmbreeRay& ray, const Eigen::Vector3d& origin, const Eigen::Vector3d& direction, double skip) {
  ray.org_x = static_cast<float>(origin.x()), ray.org_y = static_cast<float>(origin.y());
  ray.org_z = static_cast<float>(origin.z());
  ray.dir_x = static_cast<float>(direction.x()), ray.dir_y = static_cast<float>(direction.y());
  ray.dir_z = static_cast<float>(direction.z());
  ray.tnear = static_cast<float>(skip / direction.norm());
  ray.time = 0;
  ray.mask = ~0u;
  ray.id = ray.flags = 0;
}

RTCRayHit nearest(RTCScene scene, const Eigen::Vector3d& origin, const Eigen::Vector3d& direction, double skip) {
  RTCRayHit query{};
  start(query.ray, origin, direction, skip);
  query.ray.tfar = std::numeric_limits<float>::infinity();
  query.hit.geomID = RTC_INVALID_GEOMETRY_ID;
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  rtcIntersect1(scene, &context, &query);
  return query;
}

// How far rays from a surface start off it, and what they skip, in parts of the room.
struct Offset {
  double lift, skip;
};
Offset offset_of(const Shape& shape) {
  return shape.form() == Shape::Form::kFlat ? Offset{2e-7, 2e-7} : Offset{1e-6, 2e-5};
}

}  // namespace

SceneHit Scene::look(const Ray& ray) const {
  SceneHit nearest_hit;
  nearest_hit.t = HUGE_VAL;
  for (int s = 0; s < size(); ++s) {
    if (shapes_[s]->form() == Shape::Form::kMesh) continue;
    const auto hit = shapes_[s]->intersect(ray, 0);
    if (hit && hit->t < nearest_hit.t) nearest_hit = {located(s, *hit), hit->t, false};
  }
  if (has_mesh_) {
    const RTCRayHit query = nearest(embree_->scene, ray.origin, ray.direction, 0);
    const int s = static_cast<int>(query.hit.geomID);
    if (query.hit.geomID != RTC_INVALID_GEOMETRY_ID && query.ray.tfar < nearest_hit.t)
      if (const auto* mesh = dynamic_cast<const MeshShape*>(shapes_[s].get()))
        if (const auto hit = mesh->intersect_face(static_cast<int>(query.hit.primID), ray))
          nearest_hit = {located(s, *hit), hit->t, false};
  }
  nearest_hit.front = nearest_hit.at.surface >= 0 && ray.direction.dot(nearest_hit.at.normal) < 0;
  return nearest_hit;
}

SceneHit Scene::hit(const SurfacePoint& from, const Eigen::Vector3d& direction) const {
  const Offset offset = offset_of(*shapes_[from.surface]);
  const RTCRayHit query =
      nearest(embree_->scene, from.x + offset.lift * extent_ * from.normal, direction, offset.skip * extent_);
  if (query.hit.geomID == RTC_INVALID_GEOMETRY_ID) return {};
  const int surface = static_cast<int>(query.hit.geomID);
  if (surface == from.surface && !shapes_[surface]->sees_itself()) return {};
  ShapeHit at;
  at.t = query.ray.tfar, at.u = query.hit.u, at.v = query.hit.v;
  at.face = static_cast<int>(query.hit.primID), at.b1 = query.hit.u, at.b2 = query.hit.v;
  SceneHit hit{located(surface, at), at.t, false};
  hit.front = direction.dot(hit.at.normal) < 0;
  return hit;
}

bool Scene::visible(const SurfacePoint& from, const Eigen::Vector3d& to, int other, bool behind) const {
  bool clear = !behind;  // what encloses both ends does not stand between them, nor does what an end lies on
  for (int s = 0; s < size() && clear; ++s) {
    const Shape& shape = *shapes_[s];
    const bool own_end = s == from.surface || s == other;
    clear = (own_end && shape.form() == Shape::Form::kFlat) ||
            (s == from.surface && shape.form() == Shape::Form::kBulging) ||
            (shape.encloses(from.x) && shape.encloses(to));
  }
  if (clear) return true;
  const Offset offset = offset_of(*shapes_[from.surface]);
  const Eigen::Vector3d origin = from.x + (behind ? -1 : 1) * offset.lift * extent_ * from.normal, line = to - origin;
  RTCRay ray{};
  start(ray, origin, line, offset.skip * extent_);
  const double end = other < 0 ? 0 : std::max(1e-5, offset_of(*shapes_[other]).skip * extent_ / line.norm());
  ray.tfar = static_cast<float>(1 - end);
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  rtcOccluded1(embree_->scene, &context, &ray);
  return ray.tfar >= 0;
}

double Scene::distance(int surface, const Eigen::Vector3d& x) const {
  double nearest2 = HUGE_VAL;
  for (const Eigen::Vector3d& y : samples_[surface]) nearest2 = std::min(nearest2, (x - y).squaredNorm());
  return std::sqrt(nearest2);
}

Eigen::Vector3d cosine_direction(const Eigen::Vector3d& normal, const Eigen::Vector3d& tangent, double a, double b) {
  const double x = 2 * a - 1, y = 2 * b - 1;
  double radius = 0, angle = 0;
  if (std::abs(x) > std::abs(y))
    radius = x, angle = std::numbers::pi / 4 * (y / x);
  else if (y != 0)
    radius = y, angle = std::numbers::pi / 2 - std::numbers::pi / 4 * (x / y);
  const double p = radius * std::cos(angle), q = radius * std::sin(angle);
  const Eigen::Vector3d t = tangent.normalized(), s = normal.cross(t);
  return p * t + q * s + std::sqrt(std::max(0.0, 1 - p * p - q * q)) * normal;
}

}  // namespace countershade::simdata
