#include "simdata/room/room_check.h"

#include <algorithm>
#include <cmath>

#include "simdata/device/device_check.h"

namespace countershade::simdata {

namespace {

Result<void> within(const std::string& name, double value, double low, double high) {
  if (value >= low && value <= high) return {};  // false for NaN
  return error(ErrorCode::kBadValue, "[simulation] {} = {} is outside {} to {}", name, value, low, high);
}

Result<void> check_walls(const Simulation& s) {
  if (s.room != "two-wall")
    return error(ErrorCode::kUnsupported, "[simulation] room = '{}' cannot be simulated; only 'two-wall' can", s.room);
  CS_TRY_VOID(within("angle_deg", s.angle_deg, 15, 175));
  for (const auto& [name, size] : {std::pair{"left_size", s.left_size}, std::pair{"right_size", s.right_size}})
    for (double metres : size) CS_TRY_VOID(within(name, metres, 1e-3, 1e3));
  CS_TRY_VOID(within("left_rise", s.left_rise, -1e3, 1e3));
  CS_TRY_VOID(within("right_rise", s.right_rise, -1e3, 1e3));
  CS_TRY_VOID(within("texture", s.texture, 0, 0.9));
  for (const auto& [name, albedo] :
       {std::pair{"left_albedo", s.left_albedo}, std::pair{"right_albedo", s.right_albedo}})
    for (double a : albedo) {
      CS_TRY_VOID(within(name, a, 0, 1));
      if (a * (1 + s.texture) > 1)
        return error(ErrorCode::kBadValue, "[simulation] {} {} with texture {} reflects more light than arrives", name,
                     a, s.texture);
    }
  CS_TRY_VOID(within("ambient", s.ambient, 0, 100));
  CS_TRY_VOID(within("samples", s.samples, 16, 1 << 22));
  return within("block_px", s.block_px, 1, 4096);
}

Result<void> check_pose(const std::string& what, const std::array<double, 3>& position,
                        const std::array<double, 3>& target) {
  double distance = 0, sideways = 0;
  for (int k = 0; k < 3; ++k) {
    CS_TRY_VOID(within(what + " position", position[k], -1e4, 1e4));
    CS_TRY_VOID(within(what + " target", target[k], -1e4, 1e4));
    distance = std::hypot(distance, target[k] - position[k]);
    if (k != 1) sideways = std::hypot(sideways, target[k] - position[k]);
  }
  if (sideways < 1e-6 * distance || distance == 0)
    return error(ErrorCode::kBadValue, "{} looks straight up or down, or at its own position; move its target", what);
  return {};
}

Result<void> check_camera(const SimulatedCamera& c) {
  const std::string what = "camera '" + c.id + "'";
  CS_TRY_VOID(check_pose(what, c.position, c.target));
  for (int side : c.resolution) CS_TRY_VOID(within(what + " resolution", side, 4, 65535));
  if (c.channels != 1 && c.channels != 3)
    return error(ErrorCode::kBadValue, "[simulation] {} channels = {}; 1 or 3 are possible", what, c.channels);
  CS_TRY_VOID(within(what + " focal_px", c.focal_px, 1, 1e6));
  CS_TRY_VOID(within(what + " full_well_e", c.full_well_e, 1, 1e9));
  CS_TRY_VOID(within(what + " read_noise_e", c.read_noise_e, 0, 1e6));
  CS_TRY_VOID(within(what + " bits", c.bits, 1, 16));
  CS_TRY_VOID(within(what + " white_level", c.white_level, 1e-3, 100));
  CS_TRY_VOID(within(what + " reference_exposure_ms", c.reference_exposure_ms, 1e-6, 1e6));
  CS_TRY_VOID(within(what + " psf_sigma_px", c.psf_sigma_px, 0, 20));
  CS_TRY_VOID(within(what + " vignetting", c.vignetting, 0, 0.99));
  return check_device(c);
}

Result<void> check_projector(const SimulatedProjector& p) {
  const std::string what = "projector '" + p.id + "'";
  CS_TRY_VOID(check_pose(what, p.position, p.target));
  CS_TRY_VOID(within(what + " throw_ratio", p.throw_ratio, 0.1, 20));
  for (double shift : p.lens_shift) CS_TRY_VOID(within(what + " lens_shift", shift, -2, 2));
  CS_TRY_VOID(within(what + " gain", p.gain, 1e-6, 1e6));
  for (double gamma : p.gamma) CS_TRY_VOID(within(what + " gamma", gamma, 0.2, 5));
  CS_TRY_VOID(within(what + " black_level", p.black_level, 0, 0.9));
  CS_TRY_VOID(within(what + " falloff", p.falloff, 0, 0.95));
  CS_TRY_VOID(within(what + " defocus_sigma_px", p.defocus_sigma_px, 0, 20));
  return check_device(p);
}

}  // namespace

Result<void> check_room(const Rig& rig, const Simulation& simulation) {
  CS_TRY_VOID(check_walls(simulation));
  for (const CameraSpec& spec : rig.cameras) {
    const auto found = std::find_if(simulation.cameras.begin(), simulation.cameras.end(),
                                    [&](const SimulatedCamera& c) { return c.id == spec.id; });
    if (found == simulation.cameras.end())
      return error(ErrorCode::kBadValue, "camera '{}' has no [[simulation.camera]] with that id; add one", spec.id);
    CS_TRY_VOID(check_camera(*found));
  }
  for (const ProjectorSpec& spec : rig.projectors) {
    const auto found = std::find_if(simulation.projectors.begin(), simulation.projectors.end(),
                                    [&](const SimulatedProjector& p) { return p.id == spec.id; });
    if (found == simulation.projectors.end())
      return error(ErrorCode::kBadValue, "projector '{}' has no [[simulation.projector]] with that id; add one",
                   spec.id);
    CS_TRY_VOID(check_projector(*found));
    for (int side : spec.resolution) CS_TRY_VOID(within("projector '" + spec.id + "' resolution", side, 4, 65535));
  }
  if (rig.projectors.empty()) return error(ErrorCode::kBadValue, "the rig has no projector; add a [[projector]]");
  return {};
}

}  // namespace countershade::simdata
