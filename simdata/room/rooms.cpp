#include "simdata/room/rooms.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "simdata/device/device_lens.h"

namespace countershade::simdata {

namespace {

double radians(double degrees) {
  return degrees * std::numbers::pi / 180;
}
Eigen::Vector3d vector(const std::array<double, 3>& a) {
  return {a[0], a[1], a[2]};
}

}  // namespace

Screen room_screen(const Simulation& s) {
  Screen screen;
  for (const SimulatedSurface& surface : s.surfaces) {
    if (surface.shape != "rectangle") return {};
    const Eigen::Vector3d u = vector(surface.along_u), v = vector(surface.along_v);
    if (!(u.cross(v).norm() > 0)) return {};
    screen.surfaces.push_back(std::make_shared<PlaneSurface>(vector(surface.origin), u, v));
  }
  for (int a = 0; a < screen.size(); ++a)
    for (int b = 0; b < screen.size(); ++b) {
      const Surface &left = *screen.surfaces[a], &right = *screen.surfaces[b];
      const double near = 1e-6 * (left.point(1, 0) - left.point(0, 1)).norm();
      if (a == b || (left.point(1, 0) - right.point(0, 0)).norm() > near ||
          (left.point(1, 1) - right.point(0, 1)).norm() > near)
        continue;
      const Eigen::Vector3d to_left = (left.point(0, 0) - left.point(1, 0)).normalized(),
                            to_right = (right.point(1, 0) - right.point(0, 0)).normalized();
      screen.creases.push_back({a, b, 1, 0, std::acos(std::clamp(to_left.dot(to_right), -1.0, 1.0))});
    }
  return screen;
}

double edge_angle_deg(const Simulation& s) {
  const Screen screen = room_screen(s);
  if (screen.size() < 2) return std::nan("");
  const double cosine = -screen.surfaces[0]->normal(0, 0).dot(screen.surfaces[1]->normal(0, 0));
  return std::acos(std::clamp(cosine, -1.0, 1.0)) * 180 / std::numbers::pi;
}

std::vector<SimulatedSurface> surfaces_of(const TwoWalls& w) {
  const double half = radians(w.angle_deg) / 2;
  const auto rounded = [](double x) { return std::round(x * 1e5) / 1e5; };
  std::vector<SimulatedSurface> walls(2);
  SimulatedSurface &left = walls[0], &right = walls[1];
  left.id = "left-wall", right.id = "right-wall";
  const double lx = rounded(w.left_size[0] * std::sin(half)), lz = rounded(w.left_size[0] * std::cos(half));
  left.origin = {-lx, w.left_rise, lz}, left.along_u = {lx, 0, -lz}, left.along_v = {0, w.left_size[1], 0};
  const double rx = rounded(w.right_size[0] * std::sin(half)), rz = rounded(w.right_size[0] * std::cos(half));
  right.origin = {0, w.right_rise, 0}, right.along_u = {rx, 0, rz}, right.along_v = {0, w.right_size[1], 0};
  left.albedo = w.left_albedo, right.albedo = w.right_albedo;
  return walls;
}

Result<Device> true_camera(const Simulation& simulation, const std::string& id) {
  for (const SimulatedCamera& c : simulation.cameras) {
    if (c.id != id) continue;
    CS_TRY(const Lens lens, camera_lens(c));
    return Device{lens, look_at(vector(c.position), vector(c.target), {0, 1, 0}, radians(c.roll_deg))};
  }
  return error(ErrorCode::kBadValue, "camera '{}' has no [[simulation.camera]] with that id; add one", id);
}

Result<Device> true_projector(const Simulation& simulation, const Rig& rig, const std::string& id) {
  const ProjectorSpec* spec = rig.projector(id);
  for (const SimulatedProjector& p : simulation.projectors) {
    if (p.id != id || !spec) continue;
    CS_TRY(const Lens lens, projector_lens(p, spec->resolution[0], spec->resolution[1]));
    return Device{lens, look_at(vector(p.position), vector(p.target), {0, 1, 0}, radians(p.roll_deg))};
  }
  return error(ErrorCode::kBadValue, "projector '{}' is not in both the rig and [[simulation.projector]]; add it", id);
}

RigAndRoom smaller(RigAndRoom room, int divisor, int projector_divisor, int samples) {
  for (SimulatedCamera& camera : room.simulation.cameras) {
    camera.focal_px /= divisor;
    for (int i = 0; i < 2; ++i) {
      camera.resolution[i] /= divisor;
      camera.principal[i] = (camera.principal[i] + 0.5) / divisor - 0.5;
    }
  }
  for (ProjectorSpec& p : room.rig.projectors)
    for (int& side : p.resolution) side /= projector_divisor;
  room.simulation.samples = samples;
  return room;
}

RigAndRoom small_two_wall(int divisor, std::array<int, 2> projector_resolution, int samples) {
  RigAndRoom room = smaller(default_two_wall(), divisor, 1, samples);
  for (ProjectorSpec& p : room.rig.projectors) p.resolution = projector_resolution;
  return room;
}

}  // namespace countershade::simdata
