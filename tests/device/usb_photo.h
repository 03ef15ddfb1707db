// What the USB cameras of tests see: a number for each pixel that grows with the exposure.
#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

namespace countershade::testing {

inline constexpr int kPhotoWidth = 160, kPhotoHeight = 90;

inline std::uint16_t photo_value(std::size_t i, double exposure_ms) {
  return static_cast<std::uint16_t>(std::min(65535.0, (i * 2654435761u >> 17) % 30000 * exposure_ms / 10));
}
inline std::vector<std::uint16_t> photo_values(double exposure_ms) {
  std::vector<std::uint16_t> values(kPhotoWidth * kPhotoHeight);
  for (std::size_t i = 0; i < values.size(); ++i) values[i] = photo_value(i, exposure_ms);
  return values;
}

}  // namespace countershade::testing
