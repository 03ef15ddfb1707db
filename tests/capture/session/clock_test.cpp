// Cameras whose clock jumps: photos are those of the frames that were shown, and no wait is endless.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "calib/image/image_file.h"
#include "capture/pattern/pattern.h"
#include "capture/session/runner.h"
#include "simdata/render/simulator.h"
#include "simdata/room/rooms.h"
#include "tests/support/cli.h"
#include "tests/support/edited_camera.h"

namespace countershade {
namespace {

namespace fs = std::filesystem;

using Clock = double (*)(double time_s, int photo);

// A room without noise, so that a photo is right or it is not.
simdata::RigAndRoom room_with(double latency_ms) {
  simdata::RigAndRoom room = simdata::small_two_wall(8, {160, 100}, 16);
  room.rig.cameras[0].model.clear();
  room.rig.cameras[0].exposures_ms = {1e3 / 60};
  room.simulation.cameras[0].full_well_e = 1e9, room.simulation.cameras[0].read_noise_e = 0;
  room.simulation.cameras[0].reference_exposure_ms = 1e3 / 60;
  for (SimulatedProjector& p : room.simulation.projectors) p.latency_ms = latency_ms;
  return room;
}

class PhotoTimes : public ::testing::Test {
 protected:
  // Captures, and returns how long it waited, in ms of the room's time.
  double capture_into(const fs::path& folder, double latency_ms, Clock clock) {
    SilentProgress quiet;
    const simdata::RigAndRoom room = room_with(latency_ms);
    const auto simulator = simdata::Simulator::make(room.rig, room.simulation, quiet).value();
    capture::Devices devices = simdata::simulated_devices(simulator);
    devices.cameras[0] = std::make_unique<testing::EditedCamera>(std::move(devices.cameras[0]),
                                                                 [clock](Result<capture::Exposure> taken, int n) {
                                                                   if (taken)
                                                                     taken->timestamp_s = clock(taken->timestamp_s, n);
                                                                   return taken;
                                                                 });
    double waited_ms = 0;
    const auto inner = devices.clock;
    devices.clock = [&waited_ms, inner](double ms) {
      waited_ms += ms;
      inner(std::min(ms, 1e6));
    };
    const auto captured = capture::capture_session(room.rig, "", sequence_, devices, folder, {}, quiet);
    EXPECT_TRUE(captured) << (captured ? "" : captured.error().message);
    return waited_ms;
  }
  // Photos that differ by more than rounding to 12 bits.
  int wrong_photos(const fs::path& folder, const fs::path& right) {
    int wrong = 0;
    for (const Frame& f : sequence_.frames) {
      const std::string name = fmt::format("photos/camera/{:04}.tif", f.index);
      const auto a = read_image(folder / name), b = read_image(right / name);
      if (!a || !b) return -1;
      float most = 0;
      for (std::size_t i = 0; i < a->values.data().size(); ++i)
        most = std::max(most, std::abs(a->values.data()[i] - b->values.data()[i]));
      wrong += most > 2 * 65535.0 / 4095;
    }
    return wrong;
  }
  Sequence sequence_ = capture::default_sequence(room_with(0).rig);
  testing::TemporaryFolder folder_;
};

TEST_F(PhotoTimes, ThatJumpGiveNoWrongPhotoAndNoEndlessWait) {
  capture_into(folder_ / "right", 0, [](double t, int) { return t; });
  const std::pair<const char*, Clock> clocks[] = {
      {"set back an hour in the middle", [](double t, int photo) { return photo < 12 ? t : t - 3600; }},
      {"set back again and again", [](double t, int photo) { return t - 2.0 * photo; }},
      {"ahead by 30 years, now and then", [](double t, int photo) { return photo % 3 == 1 ? t + 1e9 : t; }},
      {"standing still", [](double, int) { return 7.0; }},
      {"no number", [](double, int) { return std::numeric_limits<double>::quiet_NaN(); }},
  };
  // Twice the longest latency that is waited for (300 ms) for each frame, and 60 s of measuring before the first.
  const double longest_ms = 600.0 * static_cast<double>(sequence_.frames.size()) + 60e3;
  int number = 0;
  for (const auto& [name, clock] : clocks) {
    const fs::path session = folder_ / fmt::format("session{}", number++);
    EXPECT_LT(capture_into(session, 60, clock), longest_ms) << name;
    EXPECT_EQ(wrong_photos(session, folder_ / "right"), 0) << name;
  }
}

}  // namespace
}  // namespace countershade
