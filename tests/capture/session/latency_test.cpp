#include "capture/session/latency.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

namespace countershade::capture {
namespace {

// Photos of `exposure` ms every `period` ms from 100 ms on, of a picture that appears at `at` ms after that.
std::vector<StepPhoto> photos_of(double at, double exposure, double period, int count) {
  std::vector<StepPhoto> photos;
  for (int i = 0; i < count; ++i) {
    const double from = i * period;
    photos.push_back({100 + from, exposure, std::clamp((from + exposure - at) / exposure, 0.0, 1.0)});
  }
  return photos;
}

TEST(Latency, ASwapInsideAnExposureIsTimedByItsShare) {
  for (const double at : {1.0, 7.3, 15.0, 41.0, 58.0})
    EXPECT_NEAR(appeared_after_ms(photos_of(at, 20, 20, 6)), at, 1e-9) << at;
}

TEST(Latency, ASwapBetweenExposuresIsNotThoughtEarlierThanItWas) {
  for (double at = 0.5; at < 150; at += 1.7) {
    const double found = appeared_after_ms(photos_of(at, 10, 35, 6));
    EXPECT_GE(found, at - 0.03 * 10) << at;  // what a share of 97 % hides
    EXPECT_LE(found, at + 25 + 0.3) << at;
  }
}

TEST(Latency, IsNothingWhereTheFirstPhotoShowsAll) {
  EXPECT_EQ(appeared_after_ms(photos_of(0, 10, 30, 3)), 0);
  EXPECT_EQ(appeared_after_ms(photos_of(0.2, 10, 30, 3)), 0) << "98 % of the change";
  EXPECT_EQ(appeared_after_ms({}), 0);
}

// Two projectors, one later than the other: the picture is there when both are.
TEST(Latency, OfTwoThatAreNotEquallyLateIsThatOfTheLater) {
  const std::vector<StepPhoto> photos = {{0, 10, 0}, {30, 10, .3}, {60, 10, .8}, {90, 10, 1}, {120, 10, 1}};
  EXPECT_EQ(appeared_after_ms(photos), 90);
}

}  // namespace
}  // namespace countershade::capture
