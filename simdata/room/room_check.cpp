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

Result<void> check_surface(const SimulatedSurface& s) {
  const std::string what = "surface '" + s.id + "'";
  for (double v : s.origin) CS_TRY_VOID(within(what + " origin", v, -1e3, 1e3));
  for (double v : s.along_u) CS_TRY_VOID(within(what + " along_u", v, -1e3, 1e3));
  for (double v : s.along_v) CS_TRY_VOID(within(what + " along_v", v, -1e3, 1e3));
  CS_TRY_VOID(within(what + " radius", s.radius, 1e-3, 1e3));
  CS_TRY_VOID(within(what + " top_radius", s.top_radius, 0, 1e3));
  CS_TRY_VOID(within(what + " height", s.height, 1e-3, 1e3));
  CS_TRY_VOID(within(what + " azimuth_deg", s.azimuth_deg[1] - s.azimuth_deg[0], 1e-3, 360));
  CS_TRY_VOID(within(what + " elevation_deg", s.elevation_deg[1] - s.elevation_deg[0], 1e-3, 180));
  CS_TRY_VOID(within(what + " texture", s.texture, 0, 0.9));
  CS_TRY_VOID(within(what + " patchwork", s.patchwork, 0, 0.9));
  CS_TRY_VOID(within(what + " gloss", s.gloss, 0, 1));
  CS_TRY_VOID(within(what + " roughness", s.roughness, 0.1, 1));
  CS_TRY_VOID(within(what + " directing", s.directing, 0, 100));
  for (double tilt : s.directing_tilt_deg) CS_TRY_VOID(within(what + " directing_tilt_deg", tilt, -60, 60));
  CS_TRY_VOID(within(what + " transmission", s.transmission, 0, 100));
  CS_TRY_VOID(within(what + " daylight", s.daylight, 0, 100));
  const double most = (1 + s.texture) * (1 + s.patchwork);
  for (double a : s.albedo) {
    CS_TRY_VOID(within(what + " albedo", a, 0, 1));
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
  CS_TRY_VOID(within("ambient", s.ambient, 0, 100));
  CS_TRY_VOID(within("samples", s.samples, 16, 65536));
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
  if (static_cast<double>(c.resolution[0]) * c.resolution[1] > 32e6)
    return error(ErrorCode::kBadValue,
                 "[simulation] {} has {} x {} pixels; 32 million are the most that can be simulated: take a smaller "
                 "resolution",
                 what, c.resolution[0], c.resolution[1]);
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
    for (const std::array<int, 2>& size : {spec.resolution, found->native_resolution})
      if (static_cast<double>(size[0]) * size[1] > 16e6)
        return error(ErrorCode::kBadValue,
                     "projector '{}' has {} x {} pixels; 16 million are the most that can be simulated: take a smaller "
                     "resolution",
                     spec.id, size[0], size[1]);
  }
  if (rig.projectors.empty()) return error(ErrorCode::kBadValue, "the rig has no projector; add a [[projector]]");
  return {};
}

}  // namespace countershade::simdata
