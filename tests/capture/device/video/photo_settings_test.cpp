#include "capture/device/video/photo_settings.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace countershade::capture {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

TEST(PhotoSettingsLaw, NamesBothValuesOfTheFirstSettingThatDiffers) {
  const PhotoSettings asked{.exposure_ms = 10, .gain = 1};
  EXPECT_THAT(contradiction(asked, {.exposure_ms = 9, .gain = 4}),
              AllOf(HasSubstr("10 ms was asked for"), HasSubstr("its metadata say 9 ms")));
  EXPECT_THAT(contradiction(asked, {.exposure_ms = 11, .by_driver = true}), HasSubstr("its driver reads back 11 ms"));
  EXPECT_THAT(contradiction(asked, {.exposure_ms = 10, .gain = 4}),
              AllOf(HasSubstr("a gain of 1 was asked for"), HasSubstr("say 4")));
}

TEST(PhotoSettingsLaw, NoExposureIsLongerThanItsFrame) {
  const PhotoSettings asked{.exposure_ms = 50};
  EXPECT_THAT(contradiction(asked, {.frame_ms = 33.3}), AllOf(HasSubstr("50 ms"), HasSubstr("33.3 ms")));
  EXPECT_EQ(contradiction(asked, {.frame_ms = 66.7}), "");
}

TEST(PhotoSettingsLaw, RoundingAndSilenceAreNone) {
  const PhotoSettings asked{.exposure_ms = 10, .gain = 1};
  EXPECT_EQ(contradiction(asked, {}), "");
  EXPECT_EQ(contradiction({}, {.exposure_ms = 3, .gain = 2, .frame_ms = 1}), "") << "nothing was asked for";
  for (const double rounded : {9.91, 10.0, 10.09})  // lines of a sensor
    EXPECT_EQ(contradiction(asked, {.exposure_ms = rounded}), "") << rounded;
  for (const double other : {9.89, 10.11}) EXPECT_NE(contradiction(asked, {.exposure_ms = other}), "") << other;
  EXPECT_EQ(contradiction(asked, {.gain = 1.035}), "") << "a step of .3 dB";
  EXPECT_NE(contradiction(asked, {.gain = 1.06}), "");
}

}  // namespace
}  // namespace countershade::capture
