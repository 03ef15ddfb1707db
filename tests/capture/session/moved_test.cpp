// Cameras, projectors and lamps that do not stay as they were while photos are taken.
#include <gmock/gmock.h>

#include "tests/capture/session/fake_session.h"

namespace countershade::capture {
namespace {

using namespace fake;
using testing::AllOf;
using testing::HasSubstr;
namespace fs = std::filesystem;

TEST(CaptureSession, MovedCameraIsRefusedAndNothingStoredChanges) {
  fake::Scratch scratch("moved");
  undisturbed(scratch / "s");
  fs::remove(photo(scratch / "s", 12));
  const auto before = fake::tree(scratch / "s");
  auto room = std::make_shared<Room>();
  room->shift_px = 2;
  const auto done = run(room, scratch / "s");
  ASSERT_FALSE(done);
  EXPECT_EQ(done.error().code, ErrorCode::kRefused);
  EXPECT_THAT(done.error().message, AllOf(HasSubstr("camera 'cam'"), HasSubstr("moved"), HasSubstr("(allowed 0.25 px"),
                                          HasSubstr("another folder")));
  EXPECT_EQ(fake::tree(scratch / "s"), before);
}

TEST(CaptureSession, CameraThatMovesMeanwhileHasAllFramesTakenAgain) {
  fake::Scratch scratch("bumped");
  auto moved = std::make_shared<Room>();
  moved->shift_px = 3;
  ASSERT_TRUE(run(moved, scratch / "moved"));
  const auto expected = fake::tree(scratch / "moved");
  for (const int frame : {1, 6, 9, 16}) {  // of 16: before it is stored; 16: after the last
    auto room = std::make_shared<Room>();
    room->bump_at = kFirst + frame, room->bump_px = 3;
    Listener listener;
    const fs::path folder = scratch / std::to_string(frame);
    const auto done = run(room, folder, fake::rig(), listener);
    ASSERT_TRUE(done) << done.error().message;
    EXPECT_THAT(listener.said, AllOf(HasSubstr("moved"), HasSubstr("all 16 frames are taken again"))) << frame;
    EXPECT_TRUE(fs::exists(folder / "outdated/cam/0000.tif")) << "nothing is thrown away";
    fs::remove_all(folder / "outdated");
    EXPECT_EQ(fake::tree(folder), expected) << frame;
  }
}

// Its white and black are the same, its later pairs add up, and no camera moved: only its first stripes tell.
TEST(CaptureSession, PictureThatShiftsOnItsProjectorIsFoundByItsStripes) {
  fake::Scratch scratch("rolled");
  auto rolled = std::make_shared<Room>();
  rolled->roll_px = 1;
  ASSERT_TRUE(run(rolled, scratch / "rolled"));
  auto room = std::make_shared<Room>();
  room->roll_at = kFirst + 4, room->roll_px = 1;
  Listener listener;
  const auto done = run(room, scratch / "s", fake::rig(), listener);
  ASSERT_TRUE(done) << done.error().message;
  EXPECT_THAT(listener.said, AllOf(HasSubstr("(gray x bit"), HasSubstr("all 16 frames are taken again")));
  fs::remove_all(scratch / "s/outdated");
  EXPECT_EQ(fake::tree(scratch / "s"), fake::tree(scratch / "rolled"));
}

// Frames that are of two lights do not add up, and no display is to blame.
TEST(CaptureSession, LampThatIsSwitchedOnMeanwhileHasAllFramesTakenAgain) {
  fake::Scratch scratch("lamp-on");
  auto lit = std::make_shared<Room>();
  lit->lamp = 1.4;
  ASSERT_TRUE(run(lit, scratch / "lit"));
  auto room = std::make_shared<Room>();
  room->lamp_at = kFirst + 5, room->lamp_to = 1.4;
  Listener listener;
  const auto done = run(room, scratch / "s", fake::rig(), listener);
  ASSERT_TRUE(done) << done.error().message;
  EXPECT_THAT(listener.said, AllOf(HasSubstr("do not add up"), HasSubstr("all 16 frames are taken again")));
  fs::remove_all(scratch / "s/outdated");
  EXPECT_EQ(fake::tree(scratch / "s"), fake::tree(scratch / "lit"));
}

// Whenever it is pushed twice: what is accepted shows one view, and what does not is refused.
TEST(CaptureSession, CameraThatIsPushedTwiceIsRefusedOrAllPhotosShowOneView) {
  fake::Scratch scratch("restless");
  std::vector<std::map<std::string, std::string>> views;
  for (const int shift : {0, 3, 6, 9, 12, 15}) {
    auto room = std::make_shared<Room>();
    room->shift_px = shift;
    const fs::path folder = scratch / fmt::format("view{}", shift);
    ASSERT_TRUE(run(room, folder));
    views.push_back(fake::tree(folder));
  }
  int refused = 0;
  for (int again = 8; again < 34; ++again) {
    auto room = std::make_shared<Room>();
    room->bump_at = kFirst + 6, room->bump_px = 3, room->bump_again = again;
    const fs::path folder = scratch / std::to_string(again);
    Listener listener;
    const auto done = run(room, folder, fake::rig(), listener);
    if (!done) {
      ++refused;
      continue;
    }
    fs::remove_all(folder / "outdated");
    const auto found = fake::tree(folder);
    std::string shown;  // the view of each photo
    for (const auto& [name, bytes] : found)
      for (std::size_t v = 0; v < views.size() && name.ends_with(".tif"); ++v)
        if (views[v].at(name) == bytes) shown += std::to_string(v);
    EXPECT_NE(std::find(views.begin(), views.end(), found), views.end()) << again << ": " << shown << listener.said;
  }
  EXPECT_GE(refused, 3);
}

TEST(CaptureSession, LampThatDriftedALittleIsNoMovedCamera) {
  fake::Scratch scratch("lamp");
  undisturbed(scratch / "s");
  fs::remove(photo(scratch / "s", 12));
  auto room = std::make_shared<Room>();
  room->lamp = 1.2;
  const auto done = run(room, scratch / "s");
  ASSERT_FALSE(done);
  EXPECT_EQ(done.error().code, ErrorCode::kRefused);
  EXPECT_THAT(done.error().message, HasSubstr("brightness changed by 20.0 %"));
  room = std::make_shared<Room>();
  room->lamp = 1.05;
  EXPECT_TRUE(run(room, scratch / "s"));
}

}  // namespace
}  // namespace countershade::capture
