// The power goes, or the disk fails, while the command writes: at some of the moments that the study `kill` tries all
// of.
#include <gtest/gtest.h>

#include <cerrno>
#include <map>

#include "calib/file/file.h"
#include "calib/file/rig.h"
#include "calib/geometry/lens.h"
#include "simdata/room/rooms.h"
#include "tests/support/cli.h"
#include "tests/support/rig_files.h"
#include "tools/bench/kill/write_calls.h"

namespace countershade {
namespace {

namespace fs = std::filesystem;
using bench::Disaster;
using bench::Doom;
using bench::Ending;
using testing::TemporaryFolder;

// Hash of every file below a folder, hidden ones too; of the record of the run only that it is there.
std::map<std::string, std::string> tree(const fs::path& folder) {
  std::map<std::string, std::string> files;
  if (!fs::exists(folder)) return files;
  for (const auto& entry : fs::recursive_directory_iterator(folder))
    if (entry.is_regular_file())
      files[fs::relative(entry.path(), folder).string()] =
          entry.path().filename() == "provenance.json" ? "" : hash_file(entry.path()).value();
  return files;
}

class Kill : public ::testing::Test {
 protected:
  void SetUp() override {
    if (!bench::can_trace()) GTEST_SKIP() << "this machine lets no program trace its child";
    simdata::RigAndRoom room = simdata::small_two_wall(8, {160, 100}, 16);
    room.rig.cameras[0].exposures_ms = {10, 5};  // a frame may be cut between them
    testing::write_rig(folder_.path(), room);
  }
  Ending run(const std::string& verb, const fs::path& input, const fs::path& out, const Doom& doom = {}) {
    const auto ending = bench::run_to_disaster(
        {COUNTERSHADE_BINARY_DIR "/countershade", verb, input.string(), "-o", out.string()}, folder_.path(), doom);
    EXPECT_TRUE(ending) << (ending ? "" : ending.error().message);
    return ending ? *ending : Ending();
  }
  // Calls spread over all of them, the first and the last included.
  static std::vector<std::uint64_t> some_of(std::size_t calls, std::size_t count) {
    std::vector<std::uint64_t> some;
    for (std::size_t i = 0; i < count; ++i) some.push_back(i * (calls - 1) / (count - 1));
    return some;
  }
  void expect_survival(const std::string& verb, const fs::path& input, std::size_t count) {
    const fs::path plain = folder_ / ("plain-" + verb);
    const Ending undisturbed = run(verb, input, plain);
    ASSERT_EQ(undisturbed.exit_code, 0) << undisturbed.output;
    ASSERT_GT(undisturbed.calls.size(), 20u);
    const auto expected = tree(plain);
    const Doom dooms[] = {{Disaster::kKill, 0, 0}, {Disaster::kTear, 0, 0}, {Disaster::kFail, 0, ENOSPC}};
    for (std::uint64_t at : some_of(undisturbed.calls.size(), count))
      for (Doom doom : dooms) {
        doom.at = at;
        const fs::path scratch = folder_ / "scratch";
        fs::remove_all(scratch);
        fs::create_directories(scratch);
        const Ending ending = run(verb, input, scratch / "out", doom);
        const std::string when = fmt::format("{} at {} {}", static_cast<int>(doom.disaster), at, undisturbed.calls[at]);
        if (doom.disaster != Disaster::kFail) {
          EXPECT_TRUE(ending.killed) << when;
        } else if (ending.exit_code != 0) {
          EXPECT_EQ(ending.exit_code, 1) << when << ending.output;
          EXPECT_NE(ending.output.find("No space left"), std::string::npos) << when << ending.output;
        }
        const bool whole = tree(scratch / "out") == expected;
        const Ending again = run(verb, input, scratch / "out");
        const bool finished = whole && again.output.find("exists already") != std::string::npos;
        EXPECT_TRUE(again.exit_code == 0 || finished) << when << again.output;
        EXPECT_EQ(tree(scratch / "out"), expected) << when;
        EXPECT_EQ(tree(scratch).size(), expected.size()) << when << ": something is left beside it";
      }
  }
  TemporaryFolder folder_;
};

TEST_F(Kill, TheTracerCountsWhatChangesAFolderAndNothingElse) {
  const std::string script = "cd " + (folder_ / ".").string() +
                             "; cat rig.toml >/dev/null; echo one >a; echo two >/dev/null; mkdir b; mv a b/c; rm b/c";
  const auto ending = bench::run_to_disaster({"sh", "-c", script}, folder_.path(), {});
  ASSERT_TRUE(ending) << ending.error().message;
  const std::vector<std::string> expected = {"open a", "write a", "mkdir b", "rename b/c", "unlink b/c"};
  EXPECT_EQ(ending->calls, expected);
  for (std::size_t at = 0; at < expected.size(); ++at) {
    fs::remove_all(folder_ / "a"), fs::remove_all(folder_ / "b");
    const auto killed = bench::run_to_disaster({"sh", "-c", script}, folder_.path(), {Disaster::kKill, at, 0});
    ASSERT_TRUE(killed);
    EXPECT_EQ(killed->calls.size(), at + 1);
    EXPECT_EQ(fs::exists(folder_ / "b"), at > 2) << at;
    EXPECT_EQ(fs::exists(folder_ / "b" / "c"), at == 4) << at;
  }
  fs::remove_all(folder_ / "b");
  const auto torn = bench::run_to_disaster({"sh", "-c", script}, folder_.path(), {Disaster::kTear, 1, 0});
  ASSERT_TRUE(torn && torn->killed);
  EXPECT_EQ(read_text(folder_ / "a").value(), "on");
  fs::remove(folder_ / "a");
  const auto full = bench::run_to_disaster({"sh", "-c", script}, folder_.path(), {Disaster::kFail, 1, ENOSPC});
  ASSERT_TRUE(full);
  EXPECT_NE(full->output.find("No space left"), std::string::npos) << full->output;
}

TEST_F(Kill, ASessionGoesOnAsIfNothingHadHappened) {
  expect_survival("simulate", folder_ / "rig.toml", 4);
}

TEST_F(Kill, ACalibrationIsWholeOrMadeAgain) {
  ASSERT_EQ(run("simulate", folder_ / "rig.toml", folder_ / "session").exit_code, 0);
  expect_survival("calibrate", folder_ / "session", 2);
}

}  // namespace
}  // namespace countershade
