#include "simdata/room/room_check.h"

#include <cmath>

namespace countershade::simdata {

namespace {

Result<void> check_surface(const SimulatedSurface& s) {
  const std::string what = "surface '" + s.id + "'";
  const double most = (1 + s.texture) * (1 + s.patchwork);
  for (double a : s.albedo) {
    if (a * most > 1)
      return error(ErrorCode::kBadValue,
                   "[simulation] {}: albedo {} times texture and patchwork is {:.3f} at most; more light than arrives "
                   "cannot be reflected: lower one of them",
                   what, a, a * most);
    if (a * most * (1 + s.transmission) > 1 && s.transmission > 0)
      return error(
          ErrorCode::kBadValue,
          "[simulation] {}: albedo {} and a transmission of {} albedos make more light than arrives; lower one "
          "of them",
          what, a * most, s.transmission);
  }
  return {};
}

Result<void> check_walls(const Simulation& s) {
  if (s.surfaces.empty())
    return error(ErrorCode::kBadValue,
                 "[simulation] has no surface, so there is no room; add a [[simulation.surface]] (`countershade new "
                 "two-wall` writes two)");
  if (s.surfaces.size() > 100)
    return error(ErrorCode::kBadValue, "[simulation] has {} surfaces; at most 100 are possible: join them to a mesh",
                 s.surfaces.size());
  for (const SimulatedSurface& surface : s.surfaces) CS_TRY_VOID(check_surface(surface));
  return {};
}

Result<void> check_pose(const std::string& what, const std::array<double, 3>& position,
                        const std::array<double, 3>& target) {
  double sideways = 0, distance = 0;
  for (int k = 0; k < 3; ++k) {
    distance = std::hypot(distance, target[k] - position[k]);
    if (k != 1) sideways = std::hypot(sideways, target[k] - position[k]);
  }
  if (!(sideways > 1e-6 * distance))
    return error(ErrorCode::kBadValue, "{} looks straight up or down; move its target aside", what);
  return {};
}

Result<void> check_pixels(const std::string& what, const std::array<int, 2>& size, int most_millions) {
  if (static_cast<double>(size[0]) * size[1] <= 1e6 * most_millions) return {};
  return error(ErrorCode::kBadValue,
               "[simulation] {} has {} x {} pixels; {} million are the most that can be simulated: take a smaller "
               "resolution",
               what, size[0], size[1], most_millions);
}

// The one that is called like a device of the rig.
template <class Device>
Result<const Device*> named(const std::vector<Device>& all, const char* kind, const std::string& id) {
  for (const Device& device : all)
    if (device.id == id) return &device;
  return error(ErrorCode::kBadValue, "{0} '{1}' has no [[simulation.{0}]] with that id; add one", kind, id);
}

}  // namespace

Result<void> check_room(const Rig& rig, const Simulation& simulation) {
  CS_TRY_VOID(check_values(simulation));
  CS_TRY_VOID(check_walls(simulation));
  for (const SimulatedSurface& s : simulation.surfaces)
    if (simulation.ambient_swing > 0 && s.daylight > 0)
      return error(
          ErrorCode::kBadValue,
          "[simulation] ambient_swing = {}, and [[simulation.surface]] '{}' has daylight = {}: the sun does not "
          "swing, and the simulator takes both for one light; set one of them to 0",
          simulation.ambient_swing, s.id, s.daylight);
  for (const CameraSpec& spec : rig.cameras) {
    const std::string what = "camera '" + spec.id + "'";
    CS_TRY(const SimulatedCamera* c, named(simulation.cameras, "camera", spec.id));
    CS_TRY_VOID(check_pose(what, c->position, c->target));
    CS_TRY_VOID(check_pixels(what, c->resolution, 32));
  }
  for (const ProjectorSpec& spec : rig.projectors) {
    const std::string what = "projector '" + spec.id + "'";
    CS_TRY(const SimulatedProjector* p, named(simulation.projectors, "projector", spec.id));
    CS_TRY_VOID(check_pose(what, p->position, p->target));
    for (const std::array<int, 2>& size : {spec.resolution, p->native_resolution})
      CS_TRY_VOID(check_pixels(what, size, 16));
    for (int side : spec.resolution)
      if (side < 4)
        return error(ErrorCode::kBadValue, "[simulation] {} is {} x {} pixels; at least 4 x 4 can be simulated", what,
                     spec.resolution[0], spec.resolution[1]);
  }
  if (rig.projectors.empty()) return error(ErrorCode::kBadValue, "the rig has no projector; add a [[projector]]");
  return {};
}

}  // namespace countershade::simdata
