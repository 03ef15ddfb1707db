#include "capture/session/runner.h"

#include <gmock/gmock.h>
#include <sys/wait.h>

#include "calib/image/image_file.h"
#include "capture/device/health.h"
#include "capture/session/session_folder.h"
#include "tests/capture/fake_room.h"

namespace countershade::capture {
namespace {

using fake::Room;
using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
namespace fs = std::filesystem;

const CaptureOptions kQuick{.retakes = 3, .retake_wait_ms = 0};

struct Listener final : Progress {
  std::vector<std::pair<double, double>> steps;
  std::string said;
  void step(std::string_view, double done, double total) override { steps.emplace_back(done, total); }
  void note(std::string_view text) override { said += std::string(text) + "\n"; }
  void warn(std::string_view text) override { said += std::string(text) + "\n"; }
};

Result<void> run(const std::shared_ptr<Room>& room, const fs::path& folder, const Rig& rig, Progress& progress,
                 const Sequence& sequence = fake::sequence()) {
  const Devices devices = fake::devices(room, rig);
  return capture_session(rig, "", sequence, devices, folder, kQuick, progress);
}

Result<void> run(const std::shared_ptr<Room>& room, const fs::path& folder, const Rig& rig = fake::rig()) {
  SilentProgress silent;
  return run(room, folder, rig, silent);
}

Result<void> run_short(const std::shared_ptr<Room>& room, const fs::path& folder) {
  SilentProgress silent;
  return run(room, folder, fake::rig(2), silent, fake::short_sequence());
}

std::map<std::string, std::string> undisturbed(const fs::path& folder) {
  const auto done = run(std::make_shared<Room>(), folder);
  EXPECT_TRUE(done) << done.error().message;
  return fake::tree(folder);
}

fs::path photo(const fs::path& session, int index) {
  return session / "photos/cam" / photo_name(index, "", ".tif");
}

std::size_t photos_in(const fs::path& session) {
  std::size_t count = 0;
  for (const auto& [name, bytes] : fake::tree(session)) count += name.ends_with(".tif");
  return count;
}

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

// Triggers: two to settle, seven times two until black and white are seen, then one a frame.
constexpr int kFirst = 16;
// And at the end for each projector its first bright frame, and its first stripes on both axes.
constexpr int kLast = 6;

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

TEST(CaptureSession, CompleteSessionIsLeftAlone) {
  fake::Scratch scratch("complete");
  const auto expected = undisturbed(scratch / "s");
  auto room = std::make_shared<Room>();
  ASSERT_TRUE(run(room, scratch / "s"));
  EXPECT_EQ(room->triggers, 0);
  EXPECT_EQ(fake::tree(scratch / "s"), expected);
}

TEST(CaptureSession, ResumeTakesOnlyWhatIsMissing) {
  fake::Scratch scratch("missing");
  const auto expected = undisturbed(scratch / "s");
  fs::remove(photo(scratch / "s", 6));
  fs::resize_file(photo(scratch / "s", 9), 100);
  std::ofstream(scratch / "s/photos/cam/.writing-1-0006.tif") << "killed while it was written";
  auto room = std::make_shared<Room>();
  Listener listener;
  ASSERT_TRUE(run(room, scratch / "s", fake::rig(), listener));
  EXPECT_EQ(room->triggers, kFirst + 2 + kLast);  // the reference twice, the probes, and the two photos
  EXPECT_THAT(listener.said, AllOf(HasSubstr("0009.tif"), HasSubstr("taken again")));
  EXPECT_EQ(fake::tree(scratch / "s"), expected);
}

// Stripes too fine for a prediction, where the capture was stopped: only a latency that is known beforehand helps.
TEST(CaptureSession, ResumeMeasuresTheLatencyBeforeTheFirstFrame) {
  fake::Scratch scratch("late");
  const auto expected = undisturbed(scratch / "s");
  for (int index : {6, 7, 14}) fs::remove(photo(scratch / "s", index));
  auto room = std::make_shared<Room>();
  room->latency = 2;
  Listener listener;
  ASSERT_TRUE(run(room, scratch / "s", fake::rig(), listener));
  EXPECT_THAT(listener.said, HasSubstr("each picture is shown 3 times"));
  // The reference, the probe until it is seen, six more probes, and each photo once.
  EXPECT_EQ(room->triggers, 2 + 3 * 2 + 6 * 2 + 3 + kLast);
  EXPECT_EQ(fake::tree(scratch / "s"), expected);
}

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

TEST(CaptureSession, FlickerDoesNotMakeAnOldPictureANewOne) {
  fake::Scratch scratch("flicker");
  auto room = std::make_shared<Room>();
  room->flicker = 0.02;
  room->wrong[kFirst + 1] = 1;  // the photo of black shows the white before it, two percent brighter
  Listener listener;
  ASSERT_TRUE(run(room, scratch / "s", fake::rig(), listener));
  EXPECT_THAT(listener.said, HasSubstr("frame 1 (black of left): camera 'cam' still shows the former frame"));
}

// The child captures and kills itself at its `event`-th show or trigger. True when it was killed.
bool capture_and_die(const fs::path& folder, int event) {
  const pid_t child = fork();
  if (child == 0) {
    auto room = std::make_shared<Room>();
    room->die_at = event;
    _exit(run_short(room, folder) ? 0 : 1);
  }
  int status = 0;
  waitpid(child, &status, 0);
  EXPECT_TRUE(WIFSIGNALED(status) || WEXITSTATUS(status) == 0);
  return WIFSIGNALED(status);
}

TEST(CaptureSession, KilledAtAnyEventItResumesToTheSameBytes) {
  fake::Scratch scratch("kill");
  ASSERT_TRUE(run_short(std::make_shared<Room>(), scratch / "plain"));
  const auto expected = fake::tree(scratch / "plain");
  bool killed = true;
  for (int event = 0; killed; ++event) {
    const fs::path folder = scratch / std::to_string(event);
    killed = capture_and_die(folder, event);
    ASSERT_TRUE(run_short(std::make_shared<Room>(), folder)) << event;
    EXPECT_EQ(fake::tree(folder), expected) << event;
    fs::remove_all(folder);
  }
}

TEST(CaptureSession, KilledAgainAndAgainAtAnyMomentItLosesNothing) {
  fake::Scratch scratch("rekill");
  ASSERT_TRUE(run_short(std::make_shared<Room>(), scratch / "plain"));
  const auto expected = fake::tree(scratch / "plain");
  Random random(hash_name("KilledAgainAndAgain"));
  std::size_t stored = 0;
  int round = 0;
  for (bool done = false; !done; ++round) {
    const pid_t child = fork();
    if (child == 0) _exit(run_short(std::make_shared<Room>(), scratch / "s") ? 0 : 1);
    usleep(static_cast<useconds_t>(random.uniform(2e2, 4e3 + 5e2 * round)));  // longer each time: it ends on slow disks
    kill(child, SIGKILL);
    int status = 0;
    waitpid(child, &status, 0);
    done = WIFEXITED(status);
    ASSERT_TRUE(!done || WEXITSTATUS(status) == 0);
    const auto files = fs::exists(scratch / "s") ? fake::tree(scratch / "s") : std::map<std::string, std::string>();
    std::size_t now = 0;
    for (const auto& [name, bytes] : files)
      if (name.ends_with(".tif") && name.find("/.") == std::string::npos) {
        ++now;
        EXPECT_EQ(bytes, expected.at(name)) << name;
      }
    EXPECT_GE(now, stored);
    stored = now;
  }
  EXPECT_EQ(fake::tree(scratch / "s"), expected);
}

TEST(CaptureSession, SecondProcessIsToldThatTheSessionIsTaken) {
  fake::Scratch scratch("lock");
  fs::create_directories(scratch / "s");
  {
    const auto lock = FolderLock::take(scratch / "s");
    ASSERT_TRUE(lock);
    const auto done = run(std::make_shared<Room>(), scratch / "s");
    ASSERT_FALSE(done);
    EXPECT_EQ(done.error().code, ErrorCode::kRefused);
    EXPECT_THAT(done.error().message, AllOf(HasSubstr("another process"), HasSubstr((scratch / "s").string())));
    EXPECT_EQ(photos_in(scratch / "s"), 0);
  }
  EXPECT_TRUE(run(std::make_shared<Room>(), scratch / "s"));
}

TEST(CaptureSession, ThatGrowsIsTheSameAsOneCapturedAtOnce) {
  fake::Scratch scratch("grows");
  SilentProgress silent;
  const auto room = std::make_shared<Room>();
  ASSERT_TRUE(run(room, scratch / "whole"));
  const auto again = std::make_shared<Room>();
  ASSERT_TRUE(run(again, scratch / "grown", fake::rig(), silent, fake::short_sequence()));
  CaptureOptions options = kQuick;
  options.extend = true;
  const Devices devices = fake::devices(again, fake::rig());
  const auto grown = capture_session(fake::rig(), "", fake::sequence(), devices, scratch / "grown", options, silent);
  ASSERT_TRUE(grown) << grown.error().message;
  EXPECT_EQ(fake::tree(scratch / "grown"), fake::tree(scratch / "whole"));
  // Not one that began otherwise.
  Sequence other = fake::sequence();
  std::swap(other.frames[2].role, other.frames[3].role);
  other.frames.push_back({16, other.frames[0].role});
  const auto differs = capture_session(fake::rig(), "", other, devices, scratch / "grown", options, silent);
  ASSERT_FALSE(differs);
  EXPECT_EQ(differs.error().code, ErrorCode::kExists);
  EXPECT_EQ(fake::tree(scratch / "grown"), fake::tree(scratch / "whole"));
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

TEST(CaptureSession, AnotherRigOrSequenceOrOtherFilesAreNotOverwritten) {
  fake::Scratch scratch("exists");
  const auto expected = undisturbed(scratch / "s");
  Rig other = fake::rig();
  other.projectors[1].black_level = 0.002;
  const auto done = run(std::make_shared<Room>(), scratch / "s", other);
  ASSERT_FALSE(done);
  EXPECT_EQ(done.error().code, ErrorCode::kExists);
  EXPECT_THAT(done.error().message, AllOf(HasSubstr("rig.toml"), HasSubstr("another")));
  Sequence longer = fake::sequence();
  longer.frames.push_back({16, longer.frames[0].role});
  SilentProgress silent;
  const auto sequence = run(std::make_shared<Room>(), scratch / "s", fake::rig(), silent, longer);
  ASSERT_FALSE(sequence);
  EXPECT_THAT(sequence.error().message, HasSubstr("sequence.json"));
  EXPECT_EQ(fake::tree(scratch / "s"), expected);

  fs::create_directories(scratch / "mine");
  std::ofstream(scratch / "mine/holiday.png") << "x";
  const auto foreign = run(std::make_shared<Room>(), scratch / "mine");
  ASSERT_FALSE(foreign);
  EXPECT_EQ(foreign.error().code, ErrorCode::kExists);
  EXPECT_THAT(foreign.error().message, HasSubstr("not a session"));
  EXPECT_EQ(fake::tree(scratch / "mine").size(), 1);
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

TEST(CaptureSession, CameraThatFailsIsReportedAndTheSessionResumes) {
  fake::Scratch scratch("unplugged");
  const auto expected = undisturbed(scratch / "plain");
  auto room = std::make_shared<Room>();
  room->fail_at = kFirst + 7;
  const auto done = run(room, scratch / "s");
  ASSERT_FALSE(done);
  EXPECT_EQ(done.error().code, ErrorCode::kDevice);
  EXPECT_THAT(done.error().message, AllOf(HasSubstr("unplugged"), HasSubstr("frame 7")));
  ASSERT_TRUE(run(std::make_shared<Room>(), scratch / "s"));
  EXPECT_EQ(fake::tree(scratch / "s"), expected);
}

TEST(CaptureSession, ACameraThatFailsIsMarkedUnhealthyUntilACaptureEndsWell) {
  fake::Scratch scratch("unhealthy");
  const auto expected = undisturbed(scratch / "plain");
  const auto watched_run = [&](int fail_at, Listener& listener) {
    auto room = std::make_shared<Room>();
    room->fail_at = fail_at;
    Devices devices = fake::devices(room, fake::rig());
    for (auto& camera : devices.cameras) camera = watched(std::move(camera));
    return capture_session(fake::rig(), "", fake::sequence(), devices, scratch / "s", kQuick, listener);
  };
  Listener first, second, third, fourth;
  ASSERT_FALSE(watched_run(kFirst + 7, first));
  EXPECT_THAT(unhealthy_cameras(scratch / "s"), ElementsAre(HasSubstr("'cam' was unhealthy: camera 'cam' was unplug")));
  ASSERT_FALSE(watched_run(0, second)) << "at its first photo";
  EXPECT_THAT(second.said, HasSubstr("was unplugged (when this session was left)"));
  ASSERT_TRUE(watched_run(-1, third));
  EXPECT_EQ(unhealthy_cameras(scratch / "s").size(), 0u);
  EXPECT_EQ(fake::tree(scratch / "s"), expected);
  // What a complete session says of its cameras stays.
  ASSERT_TRUE(write_atomically(scratch / "s" / "unhealthy.json", "{\"cameras\": {\"cam\": {\"why\": \"cable\"}}}"));
  ASSERT_TRUE(watched_run(-1, fourth));
  EXPECT_THAT(fourth.said, HasSubstr("'cam' was unhealthy: cable"));
  EXPECT_EQ(unhealthy_cameras(scratch / "s").size(), 1u);
}

TEST(UnhealthyCameras, AreNoneWhereTheFileSaysNothing) {
  fake::Scratch scratch("unhealthy-file");
  for (const char* text : {"", "[", "[]", "{}", "{\"cameras\": 3}", "{\"cameras\": {\"cam\": 1}}"}) {
    ASSERT_TRUE(write_atomically(scratch / "unhealthy.json", text));
    EXPECT_TRUE(unhealthy_cameras(scratch / "").empty()) << text;
  }
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
