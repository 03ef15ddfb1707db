// The session runner in front of simulated devices that are late.
#include <gtest/gtest.h>

#include <fstream>

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

// The bytes of all photos, by name.
std::map<std::string, std::string> photos(double latency_ms, double refresh_hz) {
  auto room = test::small_room();
  room.rig.cameras[0].model = "";
  for (SimulatedProjector& p : room.simulation.projectors) p.latency_ms = latency_ms, p.refresh_hz = refresh_hz;
  const auto simulator = test::simulate(room);
  const TemporaryFolder folder;
  Listener listener;
  const auto done = capture::capture_session(room.rig, "", capture::default_sequence(room.rig),
                                             simdata::simulated_devices(simulator), folder / "session", {}, listener);
  EXPECT_TRUE(done) << done.error().message;
  EXPECT_EQ(listener.said.find("again"), std::string::npos) << "what is measured is waited for: " << listener.said;
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

}  // namespace
}  // namespace countershade
