// What calibrate makes of decoded pixels, on a simulated wall.
#include "tools/job/calibration.h"

#include <gmock/gmock.h>

#include "calib/image/image_file.h"
#include "simdata/render/simulator.h"
#include "simdata/room/rooms.h"
#include "tests/support/cli.h"
#include "tools/job/coded_capture.h"

namespace countershade::tools {
namespace {

namespace fs = std::filesystem;
using capture::Correspondence;
using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::Not;
using testing::TemporaryFolder;

// Photographs a room with the code that suits it, its camera's lens known; gives what was decoded.
CalibrateOptions captured(simdata::RigAndRoom room, const fs::path& folder) {
  SilentProgress quiet;
  Device lens = simdata::true_camera(room.simulation, "camera").value();
  lens.device_from_world = {};
  room.rig.cameras[0].model = folder / "camera.cameramodel";
  write_cameramodel(room.rig.cameras[0].model, lens).value();
  const auto simulator = simdata::Simulator::make(room.rig, room.simulation, quiet).value();
  CalibrateOptions options;
  options.decoded =
      capture_with_code(room.rig, "", "auto", simdata::simulated_devices(simulator), folder / "session", quiet)
          .value()
          .decoded;
  return options;
}

TEST(Calibrate, RejectsCodesThatNoPointOfSpaceExplains) {
  const TemporaryFolder folder;
  SilentProgress quiet;
  CalibrateOptions options = captured(simdata::small_two_wall(4, {320, 200}, 256), folder.path());
  const auto sound = calibrate(folder / "session", folder / "sound", options, quiet);
  ASSERT_TRUE(sound) << sound.error().message;
  for (const DecodeSummary& d : sound->decoded)
    EXPECT_LT(d.rejected.contains("epipolar inconsistent") ? d.rejected.at("epipolar inconsistent") : 0, 2e-4);
  EXPECT_THAT(sound->notes, Not(Contains(HasSubstr("epipolar"))));

  // Every fortieth code of the first projector is ten rows off.
  Correspondence& wrong = options.decoded[0];
  std::vector<std::size_t> planted;
  for (std::size_t i = 0; i < wrong.reason.data().size(); i += 40)
    if (wrong.reason.data()[i] == 0) planted.push_back(i), wrong.y.data()[i] += 10;
  ASSERT_GT(planted.size(), 300u);
  const auto summary = calibrate(folder / "session", folder / "wrong", options, quiet);
  ASSERT_TRUE(summary) << summary.error().message;
  const DecodeSummary& decoded = summary->decoded[0];
  EXPECT_NEAR(decoded.rejected.at("epipolar inconsistent"), static_cast<double>(planted.size()) / decoded.lit, 2e-4);
  EXPECT_NEAR(decoded.accepted, sound->decoded[0].accepted - static_cast<double>(planted.size()) / decoded.lit, 2e-4);
  EXPECT_THAT(summary->notes, Contains(HasSubstr("epipolar geometry")));
  const auto read = read_exr(folder / "wrong/correspondence" / ("camera-" + wrong.projector + ".exr"), {"x", "reason"});
  ASSERT_TRUE(read) << read.error().message;
  for (const std::size_t i : planted) {
    EXPECT_EQ((*read)[1].data()[i], static_cast<float>(capture::Reason::kEpipolar));
    EXPECT_TRUE(std::isnan((*read)[0].data()[i]));
  }
  const auto opened = open_calibration(folder / "wrong");
  ASSERT_TRUE(opened) << opened.error().message;
  EXPECT_EQ(opened->summary.decoded[0].rejected, decoded.rejected);
}

// The walls are of three albedos, and one has a colour of its own: what a camera tells of each primary is the same
// whether it sees colours or not.
TEST(Calibrate, ACameraWithoutColoursTellsThePrimariesApart) {
  SilentProgress quiet;
  std::vector<solver::Model> models;
  for (const int channels : {3, 1}) {
    const TemporaryFolder folder;
    simdata::RigAndRoom room = simdata::small_two_wall(4, {320, 200}, 1024);
    room.simulation.cameras[0].channels = channels;
    room.simulation.surfaces[0].albedo = {0.85, 0.6, 0.35}, room.simulation.surfaces[1].albedo = {0.7, 0.7, 0.6};
    const CalibrateOptions options = captured(room, folder.path());
    const auto summary = calibrate(folder / "session", folder / "calibration", options, quiet);
    ASSERT_TRUE(summary) << summary.error().message;
    EXPECT_LT(summary->held_out_error, 0.003) << channels;
    const std::string note = "sees no colours";
    EXPECT_EQ(std::any_of(summary->notes.begin(), summary->notes.end(),
                          [&](const std::string& n) { return n.find(note) != std::string::npos; }),
              channels == 1);
    models.push_back(open_calibration(folder / "calibration")->model);
  }
  const auto median_k = [](const solver::Model& m, int surface, int c) {
    const Eigen::VectorXf k = m.k.col(c).segment(m.patches.offset(surface), m.patches.count(surface));
    std::vector<float> sorted(k.begin(), k.end());
    std::sort(sorted.begin(), sorted.end());
    return sorted[sorted.size() / 2];
  };
  const auto total_gain = [](const solver::Model& m, int surface, int c) {
    double sum = 0;
    for (const solver::ProjectorModel& p : m.projectors)
      for (std::size_t i = 0; i < p.gain[surface].pixels(); ++i) sum += p.gain[surface].data()[3 * i + c];
    return sum;
  };
  for (int surface = 0; surface < 2; ++surface)
    for (int c = 0; c < 3; ++c) {
      EXPECT_NEAR(median_k(models[1], surface, c), median_k(models[0], surface, c), 0.015) << surface << c;
      EXPECT_NEAR(total_gain(models[1], surface, c) / total_gain(models[1], surface, 0),
                  total_gain(models[0], surface, c) / total_gain(models[0], surface, 0), 0.01)
          << surface << c;
    }
}

TEST(RejectedText, NamesTheMostFrequentFirst) {
  EXPECT_EQ(rejected_text({{"isolated", 0.0001}, {"mixed pixel", 0.0123}}), "mixed pixel 1.23 %, isolated 0.01 %");
  EXPECT_EQ(rejected_text({}), "");
}

}  // namespace
}  // namespace countershade::tools
