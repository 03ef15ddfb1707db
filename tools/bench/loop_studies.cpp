// two-wall-loop and verify-honest: the whole job on rooms drawn from the study distribution, against simulator truth.
#include <algorithm>
#include <cmath>

#include "calib/base/random.h"
#include "calib/file/file.h"
#include "simdata/room/rooms.h"
#include "tools/bench/study.h"
#include "tools/bench/truth.h"
#include "tools/job/coded_capture.h"
#include "tools/job/devices.h"
#include "tools/job/verification.h"

namespace countershade::bench {

namespace {

namespace fs = std::filesystem;

constexpr int kExposures = 16;

// A rig that was measured: its room, and the calibration made from a noisy session.
struct Measured {
  std::shared_ptr<simdata::Simulator> simulator;
  tools::Calibration calibration;
  solver::PixelGeometry pixels;
  tools::CalibrationSummary summary;
};

Result<Measured> measure_room(simdata::RigAndRoom room, const fs::path& folder, Progress& progress) {
  std::error_code code;
  fs::remove_all(folder, code);
  fs::create_directories(folder, code);
  for (CameraSpec& camera : room.rig.cameras) {
    CS_TRY(Device device, simdata::true_camera(room.simulation, camera.id));
    device.device_from_world = {};
    camera.model = folder / (camera.id + ".cameramodel");
    CS_TRY_VOID(write_cameramodel(camera.model, device));
  }
  Measured measured;
  CS_TRY(measured.simulator, simdata::Simulator::make(room.rig, room.simulation, progress));
  const capture::Devices devices = simdata::simulated_devices(measured.simulator);
  CS_TRY_VOID(tools::capture_with_code(room.rig, simulation_text(room.simulation), "auto", devices, folder / "session",
                                       progress));
  CS_TRY(measured.summary, tools::calibrate(folder / "session", folder / "calibration", {}, progress));
  CS_TRY(measured.calibration, tools::open_calibration(folder / "calibration"));
  measured.pixels = tools::pixels_of(measured.calibration);
  fs::remove_all(folder / "session", code);  // 1.4 GB of photos
  return measured;
}

// Mean of exposures of a light that was never shown through a projector: a perfect show.
Image perfect_photo(const simdata::Simulator& simulator, const Image& light, const CameraSpec& spec) {
  const double exposure_ms = simulator.simulation().cameras[0].reference_exposure_ms;
  Image sum(light.width(), light.height(), light.channels());
  for (int i = 0; i < kExposures; ++i) {
    const Photo photo = tools::photo_of(simulator.expose(0, light, exposure_ms, 0x9e00 + i), spec);
    for (std::size_t k = 0; k < sum.data().size(); ++k) sum.data()[k] += photo.value.data()[k] / kExposures;
  }
  return sum;
}

Result<Image> show_and_photograph(const capture::Devices& devices, const CameraSpec& spec,
                                  std::span<const Picture> pictures) {
  for (std::size_t q = 0; q < pictures.size(); ++q) CS_TRY_VOID(devices.projectors[q]->show(pictures[q]));
  CS_TRY_VOID(devices.cameras[0]->arm(0));
  return tools::average_exposure(*devices.cameras[0], spec, kExposures);
}

// Numbers of one model on one picture; the target is the simulator's own direct light.
struct Outcome {
  tools::VerifyNumbers numbers, ceiling;
};

Result<Outcome> try_model(const Measured& m, const solver::Model& model, const std::string& picture,
                          Progress& progress) {
  CS_TRY(const std::vector<Picture> plain, tools::test_pictures(model, picture));
  CS_TRY(const tools::Show show, tools::compensate_show(model, plain, {}, tools::Engine::kAuto, progress));
  const capture::Devices devices = simdata::simulated_devices(m.simulator);
  const CameraSpec& spec = m.simulator->rig().cameras[0];
  tools::Photographs photos;
  CS_TRY(photos.uncompensated, show_and_photograph(devices, spec, plain));
  CS_TRY(photos.compensated, show_and_photograph(devices, spec, show.compensated.pictures));
  photos.target = true_target(*m.simulator, 0, plain);
  const Image perfect = perfect_photo(*m.simulator, photos.target, spec);
  const tools::VerifyMasks masks = tools::verify_masks(m.calibration, m.pixels, photos.target);
  Photo noise{photos.uncompensated, Mask(m.pixels.width, m.pixels.height, 1, 1), 0};
  tools::VerifyInput input{&photos.uncompensated,
                           &photos.compensated,
                           &photos.target,
                           &masks.lit,
                           &masks.edge,
                           &masks.modelled,
                           masks.edge_text,
                           m.calibration.model.white,
                           estimate_noise(std::span(&noise, 1)).sigma(0.4)};
  Outcome outcome;
  outcome.numbers = tools::measure(input);
  input.compensated = &perfect;
  outcome.ceiling = tools::measure(input);
  return outcome;
}

solver::Model with_scaled_gain(const solver::Model& model, float factor) {
  solver::Model scaled = model;
  scaled.k *= factor;
  return scaled;
}

}  // namespace

Result<Study> two_wall_loop(const StudyContext& context) {
  Study study{
      "The whole loop on five rooms drawn from the study distribution; picture `photo`, defaults, noise on, target = "
      "the simulator's direct light",
      {"seed", "angle", "held-out % W", "|U-T| % W", "|C-T| % W", "suppression", "edge grey", "worse %", "uncovered %",
       "ceiling", "k x 1.2"},
      {},
      {},
      "",
      "",
      false};
  double least = HUGE_VAL, held_out = 0, edge = 0, worse = 0, planted = 0, uncovered = 0;
  for (int seed = 0; seed < 5; ++seed) {
    const simdata::RigAndRoom room = simdata::random_two_wall(hash_name("two-wall-loop") + seed);
    const Result<Measured> made = measure_room(room, context.output / "two-wall-loop", *context.progress);
    if (!made) {
      study.rows.push_back(
          {fmt::format("{}", seed), fmt::format("{:.1f}", simdata::edge_angle_deg(room.simulation)), "refused"});
      study.rows.back().resize(study.columns.size(), "-");
      study.notes.push_back(fmt::format("seed {} is refused: {}", seed, made.error().message));
      least = 0;
      continue;
    }
    const Measured& m = *made;
    CS_TRY(const Outcome good, try_model(m, m.calibration.model, "photo", *context.progress));
    CS_TRY(const Outcome bad, try_model(m, with_scaled_gain(m.calibration.model, 1.2f), "photo", *context.progress));
    const tools::VerifyNumbers& n = good.numbers;
    least = std::min(least, n.all.suppression);
    held_out = std::max(held_out, 100 * m.summary.held_out_error);
    edge = std::max(edge, n.edge.compensated.mean_grey);
    worse = std::max(worse, 100 * n.worse_share);
    uncovered = std::max(uncovered, 100 * n.uncovered_share);
    planted = std::max(planted, bad.numbers.all.suppression);
    study.rows.push_back(
        {fmt::format("{}", seed), fmt::format("{:.1f}", simdata::edge_angle_deg(room.simulation)),
         fmt::format("{:.3f}", 100 * m.summary.held_out_error), fmt::format("{:.2f}", n.all.uncompensated.mean_percent),
         fmt::format("{:.3f}", n.all.compensated.mean_percent), fmt::format("{:.1f}", n.all.suppression),
         fmt::format("{:.2f}", n.edge.compensated.mean_grey), fmt::format("{:.2f}", 100 * n.worse_share),
         fmt::format("{:.2f}", 100 * n.uncovered_share), fmt::format("{:.1f}", good.ceiling.all.suppression),
         fmt::format("{:.1f}", bad.numbers.all.suppression)});
  }
  study.notes.push_back("ceiling: the suppression that the same 16 photos would show of a perfect show");
  study.figure = fmt::format(
      "suppression {:.1f}x at worst, held-out {:.2f} % of white, edge {:.2f} grey levels, worse {:.2f} %, k 20 % wrong "
      "gives {:.1f}x",
      least, held_out, edge, worse, planted);
  study.bound = ">= 20x, <= .5 %, <= 1.5, <= .5 %, < 20x";
  study.ok = least >= 20 && held_out <= 0.5 && edge <= 1.5 && worse <= 0.5 && planted < 20 && uncovered <= 2;
  return study;
}

Result<Study> verify_honest(const StudyContext& context) {
  Study study{
      "All indirect gains multiplied by .8: verify must say FAIL, and its measured suppression must be the true one",
      {"picture", "verdict", "suppression by verify", "true suppression", "deviation"},
      {},
      {},
      "",
      "",
      false};
  CS_TRY(const Measured m, measure_room(simdata::random_two_wall(hash_name("verify-honest")),
                                        context.output / "verify-honest", *context.progress));
  const solver::Model wrong = with_scaled_gain(m.calibration.model, 0.8f);
  const capture::Devices devices = simdata::simulated_devices(m.simulator);
  bool all_fail = true;
  double most = 0;
  for (const std::string picture : {"photo", "gradient", "flat"}) {
    CS_TRY(const std::vector<Picture> plain, tools::test_pictures(wrong, picture));
    CS_TRY(const tools::Show show, tools::compensate_show(wrong, plain, {}, tools::Engine::kAuto, *context.progress));
    CS_TRY(const tools::Photographs photos,
           tools::photograph(devices, m.simulator->rig().cameras[0], m.pixels, plain, show.compensated.pictures,
                             m.calibration.summary.veil, kExposures, *context.progress));
    const fs::path report = context.output / "verify-honest" / picture;
    CS_TRY(const tools::Verification v,
           tools::report_verification(m.calibration, context.output / "verify-honest" / "calibration", m.pixels, photos,
                                      &show, {}, report));
    CS_TRY(const Outcome truth, try_model(m, wrong, picture, *context.progress));
    const double deviation = v.numbers.all.suppression / truth.numbers.all.suppression - 1;
    all_fail = all_fail && !v.verdict.pass;
    most = std::max(most, std::abs(deviation));
    study.rows.push_back({picture, v.verdict.pass ? "PASS" : "FAIL", fmt::format("{:.2f}", v.numbers.all.suppression),
                          fmt::format("{:.2f}", truth.numbers.all.suppression),
                          fmt::format("{:+.1f} %", 100 * deviation)});
  }
  study.figure = fmt::format("{}, suppression within {:.1f} % of the truth",
                             all_fail ? "always FAIL" : "not always FAIL", 100 * most);
  study.bound = "FAIL, within 20 %";
  study.ok = all_fail && most <= 0.2;
  return study;
}

}  // namespace countershade::bench
