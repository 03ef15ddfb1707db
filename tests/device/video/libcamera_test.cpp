// libcamera over the kernel's uvcvideo, on a USB webcam that is a thread of this process. It needs a running udevd and
// a USB bus that the firmware knows: tests/device/guest/run has both.
#include "capture/device/video/libcamera.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <linux/videodev2.h>
#include <unistd.h>

#include <fstream>
#include <nlohmann/json.hpp>

#include "calib/base/random.h"
#include "capture/device/video/v4l2.h"
#include "tests/device/usb_photo.h"
#include "tests/device/video/uvc_camera.h"
#include "tests/support/cli.h"

namespace countershade {
namespace {

using capture::Camera;
using capture::Exposure;
using capture::LibcameraCamera;
using capture::open_libcamera_camera;
using ::testing::AllOf;
using ::testing::HasSubstr;
using testing::UvcCamera;
using testing::UvcOptions;

class Libcamera : public ::testing::Test {
 protected:
  void plug_in(UvcOptions options = {}, UvcCamera::Photograph photograph = testing::photo_values) {
    if (!capture::has_libcamera()) GTEST_SKIP() << "built without libcamera";
    options.width = testing::kPhotoWidth, options.height = testing::kPhotoHeight;
    camera_ = std::make_unique<UvcCamera>(options, std::move(photograph));
    if (const std::string why = camera_->plug_in(); !why.empty()) GTEST_SKIP() << why;
    for (int i = 0; i < 100 && !listed(); ++i) usleep(200000);
    ASSERT_TRUE(listed()) << capture::why_no_libcamera_camera();
  }
  void unplug() {
    camera_->unplug();
    for (int i = 0; i < 50 && listed(); ++i) usleep(100000);
  }
  static std::optional<LibcameraCamera> listed() {
    for (LibcameraCamera& c : capture::list_libcamera_cameras())
      if (c.name.starts_with("Room webcam")) return std::move(c);
    return std::nullopt;
  }
  static std::unique_ptr<Camera> armed(double exposure_ms = 10, int tries = 3) {
    return testing::armed(open_libcamera_camera("left eye", "", {.timeout_s = 1, .tries = tries}), exposure_ms);
  }
  static void expect_whole(const Exposure& e, double exposure_ms) {
    EXPECT_EQ(e.exposure_ms, exposure_ms);
    testing::expect_whole(e, exposure_ms, 8);
  }
  std::unique_ptr<UvcCamera> camera_;
};

TEST_F(Libcamera, IsListedWithWhatItCanDo) {
  plug_in({.formats = {"YUYV", "GREY", "BA81"}});
  if (IsSkipped()) return;
  const LibcameraCamera camera = *listed();
  EXPECT_THAT(camera.formats, ::testing::UnorderedElementsAre("YUYV", "R8", "SBGGR8"));
  EXPECT_EQ(camera.exposures_ms, (std::array<double, 2>{0.1, 1000}));
  EXPECT_EQ(camera.hindrance, "");
  ASSERT_EQ(camera.nodes.size(), 1u);
  for (const std::string& name : {camera.id, camera.name, camera.nodes[0]})
    EXPECT_TRUE(open_libcamera_camera("left eye", name)) << name;
  EXPECT_THAT(open_libcamera_camera("left eye", "imx219").error().message,
              AllOf(HasSubstr("'imx219'"), HasSubstr(camera.id)));
  const testing::CommandResult devices = testing::run_countershade("devices --json");
  bool told = false;
  for (const auto& row : nlohmann::json::parse(devices.out))
    told |= row["remedy"] == "backend = \"libcamera\", device = '" + camera.id + "' for a camera of the rig" &&
            row["state"] == fmt::format("{} {}, 0.1 to 1000 ms", camera.id, fmt::join(camera.formats, ","));
  EXPECT_TRUE(told) << devices.out;
}

// Cameras of a rig are opened before its windows, which a computer without a display has none of.
TEST_F(Libcamera, IsOpenedByTheLineThatDevicesGivesForARig) {
  plug_in();
  if (IsSkipped()) return;
  const testing::TemporaryFolder folder;
  const auto checked = [&](const std::string& device) {
    std::ofstream(folder / "rig.toml") << "[[camera]]\nid = \"left\"\nbackend = \"libcamera\"\ndevice = '" << device
                                       << "'\n[[projector]]\nid = \"p\"\nresolution = [64, 48]\noutput = \"window\"\n";
    return testing::run_countershade("check " + (folder / "rig.toml").string()).err;
  };
  EXPECT_THAT(checked(listed()->id), HasSubstr("there is no display"));
  EXPECT_THAT(checked("imx219"), AllOf(HasSubstr("'left'"), HasSubstr("'imx219'")));
}

// R8 is all that libcamera 0.0.3 makes of a camera that could send 16 bits.
TEST_F(Libcamera, EveryPixelArrives) {
  plug_in({.formats = {"YUYV", "Y16 ", "GREY"}});
  if (IsSkipped()) return;
  auto camera = armed();
  ASSERT_TRUE(camera);
  for (std::uint64_t photo = 0; photo < 3; ++photo) {
    const auto taken = camera->trigger();
    ASSERT_TRUE(taken) << taken.error().message;
    expect_whole(*taken, 10);
    EXPECT_EQ(taken->counter, photo);
  }
}

TEST_F(Libcamera, AMosaicIsBetterThanHalfTheChroma) {
  plug_in({.formats = {"YUYV", "BA81"}});
  if (IsSkipped()) return;
  auto camera = armed();
  ASSERT_TRUE(camera);
  const auto taken = camera->trigger();
  ASSERT_TRUE(taken) << taken.error().message;
  ASSERT_EQ(taken->values.channels(), 3);
  EXPECT_EQ(taken->values.at(4, 4, 2), testing::photo_value(4 * testing::kPhotoWidth + 4, 10) >> 8) << "blue first";
}

TEST_F(Libcamera, WhateverChangesByItselfIsOffAfterOpening) {
  plug_in();
  if (IsSkipped()) return;
  const std::string node = listed()->nodes.at(0);
  EXPECT_EQ(testing::read_back(node, V4L2_CID_POWER_LINE_FREQUENCY), 1);
  EXPECT_EQ(testing::read_back(node, V4L2_CID_AUTO_WHITE_BALANCE), 1);
  ASSERT_TRUE(armed(20));
  EXPECT_EQ(testing::read_back(node, V4L2_CID_EXPOSURE_AUTO), V4L2_EXPOSURE_MANUAL);
  EXPECT_EQ(testing::read_back(node, V4L2_CID_EXPOSURE_ABSOLUTE), 200);
  EXPECT_EQ(testing::read_back(node, V4L2_CID_AUTO_WHITE_BALANCE), 0);
  EXPECT_EQ(testing::read_back(node, V4L2_CID_POWER_LINE_FREQUENCY), 0);
  EXPECT_EQ(testing::read_back(node, V4L2_CID_SHARPNESS), 0);
  EXPECT_EQ(testing::read_back(node, V4L2_CID_GAMMA), 100);
}

TEST_F(Libcamera, ExposuresThatItCannotDoAreRefusedAndNamed) {
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
  ASSERT_TRUE(camera->arm(0.14));
  const auto taken = camera->trigger();
  ASSERT_FALSE(taken);
  EXPECT_EQ(taken.error().code, ErrorCode::kDevice);
  EXPECT_THAT(taken.error().message, AllOf(HasSubstr("0.14 ms was asked for"), HasSubstr("reads back 0.1 ms")));
  ASSERT_TRUE(camera->arm(5));
  EXPECT_TRUE(camera->trigger()) << "and goes on with one that it can";
}

// The exposure of the photo after arm() is the one that was asked for, though the camera obeys two photos late.
TEST_F(Libcamera, AnExposureThatActsLateIsWaitedFor) {
  plug_in({.delay = 2});
  if (IsSkipped()) return;
  auto camera = armed(10);
  ASSERT_TRUE(camera);
  for (const double ms : {10.0, 5.0, 20.0, 4.0}) {
    ASSERT_TRUE(camera->arm(ms));
    const auto taken = camera->trigger();
    ASSERT_TRUE(taken) << taken.error().message;
    expect_whole(*taken, ms);
  }
}

// What changes before trigger() is in the photo: nothing that waited in a request is given out.
TEST_F(Libcamera, APhotoIsExposedAfterItWasAskedFor) {
  std::atomic<std::uint16_t> light{0};
  plug_in({.rate = 30}, [&](double) {
    return std::vector<std::uint16_t>(testing::kPhotoWidth * testing::kPhotoHeight, light.load());
  });
  if (IsSkipped()) return;
  auto camera = armed(100);  // long beside what an emulated computer takes to hear of a photo
  ASSERT_TRUE(camera);
  Random random(hash_name("asked for"));
  for (int i = 0; i < 8; ++i) {
    usleep(static_cast<useconds_t>(random.uniform(0, 2e5)));
    light = static_cast<std::uint16_t>((20 + 10 * i) << 8);
    const auto taken = camera->trigger();
    ASSERT_TRUE(taken) << taken.error().message;
    EXPECT_EQ(taken->values.at(3, 3), 20 + 10 * i);
  }
  camera.reset();
  camera_->unplug();  // before what it looks at goes
}

TEST_F(Libcamera, APhotoThatEndsHalfWayIsTakenAgain) {
  plug_in({.cut_of = 3});
  if (IsSkipped()) return;
  auto camera = armed(10, 12);
  ASSERT_TRUE(camera);
  int lost = 0;
  for (int i = 0; i < 12; ++i) {
    const auto taken = camera->trigger();
    ASSERT_TRUE(taken) << taken.error().message;
    expect_whole(*taken, 10);
    lost += taken->lost;
  }
  EXPECT_GT(lost, 0) << "and told";
}

TEST_F(Libcamera, ThatAnotherProgramHasIsAnError) {
  plug_in();
  if (IsSkipped()) return;
  const auto refused = [] {
    auto second = open_libcamera_camera("left eye", "");
    const auto arm = second ? (*second)->arm(10) : Result<void>(second.error());
    EXPECT_FALSE(arm);
    return arm ? "" : arm.error().message;
  };
  {
    auto first = capture::open_v4l2_camera("right eye", listed()->nodes.at(0));
    ASSERT_TRUE(first && (*first)->arm(10));
    EXPECT_THAT(refused(), AllOf(HasSubstr("'left eye'"), HasSubstr("another program")));
  }
  auto first = armed();
  ASSERT_TRUE(first);
  EXPECT_THAT(refused(), AllOf(HasSubstr("'left eye'"), HasSubstr("another program")));
  EXPECT_THAT(listed()->hindrance, HasSubstr("in use"));
  EXPECT_TRUE(first->trigger()) << "and the first goes on";
}

TEST_F(Libcamera, ThatIsPulledOutIsAnErrorThatNamesItAndAnotherOneMayCome) {
  plug_in();
  if (IsSkipped()) return;
  auto camera = armed();
  ASSERT_TRUE(camera && camera->trigger());
  camera_->unplug();
  const auto taken = camera->trigger();
  ASSERT_FALSE(taken);
  EXPECT_EQ(taken.error().code, ErrorCode::kDevice);
  EXPECT_THAT(taken.error().message, AllOf(HasSubstr("'left eye'"), HasSubstr("gone")));
  const auto again = camera->trigger();
  ASSERT_FALSE(again);
  EXPECT_THAT(again.error().message, HasSubstr("gone"));
  camera.reset();
  for (int i = 0; i < 50 && listed(); ++i) usleep(100000);
  plug_in();
  auto back = armed();
  ASSERT_TRUE(back);
  EXPECT_TRUE(back->trigger());
}

}  // namespace
}  // namespace countershade
