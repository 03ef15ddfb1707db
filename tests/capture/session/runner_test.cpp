#include "capture/session/runner.h"

#include <gmock/gmock.h>

#include "calib/image/image_file.h"
#include "tests/capture/session/fake_session.h"

namespace countershade::capture {
namespace {

using namespace fake;
using testing::AllOf;
using testing::HasSubstr;
namespace fs = std::filesystem;

TEST(CaptureSession, StoresWhatTheCameraSawOfEveryFrame) {
  fake::Scratch scratch("stores");
  auto room = std::make_shared<Room>();
  Listener listener;
  ASSERT_TRUE(run(room, scratch / "s", fake::rig(2), listener));
  const auto session = Session::open(scratch / "s");
  ASSERT_TRUE(session) << session.error().message;
  const Sequence sequence = fake::sequence();
  for (const Frame& frame : sequence.frames) {
    auto alone = std::make_shared<Room>();
    Devices devices = fake::devices(alone, fake::rig());
    for (const auto& [id, size] : sequence.projectors)
      ASSERT_TRUE(devices.projector(id)->show(render_role(frame.role, id, size[0], size[1]).value()));
    ASSERT_TRUE(devices.cameras[0]->arm(0));
    const Exposure expected = devices.cameras[0]->trigger().value();
    EXPECT_EQ(read_image(photo(scratch / "s", frame.index)).value().values.data(), expected.values.data())
        << frame.index;
  }
  EXPECT_TRUE(fs::exists(scratch / "s/photos/side/0003_4.0ms.tif"));
  EXPECT_TRUE(fs::exists(scratch / "s/photos/side/0003_12.5ms.tif"));
  const double total = static_cast<double>(sequence.frames.size());
  EXPECT_EQ(listener.steps.front(), std::pair(0.0, total));
  EXPECT_EQ(listener.steps.back(), std::pair(total, total));
  EXPECT_EQ(listener.said, "");  // nothing was doubted
}

TEST(CaptureSession, AnyLatencyUpToTheRetakesGivesTheSameSession) {
  fake::Scratch scratch("latency");
  const auto expected = undisturbed(scratch / "plain");
  for (int latency : {1, 2, 3}) {
    auto room = std::make_shared<Room>();
    room->latency = latency;
    const fs::path folder = scratch / std::to_string(latency);
    const auto done = run(room, folder);
    ASSERT_TRUE(done) << done.error().message;
    EXPECT_EQ(fake::tree(folder), expected) << latency;
  }
}

TEST(CaptureSession, WaitsByTheClockOfTheDevices) {
  fake::Scratch scratch("clock");
  auto room = std::make_shared<Room>();
  room->latency = 1;
  Devices devices = fake::devices(room, fake::rig());
  double passed = 0;
  devices.clock = [&](double ms) { passed += ms; };
  SilentProgress silent;
  const CaptureOptions patient{.retakes = 3, .retake_wait_ms = 1e6};  // a quarter of an hour by the wall's clock
  const auto done = capture_session(fake::rig(), "", fake::sequence(), devices, scratch / "s", patient, silent);
  ASSERT_TRUE(done) << done.error().message;
  EXPECT_GE(passed, 1e6);
}

TEST(CaptureSession, NoiseIsNeitherTakenForAChangeNorHidesOne) {
  fake::Scratch scratch("noise");
  ASSERT_TRUE(undisturbed(scratch / "plain").size());
  for (int latency : {0, 1}) {
    auto room = std::make_shared<Room>();
    room->latency = latency;
    room->noise = 10000;  // full well of the studies' camera
    const fs::path folder = scratch / std::to_string(latency);
    Listener listener;
    const auto done = run(room, folder, fake::rig(), listener);
    ASSERT_TRUE(done) << done.error().message;
    if (latency == 0) {
      EXPECT_EQ(listener.said, "");
    }
    for (const Frame& frame : fake::sequence().frames) {
      const Image a = read_image(photo(folder, frame.index)).value().values;
      const Image b = read_image(photo(scratch / "plain", frame.index)).value().values;
      double sum = 0;
      for (std::size_t i = 0; i < a.data().size(); ++i) sum += std::abs(a.data()[i] - b.data()[i]) / 65535;
      // Noise is at most 0.8 sqrt(.5 / 10000) = .6 % on average; a wrong frame changes .08 (half of a bounced tenth) or
      // more.
      EXPECT_LT(sum / static_cast<double>(a.data().size()), 0.008) << frame.index;
    }
  }
}

TEST(CaptureSession, DisplayThatStandsStillIsAnErrorThatNamesTheFrame) {
  fake::Scratch scratch("frozen");
  auto room = std::make_shared<Room>();
  // Four shows to settle, seven probes, white, black: frame 2 is the first that does not appear.
  room->frozen_after = 12;
  const auto done = run(room, scratch / "s");
  ASSERT_FALSE(done);
  EXPECT_EQ(done.error().code, ErrorCode::kDevice);
  EXPECT_THAT(done.error().message, AllOf(HasSubstr("frame 2 (gray x bit 4"), HasSubstr("camera 'cam'"),
                                          HasSubstr("4 tries"), HasSubstr("latency"), HasSubstr("display")));
  EXPECT_EQ(photos_in(scratch / "s"), 2);  // the photos before it are good and kept
  const auto expected = undisturbed(scratch / "plain");
  ASSERT_TRUE(run(std::make_shared<Room>(), scratch / "s"));
  EXPECT_EQ(fake::tree(scratch / "s"), expected);
}

// Half of each picture falls beside the screen, and the coarsest stripe lies there whole: its photo is black's, and the
// display is not to blame.
TEST(CaptureSession, PictureThatFallsBesideTheScreenIsNoStaleOne) {
  fake::Scratch scratch("beside");
  auto room = std::make_shared<Room>();
  room->beside = 0.5;
  Listener listener;
  const auto done = run(room, scratch / "s", fake::rig(), listener);
  ASSERT_TRUE(done) << done.error().message;
  EXPECT_THAT(listener.said, AllOf(HasSubstr("gray x bit 4"), HasSubstr("falls beside what the cameras see")));
  EXPECT_EQ(photos_in(scratch / "s"), fake::sequence().frames.size());
  room = std::make_shared<Room>();
  room->beside = 0.5, room->frozen_after = 12;  // and one that stands still is still found
  EXPECT_FALSE(run(room, scratch / "frozen"));
}

TEST(CaptureSession, DisplayThatNeverChangesLeavesNoPhoto) {
  fake::Scratch scratch("dead");
  auto room = std::make_shared<Room>();
  room->frozen_after = 0;
  const auto done = run(room, scratch / "s");
  ASSERT_FALSE(done);
  EXPECT_EQ(done.error().code, ErrorCode::kDevice);
  EXPECT_THAT(done.error().message, AllOf(HasSubstr("no camera sees a change between black and white"),
                                          HasSubstr("4 tries"), HasSubstr("lens cap")));
  EXPECT_EQ(photos_in(scratch / "s"), 0);
}

TEST(CaptureSession, InverseThatDoesNotAddUpIsRetaken) {
  fake::Scratch scratch("pair");
  const auto expected = undisturbed(scratch / "plain");
  auto room = std::make_shared<Room>();
  room->wrong[kFirst + 5] = 2;
  Listener listener;
  ASSERT_TRUE(run(room, scratch / "s", fake::rig(), listener));
  EXPECT_THAT(listener.said, AllOf(HasSubstr("frame 5"), HasSubstr("do not add up to white + black")));
  EXPECT_EQ(fake::tree(scratch / "s"), expected);
}

TEST(CaptureSession, PartnerOfAPairThatDoesNotAddUpIsRetakenToo) {
  fake::Scratch scratch("partner");
  const auto expected = undisturbed(scratch / "plain");
  auto room = std::make_shared<Room>();
  room->wrong[kFirst + 4] = 2;  // frame 4 shows frame 2: a change against frame 3, so only its inverse tells
  Listener listener;
  ASSERT_TRUE(run(room, scratch / "s", fake::rig(), listener));
  EXPECT_THAT(listener.said, HasSubstr("do not add up to white + black"));
  EXPECT_EQ(fake::tree(scratch / "s"), expected);
}

TEST(CaptureSession, FlickerDoesNotMakeAnOldPictureANewOne) {
  fake::Scratch scratch("flicker");
  auto room = std::make_shared<Room>();
  room->flicker = 0.02;
  room->wrong[kFirst + 1] = 1;  // the photo of black shows the white before it, two percent brighter
  Listener listener;
  ASSERT_TRUE(run(room, scratch / "s", fake::rig(), listener));
  EXPECT_THAT(listener.said, HasSubstr("frame 1 (black of left): camera 'cam' still shows the former frame"));
}

// Sinusoids look alike from far away: which of them a photo shows is told by single pixels.
TEST(CaptureSession, ASinusoidThatIsPhotographedTooEarlyIsTakenAgain) {
  fake::Scratch scratch("sinusoids");
  Rig rig = fake::rig();
  rig.projectors[0].resolution = {320, 200};  // two periods in each of the blocks that frames are told apart by
  Sequence sequence = fake::short_sequence();
  sequence.projectors[0].second = {320, 200};
  sequence.frames.resize(2);
  Role role;
  role.kind = "phase", role.projector = "left", role.period_px = 7.3, role.steps = 3;
  for (const char* axis : {"x", "y"})
    for (role.step = 0; role.step < 3; ++role.step)
      role.axis = axis, sequence.frames.push_back({static_cast<int>(sequence.frames.size()), role});
  SilentProgress silent;
  const auto room = std::make_shared<Room>();
  ASSERT_TRUE(run(room, scratch / "right", rig, silent, sequence));
  int retaken = 0;  // one projector is lit: half as many photos at the end
  for (int trigger = kFirst + 2; trigger < room->triggers - kLast / 2; ++trigger) {
    const auto late = std::make_shared<Room>();
    late->wrong[trigger] = 1;
    const fs::path folder = scratch / std::to_string(trigger);
    ASSERT_TRUE(run(late, folder, rig, silent, sequence)) << trigger;
    EXPECT_EQ(fake::tree(folder), fake::tree(scratch / "right")) << trigger;
    retaken += late->triggers > room->triggers;
  }
  EXPECT_GE(retaken, 5);
}

TEST(CaptureSession, DevicesThatDoNotMatchTheRigAreRefusedBeforeAnythingIsWritten) {
  fake::Scratch scratch("devices");
  const Rig rig = fake::rig();
  SilentProgress silent;
  const auto expect = [&](const Devices& devices, const Sequence& sequence, ErrorCode code, const std::string& part) {
    const auto done = capture_session(rig, "", sequence, devices, scratch / "s", kQuick, silent);
    ASSERT_FALSE(done);
    EXPECT_EQ(done.error().code, code);
    EXPECT_THAT(done.error().message, HasSubstr(part));
    EXPECT_FALSE(fs::exists(scratch / "s"));
  };
  Devices devices = fake::devices(std::make_shared<Room>(), rig);
  devices.cameras.clear();
  expect(devices, fake::sequence(), ErrorCode::kDevice, "camera 'cam'");
  devices = fake::devices(std::make_shared<Room>(), rig);
  devices.projectors.pop_back();
  expect(devices, fake::sequence(), ErrorCode::kDevice, "projector 'right'");
  devices.projectors.push_back(std::make_unique<fake::FakeProjector>(std::make_shared<Room>(), "right", 25, 16));
  expect(devices, fake::sequence(), ErrorCode::kDevice, "25x16");
  Sequence other = fake::sequence();
  other.projectors[1].second = {25, 16};
  expect(devices, other, ErrorCode::kBadValue, "24x16");
  other.projectors[1].first = "rihgt";
  expect(devices, other, ErrorCode::kBadValue, "rihgt");
  other.frames.clear();
  expect(devices, other, ErrorCode::kBadValue, "no frames");
}

TEST(CaptureSession, TwelveBitNumbersKeepTheirMeaning) {
  fake::Scratch scratch("bits");
  undisturbed(scratch / "plain");
  Rig said = fake::rig();
  said.cameras[0].full_scale = 4095;
  for (const Rig& rig : {fake::rig(), said}) {
    auto room = std::make_shared<Room>();
    room->full_scale = 4095;
    const fs::path folder = scratch / (rig.cameras[0].full_scale ? "said" : "unsaid");
    ASSERT_TRUE(run(room, folder, rig));
    const auto session = Session::open(folder);
    const auto plain = Session::open(scratch / "plain");
    ASSERT_TRUE(session && plain);
    const Image a = session->photo("cam", 2).value().value, b = plain->photo("cam", 2).value().value;
    for (std::size_t i = 0; i < a.data().size(); ++i)
      ASSERT_NEAR(a.data()[i], b.data()[i], 0.6 / 4095);  // half a step of 12 bits, and one of 16
  }
}

TEST(WritePatterns, FolderHoldsSequenceAndEveryPictureAsSent) {
  fake::Scratch scratch("patterns");
  const Sequence sequence = fake::sequence();
  ASSERT_TRUE(write_patterns(sequence, scratch / "p"));
  const auto read = read_sequence(scratch / "p/sequence.json");
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_EQ(sequence_text(*read), sequence_text(sequence));
  for (const Frame& frame : sequence.frames)
    for (const auto& [id, size] : sequence.projectors) {
      const auto picture = read_picture((scratch / "p") / fmt::format("{:04}", frame.index) / (id + ".png"));
      ASSERT_TRUE(picture) << picture.error().message;
      EXPECT_EQ(picture->data(), render_role(frame.role, id, size[0], size[1])->data());
    }
  const auto again = write_patterns(sequence, scratch / "p");
  ASSERT_FALSE(again);
  EXPECT_EQ(again.error().code, ErrorCode::kExists);
}

TEST(WritePatterns, KindThatCannotBeDrawnLeavesNoFolder) {
  fake::Scratch scratch("nopatterns");
  Sequence sequence = fake::sequence();
  sequence.frames[3].role.kind = "hologram";
  const auto done = write_patterns(sequence, scratch / "p");
  ASSERT_FALSE(done);
  EXPECT_EQ(done.error().code, ErrorCode::kUnsupported);
  EXPECT_FALSE(fs::exists(scratch / "p"));
}

}  // namespace
}  // namespace countershade::capture
