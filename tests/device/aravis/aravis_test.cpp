// GigE Vision through Aravis, with real packets, on a network of the test's own.
#include "capture/device/aravis/aravis.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <cstdlib>
#include <mutex>
#include <thread>
#include <utility>

#include "tests/device/aravis/gige_camera.h"

namespace countershade {
namespace {

using capture::AravisOptions;
using capture::Camera;
using capture::open_aravis_camera;
using testing::GigeCamera;
using testing::GigeOptions;
using ::testing::HasSubstr;

std::uint16_t value_of(std::size_t i) {
  return static_cast<std::uint16_t>(i * 2654435761u >> 7);
}
double now_s() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}
std::vector<std::uint16_t> pattern(const GigeOptions& options) {
  std::vector<std::uint16_t> values(static_cast<std::size_t>(options.width) * options.height);
  for (std::size_t i = 0; i < values.size(); ++i) values[i] = value_of(i);
  return values;
}

class Aravis : public ::testing::Test {
 protected:
  void SetUp() override {
    if (!capture::has_aravis()) GTEST_SKIP() << "built without Aravis";
    if (const std::string why = testing::enter_private_network(); !why.empty()) GTEST_SKIP() << why;
  }
  void plug_in(const GigeOptions& options = {}) {
    camera_ = std::make_unique<GigeCamera>(options, [options](double) { return pattern(options); });
  }
  Result<std::unique_ptr<Camera>> open(const std::string& device = "") {
    return open_aravis_camera("left eye", device, {.timeout_s = 0.5, .tries = 3});
  }
  std::unique_ptr<Camera> armed() {
    auto opened = open();
    EXPECT_TRUE(opened) << (opened ? "" : opened.error().message);
    if (!opened) return nullptr;
    const auto arm = (*opened)->arm(5);
    EXPECT_TRUE(arm) << (arm ? "" : arm.error().message);
    return std::move(*opened);
  }
  // Photos that are asked for arrive whole, pixel for pixel, of `bits` bits.
  static void expect_whole(Camera& camera, int photos, int bits = 16) {
    for (int photo = 0; photo < photos; ++photo) {
      const auto taken = camera.trigger();
      ASSERT_TRUE(taken) << taken.error().message;
      EXPECT_EQ(taken->counter, static_cast<std::uint64_t>(photo));
      EXPECT_EQ(taken->full_scale, (1 << bits) - 1);
      EXPECT_EQ(taken->exposure_ms, 5);
      ASSERT_TRUE(taken->values.same_size(kWidth, kHeight));
      for (std::size_t i = 0; i < taken->values.data().size(); ++i)
        ASSERT_EQ(taken->values.data()[i], value_of(i) >> (16 - bits)) << bits << " " << i;
    }
  }
  // A camera of many packets.
  static GigeOptions large() {
    GigeOptions options;
    options.width = kWidth, options.height = kHeight, options.formats = {"Mono16"}, options.largest_packet = 1000;
    return options;
  }
  static constexpr int kWidth = 320, kHeight = 200;
  std::unique_ptr<GigeCamera> camera_;
};

TEST_F(Aravis, EveryPixelArrivesAsItWas) {
  for (const auto& [formats, bits] : {std::pair(std::vector<std::string>{"Mono8"}, 8),
                                      {{"Mono8", "Mono12"}, 12},
                                      {{"Mono16", "Mono12", "Mono8"}, 16}}) {
    GigeOptions options = large();
    options.formats = formats;
    plug_in(options);
    auto camera = armed();
    ASSERT_NE(camera, nullptr);
    expect_whole(*camera, 5, bits);
    EXPECT_EQ(camera_->photos(), 5);
    camera.reset(), camera_.reset();
  }
}

TEST_F(Aravis, IsFoundBySerialAddressAndName) {
  plug_in();
  const auto cameras = capture::list_aravis_cameras();
  ASSERT_EQ(cameras.size(), 1u);
  EXPECT_EQ(cameras[0].device, "ROOM1");
  EXPECT_EQ(cameras[0].address, "127.0.0.1");
  EXPECT_EQ(cameras[0].protocol, "GigEVision");
  for (const char* name : {"", "ROOM1", "127.0.0.1", "Countershade RoomCamera"}) {
    const auto opened = open(name);
    EXPECT_TRUE(opened) << name << ": " << (opened ? "" : opened.error().message);
  }
  const auto none = open("ROOM2");
  ASSERT_FALSE(none);
  EXPECT_EQ(none.error().code, ErrorCode::kDevice);
  EXPECT_THAT(none.error().message, HasSubstr("no camera is called 'ROOM2'; those that answer are 'ROOM1'"));
}

TEST_F(Aravis, TheListSaysWhatItCanDoAndWhoHasIt) {
  GigeOptions options;
  options.formats = {"Mono8", "Mono12"};
  plug_in(options);
  const auto free = capture::list_aravis_cameras();
  ASSERT_EQ(free.size(), 1u);
  EXPECT_EQ(free[0].hindrance, "");
  EXPECT_THAT(free[0].formats, ::testing::UnorderedElementsAre("Mono8", "Mono12"));
  ASSERT_TRUE(free[0].exposures_ms);
  EXPECT_EQ(*free[0].exposures_ms, (std::array<double, 2>{.01, 1000}));
  const auto open = armed();
  ASSERT_NE(open, nullptr);
  const auto taken = capture::list_aravis_cameras();
  ASSERT_EQ(taken.size(), 1u);
  EXPECT_THAT(taken[0].hindrance, HasSubstr("another program has it"));
  EXPECT_TRUE(open->trigger()) << "and is not disturbed";
}

TEST_F(Aravis, ADescriptionThatCannotBeUsedHindersIt) {
  GigeOptions options;
  options.claimed_description = 50 << 20;
  plug_in(options);
  const auto cameras = capture::list_aravis_cameras();
  ASSERT_EQ(cameras.size(), 1u);
  EXPECT_THAT(cameras[0].hindrance, HasSubstr("longer than 8 MB"));
}

TEST_F(Aravis, ASecondNetworkCardDoesNotTakeItsPhotos) {
  if (std::system("ip link add eth_a type veth peer name eth_b && ip addr add 192.168.77.1/24 dev eth_a && "
                  "ip link set eth_a up && ip link set eth_b up") != 0)
    GTEST_SKIP() << "there can be no second network card here";
  plug_in();
  for (const char* name : {"", "ROOM1"}) {
    auto opened = open(name);
    ASSERT_TRUE(opened) << opened.error().message;
    ASSERT_TRUE((*opened)->arm(5));
    const auto taken = (*opened)->trigger();
    EXPECT_TRUE(taken) << taken.error().message;
  }
}

TEST_F(Aravis, WithoutACameraItSaysWhatToLookAt) {
  const auto opened = open();
  ASSERT_FALSE(opened);
  EXPECT_EQ(opened.error().code, ErrorCode::kDevice);
  EXPECT_THAT(opened.error().message, HasSubstr("camera 'left eye': no GigE Vision or USB3 Vision camera answers"));
}

TEST_F(Aravis, LostPacketsAreAskedForAgain) {
  GigeOptions options = large();
  options.drop_every = 17;
  plug_in(options);
  const auto camera = armed();
  ASSERT_NE(camera, nullptr);
  expect_whole(*camera, 10);
  EXPECT_GT(camera_->resent(), 0);
  EXPECT_EQ(camera_->photos(), 10);
}

TEST_F(Aravis, PhotosWithHolesAreTakenAgainAndNeverGiven) {
  // 135 packets a photo; every 200th is lost: two of three photos have a hole that nobody fills.
  GigeOptions options = large();
  options.drop_every = 200, options.deaf = true;
  plug_in(options);
  const auto camera = armed();
  ASSERT_NE(camera, nullptr);
  expect_whole(*camera, 6);
  EXPECT_GT(camera_->photos(), 6);
  const int before = camera_->photos();
  int lost = 0;
  for (int photo = 0; photo < 6; ++photo) lost += camera->trigger().value().lost;
  EXPECT_EQ(lost, camera_->photos() - before - 6) << "each is told";
}

// A light that somebody sets; a photo of it is of the new one only if that was there when its exposure began.
class Light {
 public:
  void set(std::uint16_t value) {
    const std::lock_guard lock(mutex_);
    former_ = std::exchange(value_, value), since_ = std::chrono::steady_clock::now();
  }
  std::uint16_t of_photo(double exposure_ms) const {
    const std::lock_guard lock(mutex_);
    const std::chrono::duration<double, std::milli> here = std::chrono::steady_clock::now() - since_;
    return here.count() >= exposure_ms ? value_ : former_;
  }

