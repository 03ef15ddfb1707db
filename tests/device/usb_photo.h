// What the USB cameras of tests see: a number for each pixel that grows with the exposure; and what is asked of it.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <memory>
#include <vector>

#include "capture/device/device.h"

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

// Of a photo with so many bits.
inline void expect_whole(const capture::Exposure& e, double exposure_ms, int bits) {
  ASSERT_TRUE(e.values.same_size(kPhotoWidth, kPhotoHeight));
  EXPECT_EQ(e.full_scale, (1 << bits) - 1);
  for (std::size_t i = 0; i < e.values.data().size(); ++i)
    ASSERT_EQ(e.values.data()[i], photo_value(i, exposure_ms) >> (16 - bits)) << i;
}

// A camera that was opened, armed; null where one of both failed, which is a failure.
inline std::unique_ptr<capture::Camera> armed(Result<std::unique_ptr<capture::Camera>> opened, double exposure_ms) {
  EXPECT_TRUE(opened) << (opened ? "" : opened.error().message);
  if (!opened) return nullptr;
  const auto arm = (*opened)->arm(exposure_ms);
  EXPECT_TRUE(arm) << (arm ? "" : arm.error().message);
  return std::move(*opened);
}

}  // namespace countershade::testing
