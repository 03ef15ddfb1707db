#include "capture/device/command.h"

#include <gmock/gmock.h>

#include <chrono>
#include <thread>

#include "calib/image/image_file.h"
#include "tests/capture/fake_room.h"

namespace countershade::capture {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;
namespace fs = std::filesystem;

std::string message_of(const std::string& command, double timeout_s = 20) {
  const auto camera = open_command_camera("cam", command, {.timeout_s = timeout_s});
  if (!camera) return camera.error().message;
  EXPECT_TRUE((*camera)->arm(0));
  const auto photo = (*camera)->trigger();
  EXPECT_TRUE(photo || photo.error().code == ErrorCode::kDevice);
  return photo ? "a photo" : photo.error().message;
}

TEST(CommandCamera, EveryRunIsAPhoto) {
  fake::Scratch scratch("command's camera");  // a name that a shell must not take apart
  for (int i : {0, 1})
    ASSERT_TRUE(write_stored16(scratch / fmt::format("{}.png", i), Image(5, 3, 1, static_cast<float>(100 + i))));
  const std::string folder = (scratch / "").string();
  const auto camera = open_command_camera(
      "cam", fmt::format("cd \"{0}\" && cp $(cat next 2>/dev/null || echo 0).png {{file}}.png && echo 1 > next && "
                         "echo {{exposure_ms}} {{exposure_s}} >> asked",
                         folder));
  ASSERT_TRUE(camera);
  for (const double ms : {8.0, 12.5}) {
    ASSERT_TRUE((*camera)->arm(ms));
    const auto photo = (*camera)->trigger();
    ASSERT_TRUE(photo) << photo.error().message;
    const int i = ms == 8 ? 0 : 1;
    EXPECT_EQ(photo->values.at(2, 1), 100 + i);
    EXPECT_EQ(photo->counter, static_cast<std::uint64_t>(i));
    EXPECT_EQ(photo->exposure_ms, ms);
  }
  EXPECT_EQ(fake::bytes_of(scratch / "asked"), "8 0.008\n12.5 0.0125\n");
}

TEST(CommandCamera, WhatWentWrongIsToldInTheCommandsOwnWords) {
  EXPECT_THAT(message_of("no-such-program {file}.tif"),
              AllOf(HasSubstr("camera 'cam'"), HasSubstr("exit code 127"), HasSubstr("not found")));
  EXPECT_THAT(message_of("echo first; echo 'Could not claim the USB device' >&2; exit 3; : {file}"),
              AllOf(HasSubstr("exit code 3"), HasSubstr("(it said: Could not claim the USB device)")));
  EXPECT_THAT(message_of("kill -9 $$; : {file}"), HasSubstr("exit code 137"));
}

TEST(CommandCamera, WithoutAPhotoItSaysWhatIsThereInstead) {
  EXPECT_THAT(message_of("touch {file}.nef"), AllOf(HasSubstr("000000.nef"), HasSubstr("TIFF")));
  EXPECT_THAT(message_of(": {file}"), HasSubstr("but nothing"));
  EXPECT_THAT(message_of("echo 'II*' > {file}.tif"), HasSubstr("000000.tif"));
  EXPECT_THAT(message_of("gphoto2 --capture-image"), AllOf(HasSubstr("{file}"), HasSubstr("--filename")));
}

// A camera that hangs is stopped, and with it what the command has started.
TEST(CommandCamera, OneThatHangsIsStopped) {
  fake::Scratch scratch("hangs");
  const auto begun = std::chrono::steady_clock::now();
  EXPECT_THAT(message_of(fmt::format("(sleep 3; touch '{}') | cat; : {{file}}", (scratch / "late").string()), 0.3),
              AllOf(HasSubstr("0.3 s"), HasSubstr("stopped")));
  EXPECT_LT(std::chrono::steady_clock::now() - begun, std::chrono::seconds(2));
  std::this_thread::sleep_for(begun + std::chrono::milliseconds(3500) - std::chrono::steady_clock::now());
  EXPECT_FALSE(fs::exists(scratch / "late"));
}

// A program that it leaves in the background, as a monitor of the camera, does not keep it waiting.
TEST(CommandCamera, WhatRunsOnInTheBackgroundIsNotWaitedFor) {
  const auto begun = std::chrono::steady_clock::now();
  EXPECT_THAT(message_of("sleep 5 & touch {file}.nef"), HasSubstr("nef"));
  EXPECT_LT(std::chrono::steady_clock::now() - begun, std::chrono::seconds(3));
}

TEST(CommandCamera, SeveralExposuresNeedACommandThatHearsOfThem) {
  const auto deaf = open_command_camera("cam", "touch {file}.tif").value();
  ASSERT_TRUE(deaf->arm(8));
  EXPECT_TRUE(deaf->arm(8));
  const auto second = deaf->arm(32);
  ASSERT_FALSE(second);
  EXPECT_THAT(second.error().message, AllOf(HasSubstr("8 and 32 ms"), HasSubstr("{exposure_s}")));
  const auto hearing = open_command_camera("cam", "touch {file}.tif # {exposure_s}").value();
  EXPECT_TRUE(hearing->arm(8) && hearing->arm(32));
}

TEST(CommandCamera, LeavesNothingBehind) {
  const auto count = [] {
    int folders = 0;
    for (const auto& entry : fs::directory_iterator(fs::temp_directory_path()))
      folders += entry.path().filename().string().starts_with("countershade-photos-");
    return folders;
  };
  const int before = count();
  EXPECT_THAT(message_of("touch {file}.nef"), HasSubstr("nef"));
  EXPECT_LE(count(), before);  // others may run beside this one, and end
}

}  // namespace
}  // namespace countershade::capture
