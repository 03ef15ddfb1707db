#include "simdata/render/scene.h"

#include <embree3/rtcore.h>

#include <cmath>
#include <limits>
#include <numbers>

namespace countershade::simdata {

struct Scene::Embree {
  RTCDevice device = nullptr;
  RTCScene scene = nullptr;
  ~Embree() {
    if (scene) rtcReleaseScene(scene);
    if (device) rtcReleaseDevice(device);
  }
  void add(const PlaneSurface& plane) const {
    RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_QUAD);
    auto* corner = static_cast<float*>(
        rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 3 * sizeof(float), 4));
    auto* index = static_cast<unsigned*>(
        rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT4, 4 * sizeof(unsigned), 1));
    const Eigen::Vector3d corners[4] = {plane.point(0, 0), plane.point(1, 0), plane.point(1, 1), plane.point(0, 1)};
    for (int i = 0; i < 4; ++i) {
      index[i] = i;
      for (int k = 0; k < 3; ++k) corner[3 * i + k] = static_cast<float>(corners[i][k]);
    }
    rtcCommitGeometry(geometry);
    rtcAttachGeometry(scene, geometry);
    rtcReleaseGeometry(geometry);
  }
};

Scene::Scene(Screen screen, std::unique_ptr<Embree> embree) : screen_(std::move(screen)), embree_(std::move(embree)) {
  before_.assign(screen_.size(), std::vector<char>(screen_.size(), 1));
  for (int a = 0; a < screen_.size(); ++a)
    for (int b = 0; b < screen_.size(); ++b)
      for (const auto& [u, v] : {std::pair{0, 0}, {1, 0}, {1, 1}, {0, 1}})
        if ((plane(a).point(u, v) - plane(b).origin()).dot(plane(b).normal(0, 0)) < -1e-9) before_[a][b] = 0;
}
Scene::~Scene() = default;

Result<std::shared_ptr<const Scene>> Scene::make(const Screen& screen) {
  auto embree = std::make_unique<Embree>();
  // Embree's number of threads holds for all of TBB in this process: the default is all cores.
  embree->device = rtcNewDevice(nullptr);
  if (!embree->device) return error(ErrorCode::kUnsupported, "Embree does not start on this processor");
  embree->scene = rtcNewScene(embree->device);
  rtcSetSceneFlags(embree->scene, RTC_SCENE_FLAG_ROBUST);
  for (const auto& surface : screen.surfaces) {
    const auto* plane = dynamic_cast<const PlaneSurface*>(surface.get());
    if (!plane) return error(ErrorCode::kUnsupported, "simulated rooms have plane walls only");
    embree->add(*plane);
  }
  rtcCommitScene(embree->scene);
  return std::shared_ptr<const Scene>(new Scene(screen, std::move(embree)));
}

namespace {

// A ray that starts a hair above its own wall: single precision would let a grazing one meet it again.
template <class Ray>
void start(Ray& ray, const Eigen::Vector3d& from, const Eigen::Vector3d& normal, const Eigen::Vector3d& direction) {
  const Eigen::Vector3d origin = from + 1e-6 * normal;
  ray.org_x = static_cast<float>(origin.x()), ray.org_y = static_cast<float>(origin.y());
  ray.org_z = static_cast<float>(origin.z());
  ray.dir_x = static_cast<float>(direction.x()), ray.dir_y = static_cast<float>(direction.y());
  ray.dir_z = static_cast<float>(direction.z());
  ray.tnear = 1e-6f;
  ray.time = 0;
  ray.mask = ~0u;
  ray.id = ray.flags = 0;
}

}  // namespace

SceneHit Scene::hit(int own, const Eigen::Vector3d& from, const Eigen::Vector3d& direction) const {
  RTCRayHit query{};
  start(query.ray, from, plane(own).normal(0, 0), direction);
  query.ray.tfar = std::numeric_limits<float>::infinity();
  query.hit.geomID = RTC_INVALID_GEOMETRY_ID;
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  rtcIntersect1(embree_->scene, &context, &query);
  if (query.hit.geomID == RTC_INVALID_GEOMETRY_ID) return {};
  const int surface = static_cast<int>(query.hit.geomID);
  if (surface == own) return {};
  return {{surface, query.hit.u, query.hit.v}, direction.dot(plane(surface).normal(0, 0)) < 0};
}

bool Scene::visible(int own, const Eigen::Vector3d& from, const Eigen::Vector3d& to, int other) const {
  bool clear = true;  // both ends before a plane: it cannot stand between them
  for (int s = 0; s < screen_.size(); ++s)
    clear &= s == own || s == other || (before_[own][s] && (to - plane(s).origin()).dot(plane(s).normal(0, 0)) > 0);
  if (clear) return true;
  RTCRay ray{};
  start(ray, from, plane(own).normal(0, 0), to - from);
  ray.tfar = other < 0 ? 1.0f : 1 - 1e-5f;
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  rtcOccluded1(embree_->scene, &context, &ray);
  return ray.tfar >= 0;
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
