// Captures that were stopped, however, and go on.
#include <gmock/gmock.h>
#include <sys/wait.h>

#include "capture/device/health.h"
#include "tests/capture/session/fake_session.h"

namespace countershade::capture {
namespace {

using namespace fake;
using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
namespace fs = std::filesystem;

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

}  // namespace
}  // namespace countershade::capture
