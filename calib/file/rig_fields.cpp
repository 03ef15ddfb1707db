#include "calib/file/rig_fields.h"

namespace countershade::fields {

namespace {

Rule any() {
  return {};
}

Rule between(double low, double high) {
  Rule rule;
  rule.low = low;
  rule.high = high;
  return rule;
}

Rule at_least(double low) {
  return between(low, std::numeric_limits<double>::infinity());
}

Rule more_than(double low, double high = std::numeric_limits<double>::infinity()) {
  Rule rule = between(low, high);
  rule.low_is_open = true;
  return rule;
}

Rule one_of(std::vector<double> allowed) {
  Rule rule;
  rule.allowed = std::move(allowed);
  return rule;
}

Rule text(std::vector<std::string> ready, std::vector<std::string> later = {}) {
  Rule rule;
  rule.ready = std::move(ready);
  rule.later = std::move(later);
  return rule;
}

Rule response() {
  Rule rule;
  rule.text = Rule::Text::kResponse;
  return rule;
}

Rule id() {
  Rule rule;
  rule.text = Rule::Text::kId;
  rule.mandatory = true;
  return rule;
}

Rule mandatory(Rule rule) {
  rule.mandatory = true;
  return rule;
}

Rule seldom(Rule rule) {
  rule.seldom = true;
  return rule;
}

// Bounds that only catch slips of the pen: places within a kilometre, pictures that a device can have.
const double kFar = 1000, kMostPixels = 32768;

}  // namespace

Fields fields_of(CameraSpec& c) {
  return {
      {"id", &c.id, id(), "name; its photos are stored under it"},
      {"backend", &c.backend, text({"folder", "simulated", "aravis", "v4l2", "libcamera", "command"}),
       "who takes the photos: folder | simulated | aravis (GigE Vision, USB3 Vision) | v4l2 | libcamera | command"},
      {"device", &c.device, any(),
       "a folder's path; of aravis serial number, IP address or name; a command with {file} in it", "the only one",
       "\"photos\""},
      {"model", &c.model, any(), "its lens, an mrcal .cameramodel, path relative to this file", "not known",
       "\"camera.cameramodel\""},
      {"pose", &c.pose, text({"unknown"}, {"known"}), "unknown | known: the model's extrinsics count"},
      {"exposures_ms", &c.exposures_ms, more_than(0, 1e6), "[ms], several are merged", "the device's own",
       "[8.0, 32.0]"},
      {"response", &c.response, response(), "stored value to light: linear | srgb | gamma:2.2"},
      {"pedestal", &c.pedestal, at_least(0), "stored value of no light"},
      {"full_scale", &c.full_scale, more_than(0), "stored value of saturation", "the file type's maximum", "65520.0"},
  };
}

Fields fields_of(ProjectorSpec& p) {
  return {
      {"id", &p.id, id(), "name; its pictures are stored under it"},
      {"resolution", &p.resolution, mandatory(between(1, kMostPixels)), "width, height [px]; never scaled"},
      {"output", &p.output, text({"simulated", "window", "folder"}), "where it shows: simulated | window | folder"},
      {"monitor", &p.monitor, any(), "display of the window, as `devices` lists it", "none", "\"HDMI-1\""},
      {"response", &p.response, response(), "encoded value to light: linear | srgb | gamma:2.2"},
      {"black_level", &p.black_level, between(0, 0.9), "light of black, fraction of white (1 / contrast)"},
      {"throw_ratio", &p.throw_ratio, more_than(0, 100), "distance / picture width", "estimated", "1.5"},
      {"throw_ratio_sigma", &p.throw_ratio_sigma, more_than(0, 10), "how well it is known, relative"},
      {"lens_shift", &p.lens_shift, between(-5, 5),
       "picture's centre off the lens axis, right and down, in picture sizes", "estimated", "[0.0, -0.5]"},
      {"lens_shift_sigma", &p.lens_shift_sigma, more_than(0, 10), "how well it is known, in picture sizes"},
      {"model", &p.model, any(), "whole lens, a .cameramodel, path relative to this file", "estimated",
       "\"projector.cameramodel\""},
  };
}

Fields fields_of(ScreenSpec& s) {
  return {
      {"kind", &s.kind, text({"measured", "planes"}, {"cylinder", "dome", "mesh"}),
       "measured by structured light | planes"},
      {"planes", &s.planes, between(0, 64), "number of planes, 0 = found"},
      {"patches", Patches{&s.patches}, between(1, 4096), "\"auto\", or patches per surface [along u, along v]"},
      {"known_length", &s.known_length, any(), "two pixels of the first camera, metres between what they see",
       "size of the room unknown", "{ pixel_a = [310.0, 420.0], pixel_b = [1520.0, 440.0], metres = 2.5 }"},
  };
}

Fields fields_of(ScreenSpec::KnownLength& k) {
  return {
      {"pixel_a", &k.pixel_a, mandatory(between(-0.5, kMostPixels)), "x, y [camera px]"},
      {"pixel_b", &k.pixel_b, mandatory(between(-0.5, kMostPixels)), "x, y [camera px]"},
      {"metres", &k.metres, mandatory(more_than(0, kFar)), "distance of the screen points under them [m]"},
  };
}

Fields fields_of(BoardSpec& b) {
  return {
      {"kind", &b.kind, mandatory(text({"chessboard", "apriltag", "charuco"})), "chessboard | apriltag | charuco",
       "no board", "\"chessboard\""},
      {"corners", &b.corners, between(2, 1000), "inner corners along width and height"},
      {"square", &b.square, more_than(0, kFar), "side of a square [m]"},
  };
}

Fields intent_of(Rig& r) {
  return {{"target", &r.target, text({"direct"}, {"uniform"}), "direct: each picture as if no light bounced"}};
}

Fields fields_of(Simulation& s) {
  return {
      {"room", &s.room, any(), "what the room is called"},
      {"ambient", &s.ambient, between(0, 10), "radiance of the surround, fraction of reference white"},
      {"ambient_swing", &s.ambient_swing, seldom(between(0, 1)), "share by which it swings: lamps on the mains"},
      {"ambient_hz", &s.ambient_hz, seldom(between(0.01, 1e5)), "how often a second; twice the mains' frequency"},
      {"seed", &s.seed, any(), "all noise follows from it"},
      {"samples", &s.samples, between(16, 65536), "strata by which a point looks at the room; time grows with it"},
      {"block_px", &s.block_px, between(1, 4096), "projector pixels per block of indirect light"},
  };
}

namespace {

Fields shape_of(SimulatedSurface& s) {
  const Field origin{"origin", &s.origin, between(-kFar, kFar), "its corner u = v = 0 [m]"};
  const Field azimuth{"azimuth_deg", &s.azimuth_deg, between(-360, 360),
                      "from, to; 0 = straight ahead (-z), 90 = right (+x)"};
  const Field lit{"lit", &s.lit, text({"inside", "outside"}), "inside | outside: the side that is lit"};
  const Field radius{"radius", &s.radius, between(1e-3, kFar), "[m]"};
  const Field height{"height", &s.height, between(1e-3, kFar), "[m]"};
  const auto placed = [&](const char* meaning) {
    Field f = origin;
    f.comment = meaning;
    return f;
  };
  if (s.shape == "cylinder") return {placed("centre of the lower circle [m]"), radius, height, azimuth, lit};
  if (s.shape == "cone")
    return {placed("centre of the lower circle [m]"),
            radius,
            {"top_radius", &s.top_radius, between(0, kFar), "of the upper circle [m]"},
            height,
            azimuth,
            lit};
  if (s.shape == "sphere")
    return {placed("centre [m]"),
            radius,
            azimuth,
            {"elevation_deg", &s.elevation_deg, between(-90, 90), "from, to; 90 = zenith"},
            lit};
  if (s.shape == "mesh")
    return {{"mesh", &s.mesh, mandatory(any()), "OBJ or PLY, at most 20,000 triangles, path relative to this file", "",
             "\"room.obj\""},
            {"mesh_scale", &s.mesh_scale, more_than(0, 1e6), "metres per unit of the file"},
            placed("where its origin lies [m]")};
  return {origin,
          {"along_u", &s.along_u, between(-kFar, kFar), "its lower side, rightwards as seen from the lit side [m]"},
          {"along_v", &s.along_v, between(-kFar, kFar), "its left side, upwards [m]"}};
}

}  // namespace

Fields fields_of(SimulatedSurface& s) {
  Fields fields{
      {"id", &s.id, id(), "name"},
      {"shape", &s.shape, text({"rectangle", "cylinder", "cone", "sphere", "mesh"}),
       "rectangle | cylinder | cone | sphere | mesh"},
  };
  const Fields shape = shape_of(s),
               paint{
                   {"albedo", &s.albedo, between(0, 1), "diffuse reflectance r, g, b"},
                   {"texture", &s.texture, between(0, 0.9), "amplitude of a smooth albedo variation, fraction"},
                   {"patchwork", &s.patchwork, between(0, 0.9),
                    "amplitude of an albedo that differs by cell, fraction"},
                   {"patchwork_cells", &s.patchwork_cells, between(1, 4096), "cells along u and v"},
                   {"gloss", &s.gloss, between(0, 1), "share of the reflected light in a glossy (GGX) lobe"},
                   {"roughness", &s.roughness, between(0.1, 1), "of that lobe, GGX alpha"},
                   {"directing", &s.directing, between(0, 100), "exponent of a light-directing screen; 0 = diffuse"},
                   {"directing_tilt_deg", &s.directing_tilt_deg, between(-60, 60),
                    "its axis off the normal, along u, v [degrees]"},
                   {"transmission", &s.transmission, between(0, 100),
                    "rear projection: light that passes / that is reflected"},
                   {"daylight", &s.daylight, between(0, 100), "irradiance of a sunlit patch, 1 = reference"},
                   {"daylight_from", &s.daylight_from, between(0, 1), "its corner u, v"},
                   {"daylight_to", &s.daylight_to, between(0, 1), "its other corner u, v"},
               };
  fields.insert(fields.end(), shape.begin(), shape.end());
  fields.insert(fields.end(), paint.begin(), paint.end());
  return fields;
}

Fields fields_of(SimulatedCamera& c) {
  return {
      {"id", &c.id, id(), "the [[camera]] that this is the truth of"},
      {"position", &c.position, between(-kFar, kFar), "x right, y up, z towards the audience [m]"},
      {"target", &c.target, between(-kFar, kFar), "point on its axis [m]"},
      {"roll_deg", &c.roll_deg, between(-360, 360), "turn about its axis [degrees]"},
      {"resolution", &c.resolution, between(4, kMostPixels), "width, height [px]"},
      {"channels", &c.channels, one_of({1, 3}), "1 = grey, 3 = RGB"},
      {"focal_px", &c.focal_px, between(1, 1e6), "focal length [px]"},
      {"principal", &c.principal, between(-kMostPixels, kMostPixels), "principal point [px]", "the picture's centre"},
      {"distortion", &c.distortion, between(-10, 10), "Brown-Conrady k1, k2, p1, p2, k3"},
      {"full_well_e", &c.full_well_e, between(1, 1e9), "full scale [electrons]"},
      {"read_noise_e", &c.read_noise_e, between(0, 1e6), "[electrons]"},
      {"bits", &c.bits, between(1, 16), "bits of a stored value"},
      {"white_level", &c.white_level, between(1e-3, 100), "brightest white / full scale at the reference exposure"},
      {"reference_exposure_ms", &c.reference_exposure_ms, between(1e-6, 1e6), "[ms]"},
      {"psf_sigma_px", &c.psf_sigma_px, between(0, 20), "blur [px]"},
      {"vignetting", &c.vignetting, between(0, 0.99), "loss at the picture's corner, fraction"},
      {"lens", &c.lens, any(), "mrcal .cameramodel, path relative to this file, of any lens",
       "focal_px, principal, distortion", "\"true_camera.cameramodel\""},
      {"veiling_glare", &c.veiling_glare, seldom(between(0, 1)), "share of the photo's mean light that lies over it"},
      {"bayer", &c.bayer, seldom(text({"none", "RGGB", "GRBG", "GBRG", "BGGR"})),
       "one colour per pixel, the rest interpolated: none | RGGB | GRBG | GBRG | BGGR"},
      {"hot_pixels", &c.hot_pixels, seldom(between(0, 1e6)), "pixels with a dark signal of their own"},
      {"rolling_shutter_ms", &c.rolling_shutter_ms, seldom(between(0, 1e4)), "first row's start to last row's [ms]"},
      {"auto_exposure", &c.auto_exposure, seldom(between(0, 1)), "0 = locked, 1 = always to a mean of 18 %"},
      {"timestamp_offset_ms", &c.timestamp_offset_ms, seldom(between(-1e9, 1e9)), "of the camera's clock [ms]"},
      {"clock_drift_ppm", &c.clock_drift_ppm, seldom(between(-1e5, 1e5)), "how much faster its clock runs [1e-6]"},
      {"eye", &c.eye, seldom(text({"both", "left", "right"})), "through shutter glasses: both | left | right"},
      {"glasses_leak", &c.glasses_leak, seldom(between(0, 1)), "light that a closed glass lets through, fraction"},
  };
}

Fields fields_of(SimulatedProjector& p) {
  return {
      {"id", &p.id, id(), "the [[projector]] that this is the truth of"},
      {"position", &p.position, between(-kFar, kFar), "x right, y up, z towards the audience [m]"},
      {"target", &p.target, between(-kFar, kFar), "point on its axis [m]"},
      {"roll_deg", &p.roll_deg, between(-360, 360), "turn about its axis [degrees]"},
      {"throw_ratio", &p.throw_ratio, between(0.1, 20), "distance / picture width"},
      {"lens_shift", &p.lens_shift, between(-2, 2), "picture's centre off the axis, right and down, in picture sizes"},
      {"gain", &p.gain, between(1e-6, 1e6), "luminous power beside the others"},
      {"gamma", &p.gamma, between(0.2, 5), "exponent of its response r, g, b"},
      {"black_level", &p.black_level, between(0, 0.9), "1 / contrast"},
      {"falloff", &p.falloff, between(0, 0.95), "loss at the picture's corner, fraction"},
      {"defocus_sigma_px", &p.defocus_sigma_px, between(0, 20), "blur [px]"},
      {"latency_ms", &p.latency_ms, between(0, 1e4), "from sending a picture to its light [ms]"},
      {"aperture_mm", &p.aperture_mm, seldom(between(0, 500)), "its lens blurs beside its focal plane; 0 = nowhere"},
      {"focus_distance", &p.focus_distance, seldom(more_than(0, kFar)), "of that plane along the axis [m]"},
      {"distortion", &p.distortion, seldom(between(-10, 10)), "Brown-Conrady k1, k2, p1, p2, k3"},
      {"response_r", &p.response_r, between(0, 1), "light of red at equally spaced values, 2 or more", "gamma",
       "[0.0, 0.2, 1.0]"},
      {"response_g", &p.response_g, between(0, 1), "light of green", "gamma", "[0.0, 0.2, 1.0]"},
      {"response_b", &p.response_b, between(0, 1), "light of blue", "gamma", "[0.0, 0.2, 1.0]"},
      {"colour_mixing", &p.colour_mixing, seldom(between(0, 2)), "r, g, b from the primaries' light, row by row"},
      {"white_segment", &p.white_segment, seldom(between(0, 4)), "brightens min(r, g, b) by that share; white stays 1"},
      {"flare", &p.flare, seldom(between(0, 1)), "share of its light that lies evenly over the picture"},
      {"native_resolution", &p.native_resolution, seldom(between(0, kMostPixels)),
       "width, height [px] that pictures are scaled to; [0, 0] = none"},
      {"warm_up", &p.warm_up, seldom(between(0, 0.99)), "share of light missing when it is switched on"},
      {"warm_up_s", &p.warm_up_s, seldom(between(1e-6, 1e6)), "time constant of that [s]"},
      {"colour_wheel_hz", &p.colour_wheel_hz, seldom(between(0, 1e5)),
       "turns; red, green, blue in turn; 0 = none [1/s]"},
      {"pwm_hz", &p.pwm_hz, seldom(between(0, 1e6)), "light on and off, half and half; 0 = always on [1/s]"},
      {"refresh_hz", &p.refresh_hz, seldom(between(1, 1000)), "pictures change then [1/s]"},
      {"latency_jitter_ms", &p.latency_jitter_ms, seldom(between(0, 1e4)), "up to that much more latency [ms]"},
      {"stereo", &p.stereo, seldom(any()), "left eye's picture at even refreshes, right eye's at odd ones"},
  };
}

}  // namespace countershade::fields
