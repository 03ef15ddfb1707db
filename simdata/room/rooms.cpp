#include "simdata/room/rooms.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "simdata/device/device_check.h"

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
  const double half = radians(s.angle_deg) / 2;
  const Eigen::Vector3d left(-std::sin(half), 0, std::cos(half)), right(std::sin(half), 0, std::cos(half));
  const Eigen::Vector3d up(0, 1, 0);
  Screen screen;
  screen.surfaces.push_back(std::make_shared<PlaneSurface>(s.left_size[0] * left + s.left_rise * up,
                                                           -s.left_size[0] * left, s.left_size[1] * up));
  screen.surfaces.push_back(
      std::make_shared<PlaneSurface>(s.right_rise * up, s.right_size[0] * right, s.right_size[1] * up));
  if (s.left_rise == s.right_rise && s.left_size[1] == s.right_size[1])
    screen.creases.push_back({0, 1, 1, 0, radians(s.angle_deg)});
  return screen;
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

RigAndRoom small_two_wall(int divisor, std::array<int, 2> projector_resolution, int samples) {
  RigAndRoom room = default_two_wall();
  SimulatedCamera& camera = room.simulation.cameras[0];
  camera.focal_px /= divisor;
  for (int i = 0; i < 2; ++i) {
    camera.resolution[i] /= divisor;
    camera.principal[i] = (camera.principal[i] + 0.5) / divisor - 0.5;
  }
  for (ProjectorSpec& p : room.rig.projectors) p.resolution = projector_resolution;
  room.simulation.samples = samples;
  return room;
}

}  // namespace countershade::simdata