 private:
  mutable std::mutex mutex_;
  std::uint16_t value_ = 0, former_ = 0;
  std::chrono::steady_clock::time_point since_;
};

TEST_F(Aravis, ACameraThatRunsFreelyGivesPhotosThatWereBegunAfterTheQuestion) {
  int lost = 0;
  for (const double loss : {0., .004}) {  // two of five photos have a hole
    GigeOptions options = large();
    options.runs_freely = true, options.loss = loss, options.obeys_after = 3;
    const auto light = std::make_shared<Light>();
    camera_ = std::make_unique<GigeCamera>(options, [light, options](double exposure_ms) {
      const auto value = static_cast<std::uint16_t>(light->of_photo(exposure_ms) + std::lround(exposure_ms));
      return std::vector<std::uint16_t>(static_cast<std::size_t>(options.width) * options.height, value);
    });
    auto opened = open_aravis_camera("left eye", "", {.timeout_s = .5, .tries = 10});
    ASSERT_TRUE(opened) << opened.error().message;
    for (int photo = 1; photo <= 30; ++photo) {
      std::this_thread::sleep_for(std::chrono::milliseconds(7 * photo % 31));  // what waits behind a hole is old
      if (photo % 10 == 1) {
        ASSERT_TRUE((*opened)->arm(photo % 20 == 1 ? 8 : 3));
      }
      const auto value = static_cast<std::uint16_t>(2000 * photo);
      light->set(value);
      const double asked_s = now_s();
      const auto taken = (*opened)->trigger();
      ASSERT_TRUE(taken) << taken.error().message;
      for (const float v : taken->values.data())
        ASSERT_EQ(v, value + taken->exposure_ms) << "photo " << photo << ", loss " << loss;
      EXPECT_GE(taken->timestamp_s, asked_s);
      EXPECT_LE(taken->timestamp_s + 1e-3 * taken->exposure_ms, now_s());
      lost += taken->lost;
    }
    EXPECT_EQ(camera_->resent(), 0);
    EXPECT_EQ(lost > 0, loss > 0);
    opened->reset(), camera_.reset();
  }
}

TEST_F(Aravis, WhereEveryPhotoHasHolesItSaysSo) {
  GigeOptions options = large();
  options.drop_every = 20, options.deaf = true;
  plug_in(options);
  const auto camera = armed();
  ASSERT_NE(camera, nullptr);
  const auto taken = camera->trigger();
  ASSERT_FALSE(taken);
  EXPECT_EQ(taken.error().code, ErrorCode::kDevice);
  EXPECT_THAT(taken.error().message, HasSubstr("parts of every photo were lost on the way, or do not fit it, 3 times"));
}

TEST_F(Aravis, ExposuresItCannotDoAreRefusedAndRoundedOnesAreNamed) {
  GigeOptions options;
  options.exposure_step_us = 3000;
  plug_in(options);
  auto opened = open();
  ASSERT_TRUE(opened) << opened.error().message;
  const auto beyond = (*opened)->arm(1500);
  ASSERT_FALSE(beyond);
  EXPECT_EQ(beyond.error().code, ErrorCode::kBadValue);
  EXPECT_THAT(beyond.error().message, HasSubstr("exposures_ms = 1500 is outside what it can do, 0.01 to 1000 ms"));
  const auto rounded = (*opened)->arm(10);
  ASSERT_FALSE(rounded);
  EXPECT_EQ(rounded.error().code, ErrorCode::kDevice);
  EXPECT_THAT(rounded.error().message, HasSubstr("an exposure of 10 ms was asked for, it reads back 9 ms"));
  EXPECT_TRUE((*opened)->arm(9));
}

TEST_F(Aravis, AutomaticsThatStayOnAreNamed) {
  GigeOptions options;
  options.automatic = 1;
  plug_in(options);
  const auto opened = open();
  ASSERT_FALSE(opened);
  EXPECT_EQ(opened.error().code, ErrorCode::kDevice);
  EXPECT_THAT(opened.error().message, HasSubstr("ExposureAuto was set to Off and reads back Continuous"));
}

TEST_F(Aravis, ACameraThatSendsNothingIsToldFromOneThatIsGone) {
  GigeOptions options;
  options.silent = true;
  plug_in(options);
  auto camera = armed();
  ASSERT_NE(camera, nullptr);
  const auto silent = camera->trigger();
  ASSERT_FALSE(silent);
  EXPECT_THAT(silent.error().message, HasSubstr("answers, but in 3 tries no photo came, each within 0.5 s"));
  camera_->unplug();
  const auto gone = camera->trigger();
  ASSERT_FALSE(gone);
  EXPECT_EQ(gone.error().code, ErrorCode::kDevice);
  EXPECT_THAT(gone.error().message, HasSubstr("camera 'left eye' is gone"));
}

TEST_F(Aravis, APhotoThatIsSmallerThanItSaysIsNeverGiven) {
  GigeOptions options;
  options.lines_short = 3;
  plug_in(options);
  auto camera = armed();
  ASSERT_NE(camera, nullptr);
  const auto taken = camera->trigger();
  ASSERT_FALSE(taken);
  EXPECT_EQ(taken.error().code, ErrorCode::kDevice);
}

TEST_F(Aravis, APhotoThatSaysItIsLargerThanItsBytesIsNeverRead) {
  GigeOptions options;
  options.claimed_width = 2000000000;
  plug_in(options);
  auto camera = armed();
  ASSERT_NE(camera, nullptr);
  const auto taken = camera->trigger();
  ASSERT_FALSE(taken);
  EXPECT_EQ(taken.error().code, ErrorCode::kDevice);
  EXPECT_THAT(taken.error().message, HasSubstr("camera 'left eye'"));
}

TEST_F(Aravis, APhotoThatComesTwiceCountsOnce) {
  GigeOptions options;
  options.repeats_frame = true;
  plug_in(options);
  auto camera = armed();
  ASSERT_NE(camera, nullptr);
  for (int photo = 0; photo < 4; ++photo) {
    const auto taken = camera->trigger();
    ASSERT_TRUE(taken) << taken.error().message;
    EXPECT_EQ(taken->counter, static_cast<std::uint64_t>(photo));
  }
  EXPECT_EQ(camera_->photos(), 7);
}

TEST_F(Aravis, AMosaicBecomesColour) {
  GigeOptions options;
  options.formats = {"BayerGR10"};
  plug_in(options);
  auto camera = armed();
  ASSERT_NE(camera, nullptr);
  const auto taken = camera->trigger();
  ASSERT_TRUE(taken) << taken.error().message;
  EXPECT_EQ(taken->values.channels(), 3);
  EXPECT_EQ(taken->full_scale, 1023);
}

}  // namespace
}  // namespace countershade
