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
  for (const double at : {1.0, 7.3, 15.0, 41.0, 58.0}) {
    const Appearance found = appearance(photos_of(at, 20, 20, 6));
    EXPECT_TRUE(found.timed()) << at;
    EXPECT_NEAR(found.latest_ms, at, 1e-9) << at;
  }
}

TEST(Latency, ASwapBetweenExposuresIsKnownToBeThere) {
  for (double at = 0.5; at < 150; at += 1.7) {
    const Appearance found = appearance(photos_of(at, 10, 35, 6));
    EXPECT_LE(found.earliest_ms, at + 0.3) << at;  // what a share of 97 % hides
    EXPECT_GE(found.latest_ms, at - 0.3) << at;
    EXPECT_LE(found.latest_ms - found.earliest_ms, 25) << at;
    EXPECT_EQ(found.timed(), std::fmod(at, 35) > 0.3 && std::fmod(at, 35) < 9.7) << at;
  }
}

TEST(Latency, AnUntimedOneCountsOnlyWhereItCameAfterAllTimedOnes) {
  EXPECT_EQ(longest_ms(std::vector<Appearance>{{0, 40}, {33, 33}, {35, 35}, {20, 50}}), 35);
  EXPECT_EQ(longest_ms(std::vector<Appearance>{{33, 33}, {36, 56}, {35, 35}}), 56);
  EXPECT_EQ(longest_ms(std::vector<Appearance>{{10, 30}, {20, 40}}), 40);
  EXPECT_EQ(longest_ms({}), 0);
}

TEST(Latency, IsNothingWhereTheFirstPhotoShowsAll) {
  EXPECT_EQ(appearance(photos_of(0, 10, 30, 3)).latest_ms, 0);
  EXPECT_EQ(appearance(photos_of(0.2, 10, 30, 3)).latest_ms, 0) << "98 % of the change";
  EXPECT_EQ(appearance({}).latest_ms, 0);
}

// Two projectors, one later than the other: the picture is there when both are.
TEST(Latency, OfTwoThatAreNotEquallyLateIsThatOfTheLater) {
  const std::vector<StepPhoto> photos = {{0, 10, 0}, {30, 10, .3}, {60, 10, .8}, {90, 10, 1}, {120, 10, 1}};
  EXPECT_EQ(appearance(photos).latest_ms, 90);
  EXPECT_LE(appearance(photos).earliest_ms, 60);
}

}  // namespace
}  // namespace countershade::capture
