// The whole job through the command line on a small simulated rig, and what it does with bad input.
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <fstream>
#include <functional>
#include <map>
#include <sstream>
#include <thread>

#include "calib/file/file.h"
#include "calib/file/rig.h"
#include "calib/file/session.h"
#include "calib/geometry/lens.h"
#include "calib/image/image_file.h"
#include "simdata/room/rooms.h"
#include "tests/support/cli.h"
#include "tests/support/rig_files.h"
#include "tests/support/small_disk.h"
#include "tests/support/xvfb.h"

namespace countershade {
namespace {

namespace fs = std::filesystem;
using testing::run_countershade;
using testing::TemporaryFolder;
using testing::write_rig;

// Not dark: what bounces of the room's own light is no error of the show.
simdata::RigAndRoom small_room() {
  simdata::RigAndRoom room = simdata::small_two_wall(3, {480, 300}, 1024);
  room.simulation.ambient = .12;
  return room;
}

// Hash of every file below a folder, provenance apart, by relative path.
std::map<std::string, std::string> contents(const fs::path& folder) {
  std::map<std::string, std::string> files;
  for (const auto& entry : fs::recursive_directory_iterator(folder))
    if (entry.is_regular_file() && entry.path().filename() != "provenance.json")
      files[fs::relative(entry.path(), folder).string()] = hash_file(entry.path()).value();
  return files;
}

// The windows show what `compensate` writes, bit for bit; `c` shows the source as it is, `t` a test picture, `q` ends.
void plays_what_compensate_writes(const TemporaryFolder& folder) {
  const testing::XvfbDisplay display(folder / "fb", 960, 300);
  if (!display.running()) return;  // WindowProjector's tests say that they were skipped
  ASSERT_EQ(
      run_countershade("play " + (folder / "again").string() + " photo --plain --frames " + (folder / "plain").string())
          .exit_code,
      0);
  const fs::path plain = folder / "plain/0000";
  ASSERT_EQ(run_countershade(
                "compensate " + (folder / "again").string() + " --picture left=" + (plain / "left.png").string() +
                " --picture right=" + (plain / "right.png").string() + " -o " + (folder / "shown").string())
                .exit_code,
            0);
  const std::string line = "env -u WAYLAND_DISPLAY DISPLAY=" + display.name() + " " + COUNTERSHADE_BINARY_DIR +
                           "/countershade --json play " + (folder / "again").string() + " " + plain.string() +
                           " --seconds 100 >" + (folder / "play.json").string() + " 2>/dev/null";
  FILE* player = popen(line.c_str(), "w");
  ASSERT_NE(player, nullptr);
  const auto shows = [&](const fs::path& pictures) {
    for (const auto& [id, left] : {std::pair{"left", 0}, std::pair{"right", 480}}) {
      const Picture picture = read_picture(pictures / (std::string(id) + ".png")).value();
      const std::vector<std::uint8_t> seen = display.pixels(480, 300, left);
      for (std::size_t i = 0; i < seen.size(); ++i)
        if (seen[i] != picture.data()[i] / 257) return false;
    }
    return true;
  };
  const auto soon = [&](const fs::path& pictures) {
    for (int i = 0; i < 300 && !shows(pictures); ++i) std::this_thread::sleep_for(std::chrono::milliseconds(100));
    return shows(pictures);
  };
  const auto press = [&](const char* keys) { std::fputs(keys, player), std::fflush(player); };
  EXPECT_TRUE(soon(folder / "shown"));
  press("c\n");
  EXPECT_TRUE(soon(plain));
  press("tc\n");  // the first test picture, compensated: neither of the two
  std::this_thread::sleep_for(std::chrono::milliseconds(1500));
  EXPECT_FALSE(shows(plain) || shows(folder / "shown"));
  press("q\n");
  EXPECT_EQ(pclose(player), 0);
  EXPECT_NE(read_text(folder / "play.json").value().find("\"engine\": \"GL\""), std::string::npos);
}

TEST(Loop, MeasuresCompensatesAndVerifiesASimulatedWall) {
  const TemporaryFolder folder;
  simdata::RigAndRoom room = small_room();
  room.simulation.cameras[0].veiling_glare = 0.05;  // passes for indirect light where nobody measures it: FAIL
  write_rig(folder.path(), room);
  const auto result = run_countershade("run " + (folder / "rig.toml").string() + " -o " + (folder / "out").string());
  ASSERT_EQ(result.exit_code, 0) << result.out << result.err;
  EXPECT_NE(result.out.find("PASS"), std::string::npos) << result.out;
  EXPECT_TRUE(fs::exists(folder / "out/report/report.html"));
  const std::string calibrated = read_text(folder / "out/calibration/calibration.json").value();
  const auto veil = calibrated.find("\"camera_veil\": ");
  ASSERT_NE(veil, std::string::npos);
  EXPECT_NEAR(std::stod(calibrated.substr(veil + 15)), 0.05 / 1.05, 0.012) << "on so few pixels";

  // What a report must state beside the photos' own numbers, and what its provenance tells of the command.
  const std::string numbers = read_text(folder / "out/report/numbers.json").value();
  for (const char* stated : {"certificate_percent_of_white", "reachable_gap_percent_of_white",
                             "held_out_percent_of_white", "capture_seconds", "compute_seconds"}) {
    EXPECT_NE(numbers.find(stated), std::string::npos) << stated;
    EXPECT_EQ(numbers.find(std::string(stated) + "\": null"), std::string::npos) << stated;
  }
  const std::string provenance = read_text(folder / "out/report/provenance.json").value();
  EXPECT_NE(provenance.find("\"exposures\": \"16\""), std::string::npos) << provenance;
  EXPECT_EQ(provenance.find("\"seconds\": 0.0"), std::string::npos) << provenance;

  // Honesty: the calibration does not depend on the truth of the room, nor on the folder's name.
  fs::rename(folder / "out/session", folder / "elsewhere");
  fs::remove(folder / "elsewhere/simulation.toml");
  const auto again =
      run_countershade("calibrate " + (folder / "elsewhere").string() + " -o " + (folder / "again").string());
  ASSERT_EQ(again.exit_code, 0) << again.err;
  EXPECT_EQ(contents(folder / "again"), contents(folder / "out/calibration"));

  // Pictures that belong to no projector are refused by name, and nothing is written.
  const auto wrong_id = run_countershade("compensate " + (folder / "again").string() + " --picture middle=x.png -o " +
                                         (folder / "shown").string());
  EXPECT_EQ(wrong_id.exit_code, 1);
  EXPECT_NE(wrong_id.err.find("no projector 'middle'"), std::string::npos) << wrong_id.err;
  EXPECT_NE(wrong_id.err.find("left, right"), std::string::npos) << wrong_id.err;
  EXPECT_FALSE(fs::exists(folder / "shown"));
  const auto chart = run_countershade("compensate " + (folder / "again").string() + " --picture x.png -o " +
                                      (folder / "shown").string());
  EXPECT_EQ(chart.exit_code, 1);
  EXPECT_NE(chart.err.find("registration"), std::string::npos) << chart.err;
  const auto frames =
      run_countershade("play " + (folder / "again").string() + " gradient --frames " + (folder / "frames").string());
  EXPECT_EQ(frames.exit_code, 0) << frames.err;
  EXPECT_TRUE(fs::exists(folder / "frames/0000/left.png"));
  plays_what_compensate_writes(folder);
}

// Each of these must end with exit code 1, a message that names thing and remedy, and nothing written.
struct BadInput {
  const char *name, *rig, *arguments, *expected;
};

class BadInputTest : public ::testing::TestWithParam<BadInput> {};

TEST_P(BadInputTest, IsNamedAndLeavesNothingBehind) {
  const TemporaryFolder folder;
  std::ofstream(folder / "rig.toml") << GetParam().rig;
  std::string arguments = GetParam().arguments;
  for (std::size_t at; (at = arguments.find('@')) != std::string::npos;)
    arguments.replace(at, 1, folder.path().string());
  const auto before = contents(folder.path());
  const auto result = run_countershade(arguments);
  EXPECT_EQ(result.exit_code, 1) << result.out << result.err;
  EXPECT_NE(result.err.find(GetParam().expected), std::string::npos) << result.err;
  EXPECT_EQ(contents(folder.path()), before);
}

// A wall, a camera and a projector before it.
constexpr const char* kRoom =
    "[[camera]]\nid = \"c\"\nbackend = \"simulated\"\n[[projector]]\nid = \"p\"\nresolution = [64, 48]\n"
    "[[simulation.surface]]\nid = \"wall\"\norigin = [-1, 0, 0]\nalong_u = [2, 0, 0]\nalong_v = [0, 1.5, 0]\n"
    "[[simulation.camera]]\nid = \"c\"\nposition = [0.2, 1, 3]\ntarget = [0, 0.7, 0]\nresolution = [80, 50]\n"
    "focal_px = 60.0\n[[simulation.projector]]\nid = \"p\"\nposition = [-0.1, 0.8, 2]\ntarget = [0, 0.7, 0]\n";
constexpr const char* kRig = "[[camera]]\nid = \"c\"\n[[projector]]\nid = \"p\"\nresolution = [64, 48]\n";

INSTANTIATE_TEST_SUITE_P(
    Cli, BadInputTest,
    ::testing::Values(
        BadInput{"UnknownKey", "[[camera]]\nid = \"c\"\n[[projector]]\nid = \"p\"\nresoltion = [64, 48]\n",
                 "patterns @/rig.toml -o @/out", "nearest valid key is 'resolution'"},
        BadInput{"NoProjector", "[[camera]]\nid = \"c\"\n", "patterns @/rig.toml -o @/out", "projector"},
        BadInput{"ZeroResolution", "[[camera]]\nid = \"c\"\n[[projector]]\nid = \"p\"\nresolution = [0, 48]\n",
                 "patterns @/rig.toml -o @/out", "resolution"},
        BadInput{"NotFinite",
                 "[[camera]]\nid = \"c\"\npedestal = nan\n[[projector]]\nid = \"p\"\nresolution = [64, 48]\n",
                 "patterns @/rig.toml -o @/out", "finite"},
        BadInput{"ZeroSizeScreen",
                 "[[camera]]\nid = \"c\"\n[[projector]]\nid = \"p\"\nresolution = [64, 48]\n[[simulation.surface]]\n"
                 "id = \"wall\"\nalong_u = [0, 2, 0]\n",
                 "simulate @/rig.toml -o @/out", "span no area"},
        BadInput{"NoSamples", kRoom, "simulate @/rig.toml --samples 0 -o @/out", "at least 16 and at most 65536"},
        BadInput{"NegativeSamples", kRoom, "simulate @/rig.toml --samples -3 -o @/out",
                 "at least 16 and at most 65536"},
        BadInput{"UnknownFault", kRoom, "simulate @/rig.toml --faults stale-frames -o @/out", "'stale-frame'"},
        BadInput{"FaultOutOfRange", kRoom, "simulate @/rig.toml --faults glare=7 -o @/out", "0.0001 to 1"},
        BadInput{"FaultTwice", kRoom, "simulate @/rig.toml --faults dust,dust -o @/out", "twice"},
        BadInput{"TruthLightWithoutTruth", kRoom, "simulate @/rig.toml --truth-light -o @/out", "add --truth"},
        BadInput{"TruthInTheSession", kRoom, "simulate @/rig.toml --truth @/out/truth -o @/out", "choose another"},
        BadInput{"TooManyPatches", kRoom, "simulate @/rig.toml --truth @/truth --truth-patches 4096,2 -o @/out",
                 "4096"},
        BadInput{"AngleThatIsNone", kRoom, "new two-wall --angle nan -o @/new.toml", "15 to 170"},
        BadInput{"UnknownRoom", kRoom, "new cavern -o @/new.toml", "'cave4'"},
        BadInput{"MissingRig", kRig, "capture @/nothing.toml -o @/out", "nothing.toml"},
        BadInput{"NoSimulation", kRig, "simulate @/rig.toml -o @/out", "[simulation]"},
        BadInput{"NoPhotos", kRig, "import @/rig.toml --photos @/nowhere -o @/out", "nowhere"},
        BadInput{"NoSession", kRig, "calibrate @/nowhere -o @/out", "nowhere"},
        BadInput{"NoCalibration", kRig, "compensate @/nowhere --picture p=a.png -o @/out", "nowhere"},
        BadInput{"NoBoardPhotos", kRig, "lens @ -o @/out.cameramodel", "holds no photos"},
        BadInput{"NoPhotosOfABoard", kRig, "lens @/nowhere -o @/out.cameramodel", "nowhere"},
        BadInput{"UnknownBoard", kRig, "lens @ --board chesboard:9x7:2cm -o @/out.cameramodel", "'chessboard'"},
        BadInput{"OutputExists", kRig, "patterns @/rig.toml -o @", "exists"}),
    [](const auto& info) { return std::string(info.param.name); });

// One way to spoil a session, and what calibrate says about it.
struct SpoiltSession {
  const char* name;
  std::function<void(const fs::path& photos)> spoil;
  std::vector<const char*> expected;
};

TEST(Cli, SessionsThatCannotBeUsedAreNamedAndNothingIsWritten) {
  const TemporaryFolder folder;
  simdata::RigAndRoom room = small_room();
  room.simulation.samples = 64;  // a draft: only what is said about bad photos counts
  write_rig(folder.path(), room);
  const std::string session = (folder / "session").string();
  ASSERT_EQ(run_countershade("simulate " + (folder / "rig.toml").string() + " -o " + session).exit_code, 0);
  const Sequence sequence = read_sequence(folder / "session/sequence.json").value();
  const auto photo = [](const fs::path& photos, int index) {
    for (const auto& entry : fs::recursive_directory_iterator(photos))
      if (entry.path().stem() == fmt::format("{:04}", index)) return entry.path();
    ADD_FAILURE() << "no photo " << index;
    return photos;
  };
  const std::vector<SpoiltSession> cases = {
      {"missing photo", [&](const fs::path& p) { fs::remove(photo(p, 12)); }, {"0012", "1 of "}},
      {"truncated photo",
       [&](const fs::path& p) { fs::resize_file(photo(p, 12), fs::file_size(photo(p, 12)) / 2); },
       {"0012.", "truncated"}},
      {"another size",
       [&](const fs::path& p) { write_picture(photo(p, 12), Picture(320, 200, 3), 16).value(); },
       {"0012.", "320"}},
      {"projector that is not visible",
       [&](const fs::path& p) {  // all its frames look like black
         int black = -1;
         for (const Frame& f : sequence.frames)
           if (f.role.kind == "black") black = f.index;
         for (const Frame& f : sequence.frames)
           if (f.role.projector == "right")
             fs::copy_file(photo(p, black), photo(p, f.index), fs::copy_options::overwrite_existing);
       },
       {"projector 'right'"}},
      {"all black",
       [&](const fs::path& p) {
         for (const Frame& f : sequence.frames)
           if (f.index != sequence.frames.back().index)
             fs::copy_file(photo(p, sequence.frames.back().index), photo(p, f.index),
                           fs::copy_options::overwrite_existing);
       },
       {"projector 'left'"}}};
  for (const SpoiltSession& c : cases) {
    const fs::path spoilt = folder / "spoilt";
    fs::remove_all(spoilt);
    fs::copy(session, spoilt, fs::copy_options::recursive);
    c.spoil(spoilt / "photos");
    const auto result = run_countershade("calibrate " + spoilt.string() + " -o " + (folder / "out").string());
    EXPECT_EQ(result.exit_code, 1) << c.name << result.out;
    for (const char* expected : c.expected)
      EXPECT_NE(result.err.find(expected), std::string::npos)
          << c.name << ": " << result.err.substr(result.err.find("countershade:"));
    EXPECT_FALSE(fs::exists(folder / "out")) << c.name;
  }
  SCOPED_TRACE("disks");
  testing::SmallDisk disk(folder / "disk");
  if (!disk.ready()) GTEST_SKIP() << "a full disk cannot be tried here: mounting a tmpfs failed: " << disk.why();
  const std::string onto_disk = "calibrate " + session + " -o " + (folder / "disk/out").string();
  const auto full = run_countershade(onto_disk);
  EXPECT_EQ(full.exit_code, 1) << full.out;
  EXPECT_TRUE(full.err.find("disk") != std::string::npos && full.err.find("space") != std::string::npos) << full.err;
  EXPECT_TRUE(fs::is_empty(folder / "disk"));
  ASSERT_TRUE(disk.make_read_only());
  const auto read_only = run_countershade(onto_disk);
  EXPECT_EQ(read_only.exit_code, 1) << read_only.out;
  EXPECT_NE(read_only.err.find("can be written"), std::string::npos) << read_only.err;
}

TEST(Cli, CheckMeasuresTheLatencyAndCopesWithIt) {
  // A simulated photo takes 30 ms; the other projector's show, a refresh of 17, is waited for first.
  for (int latency : {0, 2}) {
    const TemporaryFolder folder;
    simdata::RigAndRoom room = simdata::small_two_wall(8, {160, 100}, 64);
    room.simulation.projectors[1].latency_ms = 30 * latency;
    write_rig(folder.path(), room);
    const auto result =
        run_countershade("check " + (folder / "rig.toml").string() + " -o " + (folder / "check.html").string());
    EXPECT_EQ(result.exit_code, 0) << result.out << result.err;
    EXPECT_NE(result.out.find(fmt::format("{} photos before", latency)), std::string::npos) << result.out;
  }
}

TEST(Cli, EveryVerbHasHelp) {
  for (const char* verb : {"new", "devices", "check", "patterns", "capture", "import", "simulate", "calibrate",
                           "compensate", "play", "verify", "run"}) {
    const auto result = run_countershade(std::string(verb) + " --help");
    EXPECT_EQ(result.exit_code, 0) << verb;
    EXPECT_NE(result.out.find("Usage"), std::string::npos) << verb;
  }
}

TEST(Cli, NewWritesARigThatItReadsBackAndOverwritesNothing) {
  const TemporaryFolder folder;
  const std::string rig = (folder / "rig.toml").string();
  ASSERT_EQ(run_countershade("new two-wall -o " + rig).exit_code, 0);
  EXPECT_TRUE(read_rig(rig));
  EXPECT_TRUE(read_simulation(rig));
  const auto again = run_countershade("new two-wall -o " + rig);
  EXPECT_EQ(again.exit_code, 1);
  EXPECT_NE(again.err.find("exists already"), std::string::npos);
}

}  // namespace
}  // namespace countershade
