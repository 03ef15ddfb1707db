// USB3 Vision through Aravis and libusb, on a camera that a thread of this process is.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include "capture/device/aravis/aravis.h"
#include "tests/device/aravis/u3v_camera.h"
#include "tests/device/usb_photo.h"

namespace countershade {
namespace {

using capture::Camera;
using ::testing::AllOf;
using ::testing::HasSubstr;
using testing::U3vCamera;
using testing::U3vOptions;

class Usb3 : public ::testing::Test {
 protected:
  void plug_in(U3vOptions options = {}) {
    if (!capture::has_aravis()) GTEST_SKIP() << "built without Aravis";
    options.width = testing::kPhotoWidth, options.height = testing::kPhotoHeight;
    camera_ = std::make_unique<U3vCamera>(options, testing::photo_values);
    if (const std::string why = camera_->plug_in(); !why.empty()) GTEST_SKIP() << why;
    for (int i = 0; i < 60 && !listed(); ++i) usleep(250000);
    ASSERT_TRUE(listed());
  }
  static bool listed() {
    for (const capture::AravisCamera& c : capture::list_aravis_cameras())
      if (c.protocol == "USB3Vision" && c.device == "ROOM3") return true;
    return false;
  }
  static std::unique_ptr<Camera> armed(double exposure_ms) {
    return testing::armed(capture::open_aravis_camera("left eye", "ROOM3", {.timeout_s = 2, .tries = 3}), exposure_ms);
  }
  std::unique_ptr<U3vCamera> camera_;
};

TEST_F(Usb3, EveryPixelArrivesAtTheExposureThatWasAskedFor) {
  plug_in();
  if (IsSkipped()) return;
  auto camera = armed(10);
  ASSERT_TRUE(camera);
  for (const double ms : {10.0, 5.0, 20.0}) {
    ASSERT_TRUE(camera->arm(ms));
    for (int photo = 0; photo < 2; ++photo) {
      const auto taken = camera->trigger();
      ASSERT_TRUE(taken) << taken.error().message;
      EXPECT_EQ(taken->exposure_ms, ms);
      testing::expect_whole(*taken, ms, 16);  // Mono16 before Mono8
    }
  }
}

TEST_F(Usb3, APhotoThatEndsHalfWayIsTakenAgain) {
  plug_in({.cut_every = 3});
  if (IsSkipped()) return;
  auto camera = armed(10);
  ASSERT_TRUE(camera);
  for (int photo = 0; photo < 4; ++photo) {
    const auto taken = camera->trigger();
    ASSERT_TRUE(taken) << taken.error().message;
    for (std::size_t i = 0; i < taken->values.data().size(); ++i)
      ASSERT_EQ(taken->values.data()[i], testing::photo_value(i, 10)) << i;
  }
  EXPECT_GT(camera_->photos(), 4);
}

TEST_F(Usb3, ThatIsPulledOutIsAnErrorThatNamesIt) {
  plug_in();
  if (IsSkipped()) return;
  auto camera = armed(10);
  ASSERT_TRUE(camera && camera->trigger());
  camera_->unplug();
  const auto taken = camera->trigger();
  ASSERT_FALSE(taken);
  EXPECT_EQ(taken.error().code, ErrorCode::kDevice);
  EXPECT_THAT(taken.error().message, AllOf(HasSubstr("'left eye'"), HasSubstr("gone")));
}

}  // namespace
}  // namespace countershade
