// What a photo was asked to be, beside what is said of it afterwards.
#pragma once

#include <optional>
#include <string>

namespace countershade::capture {

struct PhotoSettings {
  // None = nothing said; frame_ms: from this photo to the next.
  std::optional<double> exposure_ms{}, gain{}, frame_ms{};
  bool by_driver = false;  // not the photo's own metadata: what the driver reads back
};

// What contradicts what was asked, with both values; empty where nothing does. An exposure may be 1 % off, a gain 5 %
// (cameras know steps of up to .3 dB); no exposure is longer than its frame.
std::string contradiction(const PhotoSettings& asked, const PhotoSettings& said);

}  // namespace countershade::capture
