// Video4Linux2 with the kernel's true drivers: uvcvideo on a USB webcam that is a thread of this process, and vivid.
// Both need modules that few machines have loaded: tests/device/guest/run has them.
#include "capture/device/video/v4l2.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <linux/videodev2.h>
#include <unistd.h>

#include <mutex>

#include "calib/base/random.h"
#include "tests/device/usb_photo.h"
#include "tests/device/video/uvc_camera.h"

namespace countershade {
namespace {

using capture::Camera;
using capture::Exposure;
using capture::open_v4l2_camera;
using ::testing::AllOf;
using ::testing::HasSubstr;
using testing::UvcCamera;
using testing::UvcOptions;

class Webcam : public ::testing::Test {
 protected:
  void plug_in(UvcOptions options = {}) {
    options.width = testing::kPhotoWidth, options.height = testing::kPhotoHeight;
    camera_ = std::make_unique<UvcCamera>(options, testing::photo_values);
    if (const std::string why = camera_->plug_in(); !why.empty()) GTEST_SKIP() << why;
    for (int i = 0; i < 100 && !listed(); ++i) usleep(100000);
    ASSERT_TRUE(listed()) << "uvcvideo binds to it";
  }
  static std::optional<capture::V4l2Camera> listed() {
    for (const capture::V4l2Camera& c : capture::list_v4l2_cameras())
      if (c.name.starts_with("Room webcam")) return c;
    return std::nullopt;
  }
  static Result<std::unique_ptr<Camera>> open(int tries = 3) {
    return open_v4l2_camera("left eye", listed().value().device, {.timeout_s = 1, .tries = tries});
  }
  static std::unique_ptr<Camera> armed(double exposure_ms = 10, int tries = 3) {
    return testing::armed(open(tries), exposure_ms);
  }
  static int setting(std::uint32_t what) { return testing::read_back(listed().value().device, what); }
  std::unique_ptr<UvcCamera> camera_;
};

TEST_F(Webcam, IsListedWithWhatItCanDo) {
  plug_in({.formats = {"GREY", "Y16 ", "YUYV", "BA81"}});
  if (IsSkipped()) return;
  EXPECT_THAT(listed()->formats, ::testing::UnorderedElementsAre("GREY", "Y16 ", "YUYV", "BA81"));
  EXPECT_EQ(listed()->hindrance, "");
  EXPECT_THAT(listed()->device, HasSubstr("/dev/video"));
  EXPECT_THAT(open_v4l2_camera("left eye", "/dev/video77").error().message,
              AllOf(HasSubstr("'/dev/video77'"), HasSubstr(listed()->device)));
  EXPECT_TRUE(open_v4l2_camera("left eye", listed()->name));
}

TEST_F(Webcam, EveryPixelArrivesInTheFormatWithTheMostGreyValues) {
  struct Case {
    std::vector<std::string> formats;
    int bits;
  };
  for (const Case& c : {Case{{"GREY"}, 8}, {{"YUYV", "GREY", "Y16 "}, 16}}) {
    plug_in({.formats = c.formats});
    if (IsSkipped()) return;
    auto camera = armed();
    ASSERT_TRUE(camera);
    for (int photo = 0; photo < 3; ++photo) {
      const auto taken = camera->trigger();
      ASSERT_TRUE(taken) << taken.error().message;
      testing::expect_whole(*taken, 10, c.bits);
      EXPECT_EQ(taken->counter, static_cast<std::uint64_t>(photo));
    }
    camera_->unplug();
    for (int i = 0; i < 50 && listed(); ++i) usleep(100000);
  }
}

TEST_F(Webcam, ColourComesFromMosaicAndFromSharedChroma) {
  plug_in({.formats = {"BA81", "YUYV"}});
  if (IsSkipped()) return;
  auto camera = armed();
  ASSERT_TRUE(camera);
  const auto taken = camera->trigger();
  ASSERT_TRUE(taken) << taken.error().message;
  EXPECT_EQ(taken->values.channels(), 3) << "a mosaic is better than half the chroma";
  EXPECT_EQ(taken->values.at(4, 4, 2), testing::photo_value(4 * testing::kPhotoWidth + 4, 10) >> 8) << "blue first";
}

TEST_F(Webcam, WhateverChangesByItselfIsOffAfterOpening) {
  plug_in();
  if (IsSkipped()) return;
  EXPECT_EQ(setting(V4L2_CID_POWER_LINE_FREQUENCY), 1);
  ASSERT_TRUE(armed(20));
  EXPECT_EQ(setting(V4L2_CID_EXPOSURE_AUTO), V4L2_EXPOSURE_MANUAL);
  EXPECT_EQ(setting(V4L2_CID_EXPOSURE_ABSOLUTE), 200);
  EXPECT_EQ(setting(V4L2_CID_AUTO_WHITE_BALANCE), 0);
  EXPECT_EQ(setting(V4L2_CID_POWER_LINE_FREQUENCY), 0);
  EXPECT_EQ(setting(V4L2_CID_SHARPNESS), 0);
  EXPECT_EQ(setting(V4L2_CID_GAMMA), 100);
}

TEST_F(Webcam, ExposuresOutsideItsRangeAreRefusedAndNamed) {
  plug_in();
  if (IsSkipped()) return;
  auto camera = armed();
  ASSERT_TRUE(camera);
  for (const double ms : {1001.0, 0.01}) {
    const auto arm = camera->arm(ms);
    ASSERT_FALSE(arm);
    EXPECT_EQ(arm.error().code, ErrorCode::kBadValue);
    EXPECT_THAT(arm.error().message, HasSubstr("0.1 to 1000 ms"));
  }
  EXPECT_THAT(camera->arm(0.14).error().message, HasSubstr("the nearest that it can do is 0.1 ms"));
}

// The exposure of the photo after arm() is the one that was asked for, though the camera obeys two photos late.
TEST_F(Webcam, AnExposureThatActsLateIsWaitedFor) {
  plug_in({.delay = 2});
  if (IsSkipped()) return;
  auto camera = armed(10);
  ASSERT_TRUE(camera);
  for (const double ms : {10.0, 5.0, 20.0, 4.0}) {
    ASSERT_TRUE(camera->arm(ms));
    const auto taken = camera->trigger();
    ASSERT_TRUE(taken) << taken.error().message;
    testing::expect_whole(*taken, ms, 16);
    EXPECT_EQ(taken->exposure_ms, ms);
  }
}

// What changes before trigger() is in the photo: nothing that waited in a queue is given out.
TEST_F(Webcam, APhotoIsExposedAfterItWasAskedFor) {
  std::atomic<std::uint16_t> light{1000};
  UvcOptions options;
  options.width = testing::kPhotoWidth, options.height = testing::kPhotoHeight, options.rate = 30;
  camera_ = std::make_unique<UvcCamera>(options, [&](double) {
    return std::vector<std::uint16_t>(testing::kPhotoWidth * testing::kPhotoHeight, light.load());
  });
  if (const std::string why = camera_->plug_in(); !why.empty()) GTEST_SKIP() << why;
  for (int i = 0; i < 100 && !listed(); ++i) usleep(100000);
  auto camera = armed(100);  // long beside what an emulated computer takes to hear of a photo
  ASSERT_TRUE(camera);
  Random random(hash_name("asked for"));
  for (int i = 0; i < 12; ++i) {
    usleep(static_cast<useconds_t>(random.uniform(0, 2e5)));
    light = static_cast<std::uint16_t>(2000 + 500 * i);
    const auto taken = camera->trigger();
    ASSERT_TRUE(taken) << taken.error().message;
    EXPECT_EQ(taken->values.at(3, 3), 2000 + 500 * i);
  }
  camera.reset();
  camera_->unplug();
}

TEST_F(Webcam, APhotoThatEndsHalfWayIsTakenAgain) {
  plug_in({.cut_of = 3});
  if (IsSkipped()) return;
  auto camera = armed(10, 12);
  ASSERT_TRUE(camera);
  int lost = 0;
  for (int i = 0; i < 12; ++i) {
    const auto taken = camera->trigger();
    ASSERT_TRUE(taken) << taken.error().message;
    testing::expect_whole(*taken, 10, 16);
    lost += taken->lost;
  }
  EXPECT_GT(lost, 0) << "and told";
}

TEST_F(Webcam, ThatNeverSendsAWholePhotoIsAnError) {
  plug_in({.cut_of = 1});
  if (IsSkipped()) return;
  auto camera = armed();
  ASSERT_TRUE(camera);
  const auto taken = camera->trigger();
  ASSERT_FALSE(taken);
  EXPECT_EQ(taken.error().code, ErrorCode::kDevice);
}

TEST_F(Webcam, ThatAnotherProgramHasIsAnError) {
  plug_in();
  if (IsSkipped()) return;
  auto first = armed();
  ASSERT_TRUE(first);
  auto second = open();
  const auto arm = second ? (*second)->arm(10) : Result<void>(second.error());
  ASSERT_FALSE(arm);
  EXPECT_EQ(arm.error().code, ErrorCode::kDevice);
  EXPECT_THAT(arm.error().message, HasSubstr("another program"));
}

TEST_F(Webcam, ThatIsPulledOutIsAnErrorThatNamesItAndAnotherOneMayCome) {
  plug_in();
  if (IsSkipped()) return;
  auto camera = armed();
  ASSERT_TRUE(camera && camera->trigger());
  camera_->unplug();
  const auto taken = camera->trigger();
  ASSERT_FALSE(taken);
  EXPECT_EQ(taken.error().code, ErrorCode::kDevice);
  EXPECT_THAT(taken.error().message, AllOf(HasSubstr("'left eye'"), HasSubstr("gone")));
  camera.reset();
  for (int i = 0; i < 50 && listed(); ++i) usleep(100000);
  plug_in();
  auto back = armed();
  ASSERT_TRUE(back);
  EXPECT_TRUE(back->trigger());
}

// The kernel's test driver: its times lie in the future, it has no exposure, and it drops what it is told to.
class Vivid : public ::testing::Test {
 protected:
  void SetUp() override {
    for (const capture::V4l2Camera& c : capture::list_v4l2_cameras())
      if (c.name == "vivid") device_ = c.device;
    if (device_.empty()) GTEST_SKIP() << "no module vivid here";
  }
  std::string device_;
};

TEST_F(Vivid, IsPhotographedWithoutAnExposureOfItsOwn) {
  auto opened = open_v4l2_camera("left eye", device_);
  ASSERT_TRUE(opened) << opened.error().message;
  Camera& camera = **opened;
  EXPECT_THAT(camera.arm(10).error().message, HasSubstr("leave exposures_ms out"));
  ASSERT_TRUE(camera.arm(0));
  for (int i = 0; i < 3; ++i) {
    const auto taken = camera.trigger();
    ASSERT_TRUE(taken) << taken.error().message;
    EXPECT_EQ(taken->full_scale, 65535) << "Y16 before Y12, Y10 and GREY";
    const auto [least, most] = std::minmax_element(taken->values.data().begin(), taken->values.data().end());
    EXPECT_GT(*most, *least + 10000) << "bars";
  }
}

}  // namespace
}  // namespace countershade
