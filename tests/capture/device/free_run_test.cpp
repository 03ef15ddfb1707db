// Which photos of a camera that runs freely are new, whatever happens to the wall clock.
#include "capture/device/aravis/free_run.h"

#include <gtest/gtest.h>

namespace countershade::capture {
namespace {

constexpr double kExposure = 0.02, kOffset = 1.7e9;  // wall clock less monotonic clock

TEST(FreeRun, TakesTheThirdOfThoseThatWereBegunAfterTheQuestion) {
  FreeRun run;
  run.ask(kOffset + 10, 10, 2);
  const auto photo = [&](double came) {
    return run.begun(kOffset + came, kExposure, kOffset + came + .01, came + .01);
  };
  EXPECT_FALSE(photo(9.9)) << "came before";
  EXPECT_FALSE(photo(10.01)) << "was being exposed";
  EXPECT_FALSE(photo(10.03)) << "may have been held inside";
  EXPECT_FALSE(photo(10.05)) << "the same";
  const auto begun = photo(10.07);
  ASSERT_TRUE(begun);
  EXPECT_NEAR(*begun, 10.05, 1e-6);
}

TEST(FreeRun, AskedAgainItPassesOverAsManyAgain) {
  FreeRun run;
  for (const double asked : {10., 20.}) {
    run.ask(kOffset + asked, asked, 1);
    EXPECT_FALSE(run.begun(kOffset + asked + .03, kExposure, kOffset + asked + .03, asked + .03));
    EXPECT_TRUE(run.begun(kOffset + asked + .06, kExposure, kOffset + asked + .06, asked + .06));
  }
}

// By an hour, back or ahead, between the question and the photos: those that came before are dated by the former time.
TEST(FreeRun, AWallClockThatIsSetMakesNoOldPhotoNew) {
  for (const double by : {-3600., 3600., .005}) {
    FreeRun run;
    run.ask(kOffset + 10, 10, 1);
    const double set = kOffset + by;
    EXPECT_FALSE(run.begun(kOffset + 10.01, kExposure, set + 10.02, 10.02)) << "of before it was set, " << by;
    EXPECT_FALSE(run.begun(set + 10.03, kExposure, set + 10.03, 10.03)) << "exposed while it was set";
    EXPECT_FALSE(run.begun(set + 10.06, kExposure, set + 10.06, 10.06)) << "held";
    const auto begun = run.begun(set + 10.09, kExposure, set + 10.09, 10.09);
    ASSERT_TRUE(begun) << by;
    EXPECT_NEAR(*begun, 10.07, 1e-6);
  }
}

}  // namespace
}  // namespace countershade::capture
