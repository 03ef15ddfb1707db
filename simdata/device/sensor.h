// From the light before the lens to stored numbers.
#pragma once

#include <cstdint>

#include "calib/file/rig.h"
#include "capture/device/device.h"

namespace countershade::simdata {

// What the lens makes of light: blurred by the point spread function, then veiled by `veiling_glare` times each
// channel's mean.
Image through_lens(const Image& light, const SimulatedCamera& camera);
void add_glare(Image& light, double share);  // of each channel's mean

// light: units of full scale at the reference exposure, after through_lens. Electrons of a pixel are Gaussian with
// mean N = light * exposure / reference * full well and variance N + read_noise^2 (EMVA 1288's linear model); stored
// are pedestal + electrons / full_well * (full_scale - pedestal), encoded by the camera's response, rounded and clipped
// to 0..full_scale = 2^bits - 1. Noise depends on `key`, pixel and channel alone. Hot pixels, at places that depend on
// `sensor` alone, have .05 to 1 of full scale more light per reference exposure. Under a Bayer filter each pixel
// measures one colour, and the stored numbers are interpolated by demosaiced() (calib/image).
capture::Exposure expose(const Image& light, const SimulatedCamera& camera, const CameraSpec& spec, double exposure_ms,
                         std::uint64_t key, std::uint64_t sensor = 0);

// The exposure time that a camera with `auto_exposure` takes instead of the one asked for: the geometric mean, weighted
// by its strength, of that and of the time which brings the photo's mean to 18 % of full scale.
double adapted_exposure_ms(const Image& light, const SimulatedCamera& camera, double exposure_ms);

}  // namespace countershade::simdata
