// The session runner in front of simulated devices that are late.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <numbers>

#include "capture/pattern/pattern.h"
#include "capture/session/runner.h"
#include "tests/simdata/small_room.h"
#include "tests/support/cli.h"

namespace countershade {
namespace {

namespace fs = std::filesystem;
using testing::TemporaryFolder;

struct Listener final : Progress {
  std::string said;
  void step(std::string_view, double, double) override {}
  void note(std::string_view text) override { said += std::string(text) + "\n"; }
  void warn(std::string_view text) override { said += std::string(text) + "\n"; }
};

// Captures all frames of a room; what the capture said.
std::string said_of(const simdata::RigAndRoom& room, const std::string& faults, const fs::path& folder) {
  Listener listener;
  std::vector<simdata::Fault> planted;
  if (!faults.empty()) planted = simdata::parse_faults(faults).value();
  const auto done =
      capture::capture_session(room.rig, "", capture::default_sequence(room.rig),
                               simdata::simulated_devices(test::simulate(room), planted), folder, {}, listener);
  EXPECT_TRUE(done) << done.error().message << listener.said;
  return listener.said;
}

simdata::RigAndRoom room_without_model() {
  auto room = test::small_room();
  room.rig.cameras[0].model = "";
  return room;
}

// The bytes of all photos, by name.
std::map<std::string, std::string> photos(double latency_ms, double refresh_hz) {
  auto room = room_without_model();
  for (SimulatedProjector& p : room.simulation.projectors) p.latency_ms = latency_ms, p.refresh_hz = refresh_hz;
  const TemporaryFolder folder;
  const std::string said = said_of(room, "", folder / "session");
  EXPECT_EQ(said.find("again"), std::string::npos) << "what is measured is waited for: " << said;
  std::map<std::string, std::string> all;
  for (const auto& entry : fs::directory_iterator(folder / "session/photos" / room.rig.cameras[0].id)) {
    std::ifstream file(entry.path(), std::ios::binary);
    all[entry.path().filename().string()] = std::string(std::istreambuf_iterator<char>(file), {});
  }
  return all;
}

// What is visible, and no instant, decides a photo's noise: a session that waits long enough has the same bytes.
TEST(SimulatedSession, LatencyIsWaitedOut) {
  const auto expected = photos(0, 60);
  ASSERT_GT(expected.size(), 30u);
  for (const auto& [latency, hz] : {std::pair{25., 60.}, {70., 60.}, {50., 24.}})
    EXPECT_TRUE(photos(latency, hz) == expected) << latency << " ms, " << hz << " Hz";
}

// Degrees by which the camera turns when its picture shifts by so many pixels.
double degrees_of(const simdata::RigAndRoom& room, double px) {
  const Device camera = simdata::true_camera(room.simulation, room.rig.cameras[0].id).value();
  return 180 / std::numbers::pi * px / camera.lens.intrinsics()[0];
}

// Half a pixel is far too little to change a bin, and too much for a decoder that knows hundredths.
TEST(SimulatedSession, ACameraThatTurnsByHalfAPixelHasAllFramesTakenAgain) {
  const auto room = room_without_model();
  const TemporaryFolder folder;
  for (const double px : {0.5, 1.0})
    EXPECT_THAT(said_of(room, fmt::format("camera-turned={}@45", degrees_of(room, px)), folder / fmt::format("{}", px)),
                ::testing::HasSubstr("frames are taken again"))
        << px;
}

TEST(SimulatedSession, APictureThatShiftsOnItsProjectorHasAllFramesTakenAgain) {
  const TemporaryFolder folder;
  EXPECT_THAT(said_of(room_without_model(), "projector-nudged=1@60", folder / "session"),
              ::testing::HasSubstr("frames are taken again"));
}

// To refuse it would leave the operator with nothing; calibrate says how far the view moved.
TEST(SimulatedSession, ACameraThatGivesWayAllTheTimeIsCapturedWithAWarning) {
  const auto room = room_without_model();
  const TemporaryFolder folder;
  const std::string said =
      said_of(room, fmt::format("camera-drifts={}@0", degrees_of(room, 0.005)), folder / "session");  // .4 px in all
  EXPECT_THAT(said, ::testing::HasSubstr("goes on shifting"));
}

TEST(SimulatedSession, ACameraThatTremblesIsNotThoughtMoved) {
  auto room = room_without_model();
  for (std::uint64_t seed = 1; seed <= 2; ++seed) {
    const TemporaryFolder folder;
    room.simulation.seed = seed;
    EXPECT_THAT(said_of(room, fmt::format("camera-shaken={}@0", degrees_of(room, 0.3)), folder / "session"),
                ::testing::Not(::testing::HasSubstr("again")))
        << seed;
  }
}

}  // namespace
}  // namespace countershade
