// The long look before a capture: everything about display, camera and room that a photo can tell beforehand.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "tools/job/check/self_check.h"

namespace countershade::tools {

struct Inspection {
  std::vector<Finding> findings;  // those of self_check() first
  std::vector<CheckPicture> pictures;
};

// self_check(), and if that is all right, of each camera:
//   latency of steps from black to white and back (median, longest, spread), how much light swings from photo to photo
//   in the dark and in white light, exposures that are whole refreshes and bring white to 80 % of full scale, signal to
//   noise in white, half the light in half the exposure, whether light adds (the camera's response), sharpness of
//   stripes, what of the photo each projector lights and whether that leaves the photo, movement between photos, the
//   camera's health.
// About 60 photos at each camera's first exposure. A camera that is watched and fails is a finding like any other,
// after which the next one is looked at; other errors of devices are errors.
Result<Inspection> inspect(const Rig& rig, const capture::Devices& devices, Progress& progress);

// Exposures of whole refreshes [ms] near `wanted_ms`: the longest that is not above it, or one refresh.
double whole_refreshes(double wanted_ms, double refresh_hz);

// The one nearest to `wanted_ms` (by ratio) of up to twelve refreshes that is also whole pulses of a lamp, to 1 %.
std::optional<double> whole_pulses(double wanted_ms, double refresh_hz, double pulses_hz);

}  // namespace countershade::tools
