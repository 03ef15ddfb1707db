// What is decoded while photos are taken against what their session gives.
#include "capture/session/live_decoding.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "capture/session/runner.h"
#include "tests/capture/fake_room.h"
#include "tests/support/same.h"

namespace countershade::capture {
namespace {

namespace fs = std::filesystem;
using fake::Room;

// Gray code of both projectors.
Sequence code() {
  std::vector<std::pair<std::string, int>> bits;
  for (const char* axis : {"x", "y"})
    for (int bit = 4; bit >= 0; --bit) bits.emplace_back(axis, bit);
  return fake::sequence(bits);
}

struct Captured {
  std::vector<Result<Correspondence>> live;
  std::vector<int> stored;  // frames, as they were told
};

Captured captured(const std::shared_ptr<Room>& room, const fs::path& folder) {
  SilentProgress silent;
  Captured result;
  LiveDecoding decoding(folder, code(), "cam");
  CaptureOptions options;
  options.retake_wait_ms = 0;
  options.stored = [&](int frame) { result.stored.push_back(frame), decoding.stored(frame); };
  const Rig rig = fake::rig();
  const Devices devices = fake::devices(room, rig);
  const auto done = capture_session(rig, "", code(), devices, folder, options, silent);
  EXPECT_TRUE(done) << done.error().message;
  result.live = decoding.finish();
  return result;
}

void expect_as_decoded(const Captured& c, const fs::path& folder) {
  SilentProgress silent;
  const Session session = Session::open(folder).value();
  ASSERT_EQ(c.live.size(), 2u);
  for (std::size_t q = 0; q < 2; ++q) {
    const auto read = decode(session, "cam", code().projectors[q].first, {}, silent);
    ASSERT_TRUE(read && c.live[q]) << q;
    EXPECT_GT(read->accepted, 100u);
    testing::expect_same(*c.live[q], *read);
  }
}

constexpr int kFirst = 16;  // triggers: two to settle, 14 that wait for black and white, then one a frame

TEST(LiveDecoding, IsThatOfTheSession) {
  fake::Scratch scratch("live");
  const Captured c = captured(std::make_shared<Room>(), scratch / "s");
  std::vector<int> all;
  for (const Frame& f : code().frames) all.push_back(f.index);
  EXPECT_EQ(c.stored, all);
  expect_as_decoded(c, scratch / "s");
}

// The first photo of frame 4 shows another picture; it is stored, and told from its inverse only. Both are taken again.
TEST(LiveDecoding, APartnerThatIsRetakenTakesTheOldPhotosPlace) {
  fake::Scratch scratch("partner");
  auto room = std::make_shared<Room>();
  room->wrong[kFirst + 4] = 2;
  const Captured c = captured(room, scratch / "s");
  EXPECT_EQ(std::count(c.stored.begin(), c.stored.end(), 4), 2);
  EXPECT_EQ(c.stored.size(), code().frames.size() + 1);
  expect_as_decoded(c, scratch / "s");
}

TEST(LiveDecoding, TakesUpWhatAFormerCaptureLeft) {
  fake::Scratch scratch("resumed");
  captured(std::make_shared<Room>(), scratch / "s");
  const Session session = Session::open(scratch / "s").value();
  for (int frame : {1, 7, 30}) fs::remove(session.photo_path("cam", frame));
  expect_as_decoded(captured(std::make_shared<Room>(), scratch / "s"), scratch / "s");
}

TEST(LiveDecoding, WhatIsMissingOrCannotBeReadIsAnErrorOfItsProjectorAlone) {
  fake::Scratch scratch("missing");
  captured(std::make_shared<Room>(), scratch / "s");
  const Session session = Session::open(scratch / "s").value();
  LiveDecoding few(scratch / "s", code(), "cam");
  for (const Frame& f : code().frames)
    if (f.index != 3) few.stored(f.index);
  const auto some = few.finish();
  ASSERT_TRUE(!some[0] && some[1]);
  EXPECT_THAT(some[0].error().message, ::testing::HasSubstr("photo 0003 of its code is missing"));
  fs::resize_file(session.photo_path("cam", 30), 100);
  LiveDecoding broken(scratch / "s", code(), "cam");
  for (const Frame& f : code().frames) broken.stored(f.index);
  const auto others = broken.finish();
  ASSERT_TRUE(others[0] && !others[1]);
  EXPECT_THAT(others[1].error().message, ::testing::HasSubstr("0030.tif"));
  LiveDecoding idle(scratch / "s", code(), "cam");  // and goes without having been asked
  idle.stored(0);
}

}  // namespace
}  // namespace countershade::capture
