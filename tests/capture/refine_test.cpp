#include "capture/pattern/refine.h"

#include <gtest/gtest.h>

#include <cmath>

#include "capture/pattern/pattern.h"

namespace countershade::capture {
namespace {

constexpr int kWidth = 40, kHeight = 30;

double truth(int x, int y) {
  return 50.2 + 1.21 * x - 0.37 * y;
}

// A plane as an axis of 200 pixels with 8 bits is read of it, without error.
AxisReading plane() {
  AxisReading reading;
  reading.bits = 8, reading.length_px = 200;
  reading.q = Image(kWidth, kHeight, 1);
  reading.contrast = Image(kWidth, kHeight, 1, 0.5f);
  reading.sigma = Image(kWidth, kHeight, 1);
  reading.reason = Mask(kWidth, kHeight, 1);
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x) {
      reading.q.at(x, y) = static_cast<float>(std::round(truth(x, y)));
      reading.code.push_back(gray_from_binary(static_cast<unsigned>(std::lround(truth(x, y)))));
    }
  reading.uncertain.assign(reading.code.size(), 0);
  return reading;
}

// Leaves bits of a pixel in doubt.
void doubt(AxisReading& reading, int x, int y, std::uint32_t bits) {
  reading.q.at(x, y) = NAN;
  reading.uncertain[y * kWidth + x] = bits;
  reading.reason.at(x, y) = static_cast<std::uint8_t>(Reason::kUncertainBit);
}

Reason reason_at(const AxisReading& reading, int x, int y) {
  return static_cast<Reason>(reading.reason.at(x, y));
}

TEST(RefineByNeighbours, AveragesRoundingAwayUpToTheBorder) {
  AxisReading reading = plane();
  refine_by_neighbours(reading);
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x) {
      ASSERT_EQ(reason_at(reading, x, y), Reason::kAccepted) << x << " " << y;
      // Sixteen readings at least share the rounding of .29; a corner's plane is extrapolated from one side.
      EXPECT_NEAR(reading.q.at(x, y), truth(x, y), 0.35);
      EXPECT_GT(reading.sigma.at(x, y), 0.019);
    }
}

TEST(RefineByNeighbours, CompletesAPixelOnlyIfItsCertainBitsAgree) {
  AxisReading reading = plane();
  doubt(reading, 10, 12, 0b0111);
  doubt(reading, 20, 9, 0b0111);
  reading.code[9 * kWidth + 20] ^= 0b100000;  // a certain bit says another place
  doubt(reading, 30, 20, 0b0011'1111);        // more in doubt than certain
  refine_by_neighbours(reading);
  EXPECT_EQ(reason_at(reading, 10, 12), Reason::kAccepted);
  EXPECT_NEAR(reading.q.at(10, 12), truth(10, 12), 0.2);
  EXPECT_EQ(reason_at(reading, 20, 9), Reason::kUncertainBit);
  EXPECT_TRUE(std::isnan(reading.q.at(20, 9)));
  EXPECT_EQ(reason_at(reading, 30, 20), Reason::kUncertainBit);
}

TEST(RefineByNeighbours, RejectsOutliersAndSpecks) {
  AxisReading reading = plane();
  reading.q.at(15, 15) += 32;
  for (int y = 0; y < kHeight; ++y)
    for (int x = 28; x < kWidth; ++x)
      if (x > 34 || y > 18 || x < 33 || y < 17) doubt(reading, x, y, 0xff);  // leaves two by two pixels there
  refine_by_neighbours(reading);
  EXPECT_EQ(reason_at(reading, 15, 15), Reason::kInconsistent);
  EXPECT_NEAR(reading.q.at(16, 16), truth(16, 16), 0.3) << "its neighbours do not follow it";
  EXPECT_EQ(reason_at(reading, 33, 18), Reason::kIsolated);
}

TEST(RefineByNeighbours, DoubtsDarkPixelsBesideBrightOnes) {
  AxisReading reading = plane();
  for (int y = 0; y < kHeight; ++y)
    for (int x = 20; x < kWidth; ++x) reading.contrast.at(x, y) = 0.05f;
  refine_by_neighbours(reading);
  EXPECT_LT(reading.sigma.at(19, 10), 0.2);  // the bright side loses nothing to the dark one
  EXPECT_GT(reading.sigma.at(20, 10), 0.5);  // up to 1 - 1/10 of its light may come from half a pixel off and more
  EXPECT_LT(reading.sigma.at(23, 10), 0.2);  // beyond the point spread's reach
}

}  // namespace
}  // namespace countershade::capture
