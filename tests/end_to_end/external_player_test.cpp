// Pictures that somebody else plays in a loop, and photos that a camera takes whenever it likes: what comes of them.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>

#include "calib/base/random.h"
#include "calib/file/file.h"
#include "calib/image/image_file.h"
#include "capture/pattern/decode.h"
#include "capture/pattern/identity.h"
#include "simdata/render/simulator.h"
#include "simdata/room/rooms.h"
#include "tests/support/cli.h"
#include "tests/support/rig_files.h"

namespace countershade {
namespace {

namespace fs = std::filesystem;
using testing::run_countershade;
using testing::TemporaryFolder;
using testing::write_rig;

simdata::RigAndRoom late_room() {
  simdata::RigAndRoom room = simdata::small_two_wall(3, {480, 300}, 256);
  for (SimulatedProjector& p : room.simulation.projectors) p.latency_ms = 40, p.latency_jitter_ms = 30;
  room.simulation.projectors[1].latency_ms = 75;
  return room;
}

struct Player {
  const fs::path patterns;
  const Sequence sequence = read_sequence(patterns / "sequence.json").value();
  capture::Devices devices;

  void show(int position) {
    for (const auto& projector : devices.projectors) {
      const fs::path file =
          patterns / fmt::format("{:04}", sequence.frames[position].index) / (projector->id() + ".png");
      ASSERT_TRUE(projector->show(read_picture(file).value()));
    }
  }
  Image photo() { return devices.cameras[0]->trigger().value().values; }
};

// Plays from the seventh picture on, round and round; the camera knows nothing of it.
void photograph_a_loop(Player& player, const fs::path& folder) {
  fs::create_directories(folder);
  Random random(hash_name("external player"));
  ASSERT_TRUE(player.devices.cameras[0]->arm(0));
  const int frames = static_cast<int>(player.sequence.frames.size());
  int photos = 95;  // the names' numbers get a digit more
  for (int i = 7; i < frames + 9; ++i) {
    player.show(i % frames);
    for (int k = 0; k < 3; ++k) {
      player.devices.wait(random.uniform(0, 80));
      ASSERT_TRUE(write_stored16(folder / fmt::format("IMG_{}.tif", photos++), player.photo()));
    }
  }
}

// Sums over blocks of 8 x 8 pixels, which hold little noise: of how much they differ, and of the light of `truth`.
std::pair<double, double> difference_of_blocks(const Image& photo, const Image& truth) {
  double wrong = 0, light = 0;
  for (int y = 0; y + 8 <= truth.height(); y += 8)
    for (int x = 0; x + 8 <= truth.width(); x += 8) {
      double difference = 0;
      for (int j = 0; j < 8; ++j)
        for (int i = 0; i < 8 * truth.channels(); ++i) {
          const float there = truth.row(y + j)[x * truth.channels() + i];
          difference += photo.row(y + j)[x * truth.channels() + i] - there;
          light += there;
        }
      wrong += std::abs(difference);
    }
  return {wrong, light};
}

TEST(ExternalPlayer, PhotosOfALoopInAnyOrderBecomeASessionThatCalibrates) {
  const TemporaryFolder folder;
  const simdata::RigAndRoom room = late_room();
  write_rig(folder.path(), room);
  const std::string rig = (folder / "rig.toml").string(), patterns = (folder / "patterns").string();
  const auto written = run_countershade("patterns " + rig + " --identity -o " + patterns);
  ASSERT_EQ(written.exit_code, 0) << written.err;
  SilentProgress silent;
  const auto simulator = simdata::Simulator::make(room.rig, room.simulation, silent).value();
  Player player{.patterns = patterns, .devices = simdata::simulated_devices(simulator)};
  photograph_a_loop(player, folder / "photos");
  if (::testing::Test::HasFatalFailure()) return;

  const std::string import = "import " + rig + " --sequence " + patterns + "/sequence.json --photos " +
                             (folder / "photos").string() + " -o " + (folder / "session").string();
  const auto imported = run_countershade(import);
  ASSERT_EQ(imported.exit_code, 0) << imported.err;
  EXPECT_NE(imported.err.find("sees 4 marks of identity"), std::string::npos) << imported.err;

  // Every photo shows the frame whose name it has, and nothing else.
  const Session session = Session::open(folder / "session").value();
  const std::string camera = room.rig.cameras[0].id;
  for (int position = 0; position < static_cast<int>(player.sequence.frames.size()); position += 3) {
    const int index = player.sequence.frames[position].index;
    player.show(position);
    player.devices.wait(500);
    const Image truth = player.photo(), found = read_image(session.photo_path(camera, index)).value().values;
    const auto [wrong, light] = difference_of_blocks(found, truth);
    EXPECT_LT(wrong, 0.02 * light) << index;
  }
  const Photo white = session.photo(camera, player.sequence.frames[0].index).value();
  const auto marks = capture::find_marks(white.value, player.sequence);
  ASSERT_EQ(marks.size(), 4u);
  for (const auto& mark : marks)
    for (const Eigen::Vector2d& q : mark.outline)
      EXPECT_FALSE(white.valid.at(static_cast<int>(q.x()), static_cast<int>(q.y()))) << q.transpose();

  const auto calibrated =
      run_countershade("calibrate " + (folder / "session").string() + " -o " + (folder / "calibration").string());
  ASSERT_EQ(calibrated.exit_code, 0) << calibrated.err;
  const auto verified = run_countershade("verify " + (folder / "calibration").string() + " --rig " + rig + " -o " +
                                         (folder / "report").string());
  EXPECT_EQ(verified.exit_code, 0) << verified.out << verified.err;
  EXPECT_NE(verified.out.find("PASS"), std::string::npos) << verified.out;

  // Without the photos of one frame it is named, and nothing is written.
  const auto shows_three = [&](const fs::path& file) {
    for (const auto& mark : capture::find_marks(read_image(file).value().values, player.sequence))
      if (mark.position == 3) return true;
    return false;
  };
  for (const auto& entry : fs::directory_iterator(folder / "photos"))
    if (shows_three(entry.path())) fs::remove(entry.path());
  fs::remove_all(folder / "session");
  const auto refused = run_countershade(import);
  EXPECT_EQ(refused.exit_code, 1) << refused.err;
  EXPECT_NE(refused.err.find("shows frame 3 (gray x bit"), std::string::npos) << refused.err;
  EXPECT_FALSE(fs::exists(folder / "session"));
}

}  // namespace
}  // namespace countershade
