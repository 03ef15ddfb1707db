#include "capture/device/folder.h"

#include <gmock/gmock.h>

#include <thread>

#include "calib/image/image_file.h"
#include "tests/capture/fake_room.h"

namespace countershade::capture {
namespace {

using testing::AllOf;
using testing::HasSubstr;
namespace fs = std::filesystem;

Image numbered(int number) {
  return Image(5, 3, 1, static_cast<float>(100 + number));
}

TEST(FolderCamera, GivesPhotosInOrderAndWaitsForTheNext) {
  fake::Scratch scratch("foldercamera");
  fs::create_directories(scratch / "in");
  for (int i : {3, 4}) ASSERT_TRUE(write_stored16(scratch / fmt::format("in/{:04}.png", i), numbered(i)));
  std::ofstream(scratch / "in/notes.txt") << "not a photo";
  auto camera = open_folder_camera("cam", scratch / "in", {.timeout_s = 20, .poll_s = 0.005});
  ASSERT_TRUE(camera);
  ASSERT_TRUE((*camera)->arm(7));
  std::thread later([&] {
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
    std::ofstream(scratch / "in/0005.tif") << "II*";  // still being written
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
    ASSERT_TRUE(write_stored16(scratch / "in/0005.tif", numbered(5)));
  });
  for (int i : {3, 4, 5}) {
    const auto exposure = (*camera)->trigger();
    ASSERT_TRUE(exposure) << exposure.error().message;
    EXPECT_EQ(exposure->values.data(), numbered(i).data());
    EXPECT_EQ(exposure->counter, static_cast<std::uint64_t>(i));
    EXPECT_EQ(exposure->exposure_ms, 7);
    EXPECT_EQ(exposure->full_scale, 65535);
  }
  later.join();
}

TEST(FolderCamera, NamesThePhotoThatDoesNotCome) {
  fake::Scratch scratch("foldergap");
  fs::create_directories(scratch / "in");
  for (int i : {0, 2}) ASSERT_TRUE(write_stored16(scratch / fmt::format("in/{:04}.png", i), numbered(i)));
  auto camera = open_folder_camera("cam", scratch / "in", {.timeout_s = 0.05, .poll_s = 0.005});
  ASSERT_TRUE(camera);
  ASSERT_TRUE((*camera)->arm(0));
  ASSERT_TRUE((*camera)->trigger());
  const auto missing = (*camera)->trigger();  // 0002 is no substitute for 0001
  ASSERT_FALSE(missing);
  EXPECT_EQ(missing.error().code, ErrorCode::kDevice);
  EXPECT_THAT(missing.error().message, AllOf(HasSubstr("0001"), HasSubstr("camera 'cam'"), HasSubstr("0.05 s")));
}

TEST(FolderCamera, FolderThatIsNotThereIsNamed) {
  const auto camera = open_folder_camera("cam", "/nowhere/photos");
  ASSERT_FALSE(camera);
  EXPECT_THAT(camera.error().message, HasSubstr("/nowhere/photos"));
}

TEST(FolderProjector, WritesEachPictureAfterTheLast) {
  fake::Scratch scratch("folderprojector");
  Picture picture(4, 3, 3);
  for (std::size_t i = 0; i < picture.data().size(); ++i)
    picture.data()[i] = static_cast<std::uint16_t>(257 * (i * 7 % 256));
  for (int round = 0; round < 2; ++round) {  // opened again it goes on counting
    auto projector = open_folder_projector("left", 4, 3, scratch / "out");
    ASSERT_TRUE(projector);
    ASSERT_TRUE((*projector)->show(picture));
    EXPECT_EQ(read_picture(scratch / fmt::format("out/{:04}.png", round)).value().data(), picture.data());
  }
  auto projector = open_folder_projector("left", 4, 3, scratch / "out");
  EXPECT_THROW((void)(*projector)->show(Picture(3, 4, 3)), Bug);
}

}  // namespace
}  // namespace countershade::capture
