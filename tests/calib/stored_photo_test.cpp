#include "calib/image/stored_photo.h"

#include <gtest/gtest.h>

#include <cmath>

namespace countershade {
namespace {

TEST(StoredPhoto, IsLinearLightBetweenPedestalAndFullScale) {
  Raster<std::uint16_t> stored(3, 2, 1);
  for (std::size_t i = 0; i < 6; ++i) stored.data()[i] = static_cast<std::uint16_t>(100 + 700 * i);
  const StoredPhoto photo(stored, {.pedestal = 100, .full_scale = 4100, .saturated_from = 3600, .table = {}});
  float light[3];
  photo.light_row(1, light);
  for (int x = 0; x < 3; ++x) EXPECT_FLOAT_EQ(light[x], 700.0f * static_cast<float>(3 + x) / 4000);
  std::uint8_t flags[3] = {0, 1, 0};
  photo.mark_saturated(1, flags);
  EXPECT_EQ(flags[0], 0) << "2200 is below";
  EXPECT_EQ(flags[1], 1) << "what was marked stays marked";
  EXPECT_EQ(flags[2], 1) << "3600 is at the limit";
  EXPECT_EQ(photo.linear_row<std::uint16_t>(1)[2], 3600);
  EXPECT_EQ(photo.linear_row<std::uint8_t>(1), nullptr);
  EXPECT_FLOAT_EQ(photo.gain() * 3600 + photo.offset(), light[2]);
}

TEST(StoredPhoto, IsTheMeanOfItsChannelsThroughItsTable) {
  StoredScale scale;
  for (int v = 0; v < 256; ++v) scale.table.push_back(std::pow(static_cast<float>(v) / 255, 2.2f));
  Raster<std::uint8_t> stored(2, 1, 3);
  stored.data() = {10, 100, 200, 254, 3, 4};
  const StoredPhoto photo(stored, scale);
  float light[2];
  photo.light_row(0, light);
  EXPECT_FLOAT_EQ(light[0], (scale.table[10] + scale.table[100] + scale.table[200]) / 3);
  EXPECT_FLOAT_EQ(light[1], (scale.table[254] + scale.table[3] + scale.table[4]) / 3);
  std::uint8_t flags[2] = {0, 0};
  photo.mark_saturated(0, flags);
  EXPECT_EQ(flags[0], 0);
  EXPECT_EQ(flags[1], 1) << "one channel is enough";
  EXPECT_EQ(photo.linear_row<std::uint8_t>(0), nullptr) << "bytes of another meaning";
}

TEST(StoredPhoto, OfLightKeepsItAndWhatIsNotValid) {
  Photo light{Image(2, 1, 1), Mask(2, 1, 1, 1), 0};
  light.value.data() = {0.25f, 1.5f}, light.valid.data() = {0, 1};
  const StoredPhoto photo(light);
  EXPECT_EQ(light_of(photo).data(), light.value.data());
  std::uint8_t flags[2] = {0, 0};
  photo.mark_saturated(0, flags);
  EXPECT_EQ(flags[0], 1);
  EXPECT_EQ(flags[1], 0);
}

}  // namespace
}  // namespace countershade
