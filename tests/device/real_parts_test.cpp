// The whole job with real parts: windows on a display, read back from its memory; light by the simulated room; a GigE
// Vision camera whose packets go through Aravis. Against the same room where the simulator is camera and projector
// itself.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <nlohmann/json.hpp>

#include "calib/base/check.h"
#include "calib/file/file.h"
#include "capture/device/aravis/aravis.h"
#include "simdata/render/simulator.h"
#include "simdata/room/rooms.h"
#include "tests/device/aravis/gige_camera.h"
#include "tests/support/cli.h"
#include "tests/support/xvfb.h"

namespace countershade::testing {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

constexpr int kWidth = 480, kHeight = 300;  // of a projector

struct Shown {
  bool passed = false;
  double suppression = 0, held_out = 0;
};

Shown shown(const fs::path& out) {
  const auto numbers = nlohmann::json::parse(read_text(out / "report/numbers.json").value());
  const auto calibration = nlohmann::json::parse(read_text(out / "calibration/calibration.json").value());
  return {numbers.at("pass"), numbers.at("suppression"), calibration.at("held_out_error")};
}

// A camera that sees what the windows of a display show, in a room.
std::unique_ptr<GigeCamera> camera_in_room(const std::shared_ptr<simdata::Simulator>& simulator,
                                           const XvfbDisplay& display, GigeOptions options) {
  options.width = simulator->simulation().cameras[0].resolution[0];
  options.height = simulator->simulation().cameras[0].resolution[1];
  options.formats = {"Mono16"};
  return std::make_unique<GigeCamera>(
      options, [simulator, &display, photo = std::uint64_t{0}](double exposure_ms) mutable {
        std::vector<Picture> pictures;
        for (int q = 0; q < 2; ++q) {
          const std::vector<std::uint8_t> seen = display.pixels(kWidth, kHeight, q * kWidth);
          Picture picture(kWidth, kHeight, 3);
          std::transform(seen.begin(), seen.end(), picture.data().begin(), [](std::uint8_t v) { return 257 * v; });
          pictures.push_back(std::move(picture));
        }
        const Image light = simulator->optics(0, simulator->total_light(0, pictures));
        const capture::Exposure e = simulator->expose(0, light, exposure_ms, photo++);
        std::vector<std::uint16_t> values;
        for (const float v : e.values.data())
          values.push_back(static_cast<std::uint16_t>(std::lround(v / e.full_scale * 65535)));
        return values;
      });
}

TEST(RealParts, WindowsARoomAndAGigECameraGiveWhatTheSimulatorAloneGives) {
  if (!capture::has_aravis()) GTEST_SKIP() << "built without Aravis";
  if (const std::string why = enter_private_network(); !why.empty()) GTEST_SKIP() << why;
  const TemporaryFolder folder;
  const XvfbDisplay display(folder / "display", 2 * kWidth, kHeight);
  if (!display.running()) GTEST_SKIP() << "Xvfb is not installed";
  simdata::RigAndRoom room = simdata::small_two_wall(3, {kWidth, kHeight}, 512);
  room.rig.cameras.resize(1), room.simulation.cameras.resize(1);
  room.simulation.cameras[0].channels = 1;
  CameraSpec& camera = room.rig.cameras[0];
  camera.model = folder / "camera.cameramodel";
  camera.exposures_ms = {10};
  Device lens = simdata::true_camera(room.simulation, camera.id).value();
  lens.device_from_world = {};
  ASSERT_TRUE(write_cameramodel(camera.model, lens));
  SilentProgress quiet;
  const auto simulator = simdata::Simulator::make(room.rig, room.simulation, quiet).value();

  ASSERT_TRUE(write_atomically(folder / "simulated.toml", rig_text(room.rig, &room.simulation)));
  camera.backend = "aravis", camera.device = "ROOM1";
  camera.pedestal *= 65535 / camera.full_scale.value_or(65535);  // it sends 16 bits
  camera.full_scale.reset();
  for (ProjectorSpec& p : room.rig.projectors) p.output = "window";
  ASSERT_TRUE(write_atomically(folder / "real.toml", rig_text(room.rig, nullptr)));

  const auto simulated = run_countershade("run " + (folder / "simulated.toml").string() + " --exposures 4 -o " +
                                          (folder / "simulated").string());
  ASSERT_THAT(simulated.out, HasSubstr("suppression")) << simulated.out << simulated.err;
  // Every 5000th packet is lost: some photos come whole only because packets are asked for again.
  GigeOptions options;
  options.drop_every = 5000;
  const std::unique_ptr<GigeCamera> gige = camera_in_room(simulator, display, options);
  setenv("DISPLAY", display.name().c_str(), 1);
  unsetenv("WAYLAND_DISPLAY");
  const auto listed = run_countershade("devices");
  EXPECT_THAT(listed.out, HasSubstr("camera Countershade RoomCamera"));
  EXPECT_THAT(listed.out, HasSubstr("device = \"ROOM1\""));
  const auto real =
      run_countershade("run " + (folder / "real.toml").string() + " --exposures 4 -o " + (folder / "real").string());
  ASSERT_THAT(real.out, HasSubstr("suppression")) << real.out << real.err;
  EXPECT_GT(gige->photos(), 60);
  EXPECT_GT(gige->resent(), 0);

  const Shown alone = shown(folder / "simulated"), through = shown(folder / "real");
  EXPECT_EQ(through.passed, alone.passed) << real.out;
  EXPECT_GT(alone.suppression, 10);
  EXPECT_NEAR(through.suppression / alone.suppression, 1, 0.25) << "windows show 8 bits";
  EXPECT_NEAR(through.held_out, alone.held_out, 0.001);
}

}  // namespace
}  // namespace countershade::testing
