#include "simdata/room/framing.h"

#include <cmath>

namespace countershade::simdata {

std::array<double, 3> array(const Eigen::Vector3d& v) {
  return {v.x(), v.y(), v.z()};
}

double rounded(double value, double unit) {
  return std::round(value / unit) / std::round(1 / unit);
}

void round_numbers(Simulation& s) {
  for (SimulatedCamera& c : s.cameras) {
    for (int k = 0; k < 3; ++k) c.position[k] = rounded(c.position[k], 1e-3), c.target[k] = rounded(c.target[k], 1e-3);
    c.focal_px = rounded(c.focal_px, 0.1);
  }
  for (SimulatedProjector& p : s.projectors)
    for (int k = 0; k < 3; ++k) p.position[k] = rounded(p.position[k], 1e-3), p.target[k] = rounded(p.target[k], 1e-3);
}

std::optional<Box> box_of(const Device& device, const std::vector<Eigen::Vector3d>& points) {
  Box box;
  for (const Eigen::Vector3d& x : points) {
    const Eigen::Vector2d q = device.project(x);
    if (!q.allFinite()) return std::nullopt;
    box.low = box.low.cwiseMin(q), box.high = box.high.cwiseMax(q);
  }
  return box;
}

std::array<double, 3> turned(const Device& device, const Eigen::Vector2d& move, double distance) {
  const std::vector<double>& k = device.lens.intrinsics();
  const Ray ray = device.ray({k[2] + move.x(), k[3] + move.y()});
  return array(ray.origin + distance * ray.direction);
}

namespace {

Eigen::Vector3d middle_of(const std::vector<Eigen::Vector3d>& points) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3d& x : points) sum += x;
  return sum / static_cast<double>(points.size());
}

}  // namespace

bool aim_camera(const std::vector<Eigen::Vector3d>& points, SimulatedCamera& c) {
  c.target = array(middle_of(points));
  const Eigen::Vector2d picture(c.resolution[0], c.resolution[1]);
  for (int i = 0; i < 100; ++i) {
    Simulation probe;
    probe.cameras = {c};
    const Device device = true_camera(probe, c.id).value();
    const auto box = box_of(device, points);
    if (!box) return false;
    c.focal_px *= (0.96 * picture.array() / (box->high - box->low).array()).minCoeff();
    c.target = turned(device, (box->low + box->high - picture + Eigen::Vector2d::Ones()) / 2, 4);
    if (!std::isfinite(c.target[0]) || !(c.focal_px > 100)) return false;
  }
  return true;
}

bool aim_projector(const std::vector<Eigen::Vector3d>& points, const Rig& rig, SimulatedProjector& p) {
  p.target = array(middle_of(points));
  const ProjectorSpec& spec = *rig.projector(p.id);
  const Eigen::Vector2d picture(spec.resolution[0], spec.resolution[1]);
  for (int i = 0; i < 100; ++i) {
    Simulation probe;
    probe.projectors = {p};
    const Device device = true_projector(probe, rig, p.id).value();
    const auto box = box_of(device, points);
    if (!box) return false;
    p.throw_ratio *= (0.98 * picture.array() / (box->high - box->low).array()).minCoeff();
    p.target = turned(device, (box->low + box->high - picture + Eigen::Vector2d::Ones()) / 2, 3);
    if (!std::isfinite(p.target[0]) || !(p.throw_ratio > 0.1 && p.throw_ratio < 20)) return false;
  }
  p.throw_ratio = rounded(p.throw_ratio, 1e-4);
  return true;
}

RigAndRoom blank_room(const std::vector<std::string>& projector_ids) {
  RigAndRoom made;
  CameraSpec camera;
  camera.id = "camera";
  camera.backend = "simulated";
  camera.model = "camera.cameramodel";
  camera.full_scale = 4095;
  made.rig.cameras = {camera};
  SimulatedCamera true_camera;
  true_camera.id = camera.id;
  made.simulation.cameras = {true_camera};
  for (const std::string& id : projector_ids) {
    ProjectorSpec spec;
    spec.id = id;
    spec.resolution = {1280, 800};
    spec.black_level = 0.001;
    made.rig.projectors.push_back(spec);
    SimulatedProjector projector;
    projector.id = id;
    made.simulation.projectors.push_back(projector);
  }
  return made;
}

}  // namespace countershade::simdata
