#include "simdata/device/device_check.h"

#include <algorithm>

namespace countershade::simdata {

namespace {

Result<void> within(const std::string& name, double value, double low, double high) {
  if (value >= low && value <= high) return {};  // false for NaN
  return error(ErrorCode::kBadValue, "[simulation] {} = {} is outside {} to {}", name, value, low, high);
}

Result<void> one_of(const std::string& name, const std::string& value, const std::vector<std::string>& ready) {
  if (std::count(ready.begin(), ready.end(), value)) return {};
  return error(ErrorCode::kBadValue, "[simulation] {} = '{}' is not known; use one of {}", name, value,
               fmt::join(ready, ", "));
}

Result<void> check_curve(const std::string& name, const std::vector<double>& curve) {
  if (curve.size() == 1)
    return error(ErrorCode::kBadValue, "[simulation] {} has one value; give at least 2, or none for gamma", name);
  for (std::size_t i = 0; i < curve.size(); ++i) {
    CS_TRY_VOID(within(name, curve[i], 0, 1));
    if (i > 0 && curve[i] < curve[i - 1])
      return error(ErrorCode::kBadValue, "[simulation] {} falls from {} to {} at its value {}; it must never fall",
                   name, curve[i - 1], curve[i], i + 1);
  }
  return {};
}

// Whether each pixel of the picture's rim has a ray that comes back to it.
bool holds_the_picture(const Lens& lens) {
  constexpr int kSteps = 32;
  for (int i = 0; i <= kSteps; ++i) {
    const double x = i * lens.width() / double{kSteps} - 0.5, y = i * lens.height() / double{kSteps} - 0.5;
    for (const Eigen::Vector2d& q : {Eigen::Vector2d(x, -0.5), Eigen::Vector2d(x, lens.height() - 0.5),
                                     Eigen::Vector2d(-0.5, y), Eigen::Vector2d(lens.width() - 0.5, y)})
      if (!((lens.project(lens.unproject(q)) - q).norm() < 1e-3)) return false;
  }
  return true;
}

}  // namespace

Result<Lens> camera_lens(const SimulatedCamera& c) {
  if (c.lens.empty()) {
    std::vector<double> intrinsics{c.focal_px, c.focal_px, c.principal[0], c.principal[1]};
    intrinsics.insert(intrinsics.end(), c.distortion.begin(), c.distortion.end());
    return Lens::make("LENSMODEL_OPENCV5", intrinsics, c.resolution[0], c.resolution[1]);
  }
  CS_TRY(const Device read, read_cameramodel(c.lens));
  if (read.lens.width() != c.resolution[0] || read.lens.height() != c.resolution[1])
    return error(ErrorCode::kBadValue,
                 "camera '{}': the lens '{}' is for {} x {} pixels, its resolution is [{}, {}]; set the resolution to "
                 "the lens's or name another lens",
                 c.id, c.lens.string(), read.lens.width(), read.lens.height(), c.resolution[0], c.resolution[1]);
  return read.lens;
}

Result<Lens> projector_lens(const SimulatedProjector& p, int width, int height) {
  const double focal = p.throw_ratio * width;
  // lens_shift: the picture's centre as seen from the lens axis.
  std::vector<double> intrinsics{focal, focal, (width - 1) / 2.0 - p.lens_shift[0] * width,
                                 (height - 1) / 2.0 - p.lens_shift[1] * height};
  if (p.distortion == std::array<double, 5>{}) return Lens::make("LENSMODEL_PINHOLE", intrinsics, width, height);
  intrinsics.insert(intrinsics.end(), p.distortion.begin(), p.distortion.end());
  CS_TRY(Lens lens, Lens::make("LENSMODEL_OPENCV5", intrinsics, width, height));
  if (!holds_the_picture(lens))
    return error(ErrorCode::kBadValue,
                 "projector '{}': distortion = [{}] folds inside its picture; make it smaller, or the throw ratio {} "
                 "larger",
                 p.id, fmt::join(p.distortion, ", "), p.throw_ratio);
  return lens;
}

Result<void> check_device(const SimulatedCamera& c) {
  const std::string what = "camera '" + c.id + "'";
  CS_TRY_VOID(within(what + " veiling_glare", c.veiling_glare, 0, 1));
  CS_TRY_VOID(one_of(what + " bayer", c.bayer, {"none", "RGGB", "GRBG", "GBRG", "BGGR"}));
  if (c.bayer != "none" && c.channels != 3)
    return error(ErrorCode::kBadValue, "[simulation] {} bayer = '{}' needs channels = 3, not {}", what, c.bayer,
                 c.channels);
  CS_TRY_VOID(within(what + " hot_pixels", c.hot_pixels, 0, 1e6));
  CS_TRY_VOID(within(what + " rolling_shutter_ms", c.rolling_shutter_ms, 0, 1e4));
  CS_TRY_VOID(within(what + " auto_exposure", c.auto_exposure, 0, 1));
  CS_TRY_VOID(within(what + " timestamp_offset_ms", c.timestamp_offset_ms, -1e9, 1e9));
  CS_TRY_VOID(within(what + " clock_drift_ppm", c.clock_drift_ppm, -1e5, 1e5));
  CS_TRY_VOID(one_of(what + " eye", c.eye, {"both", "left", "right"}));
  return within(what + " glasses_leak", c.glasses_leak, 0, 1);
}

Result<void> check_device(const SimulatedProjector& p) {
  const std::string what = "projector '" + p.id + "'";
  for (double d : p.distortion) CS_TRY_VOID(within(what + " distortion", d, -10, 10));
  CS_TRY_VOID(check_curve(what + " response_r", p.response_r));
  CS_TRY_VOID(check_curve(what + " response_g", p.response_g));
  CS_TRY_VOID(check_curve(what + " response_b", p.response_b));
  for (double m : p.colour_mixing) CS_TRY_VOID(within(what + " colour_mixing", m, 0, 2));
  CS_TRY_VOID(within(what + " white_segment", p.white_segment, 0, 4));
  CS_TRY_VOID(within(what + " flare", p.flare, 0, 1));
  for (int side : p.native_resolution) CS_TRY_VOID(within(what + " native_resolution", side, 0, 32768));
  if ((p.native_resolution[0] == 0) != (p.native_resolution[1] == 0))
    return error(ErrorCode::kBadValue,
                 "[simulation] {} native_resolution = [{}, {}] has one side of 0; give both, or [0, 0] for none", what,
                 p.native_resolution[0], p.native_resolution[1]);
  CS_TRY_VOID(within(what + " warm_up", p.warm_up, 0, 0.99));
  CS_TRY_VOID(within(what + " warm_up_s", p.warm_up_s, 1e-6, 1e6));
  CS_TRY_VOID(within(what + " colour_wheel_hz", p.colour_wheel_hz, 0, 1e5));
  CS_TRY_VOID(within(what + " pwm_hz", p.pwm_hz, 0, 1e6));
  CS_TRY_VOID(within(what + " refresh_hz", p.refresh_hz, 1, 1000));
  CS_TRY_VOID(within(what + " latency_ms", p.latency_ms, 0, 1e4));
  return within(what + " latency_jitter_ms", p.latency_jitter_ms, 0, 1e4);
}

}  // namespace countershade::simdata
