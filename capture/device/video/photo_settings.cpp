#include "capture/device/video/photo_settings.h"

#include <fmt/format.h>

#include <cmath>

namespace countershade::capture {

namespace {
constexpr double kExposureTolerance = 0.01;  // what a camera may round an exposure by
constexpr double kGainTolerance = 0.05;
}  // namespace

std::string contradiction(const PhotoSettings& asked, const PhotoSettings& said) {
  const char* who = said.by_driver ? "its driver reads back" : "its metadata say";
  if (asked.exposure_ms && said.exposure_ms &&
      std::abs(*said.exposure_ms - *asked.exposure_ms) > kExposureTolerance * *asked.exposure_ms)
    return fmt::format("an exposure of {} ms was asked for, {} {} ms", *asked.exposure_ms, who, *said.exposure_ms);
  if (asked.exposure_ms && said.frame_ms && *said.frame_ms < (1 - kExposureTolerance) * *asked.exposure_ms)
    return fmt::format("an exposure of {} ms was asked for, {} that the photo took {} ms", *asked.exposure_ms, who,
                       *said.frame_ms);
  if (asked.gain && said.gain && std::abs(*said.gain - *asked.gain) > kGainTolerance * *asked.gain)
    return fmt::format("a gain of {} was asked for, {} {}", *asked.gain, who, *said.gain);
  return "";
}

}  // namespace countershade::capture
