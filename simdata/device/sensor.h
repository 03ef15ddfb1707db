// From light to stored numbers.
#pragma once

#include <cstdint>

#include "calib/file/rig.h"
#include "capture/device/device.h"

namespace countershade::simdata {

// light: units of full scale at the reference exposure, after optics. Electrons of a pixel are Gaussian with
// mean N = light * exposure / reference * full well and variance N + read_noise^2 (EMVA 1288's linear model); stored
// are pedestal + electrons / full_well * (full_scale - pedestal), encoded by the camera's response, rounded and clipped
// to 0..full_scale = 2^bits - 1. Noise depends on `key`, pixel and channel alone.
capture::Exposure expose(const Image& light, const SimulatedCamera& camera, const CameraSpec& spec, double exposure_ms,
                         std::uint64_t key);

}  // namespace countershade::simdata
