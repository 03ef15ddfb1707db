// sim-faults: every simulated fault at its default: what it does to a photo, and which stage of the job notices.
#include <algorithm>
#include <cmath>

#include "calib/file/file.h"
#include "calib/image/image_file.h"
#include "capture/session/runner.h"
#include "simdata/render/simulator.h"
#include "simdata/room/rooms.h"
#include "tools/bench/study.h"
#include "tools/job/calibration.h"
#include "tools/job/check/self_check.h"
#include "tools/job/test_pictures.h"

namespace countershade::bench {

namespace {

namespace fs = std::filesystem;

// Photos 0 .. last of one pair of pictures; before `changed`, another pair is shown.
Result<capture::Exposure> photo_number(const std::shared_ptr<const simdata::Simulator>& simulator,
                                       std::vector<simdata::Fault> faults, int changed, int last) {
  const capture::Devices devices = simdata::simulated_devices(simulator, std::move(faults));
  const auto show = [&](const std::string& name) -> Result<void> {
    for (int q = 0; q < 2; ++q) {
      CS_TRY(const Picture picture, tools::test_picture(name, q, 480, 300));
      CS_TRY_VOID(devices.projectors[q]->show(picture));
    }
    return {};
  };
  CS_TRY_VOID(devices.cameras[0]->arm(0));
  CS_TRY_VOID(show("gradient"));
  capture::Exposure exposure;
  for (int i = 0; i <= last; ++i) {
    if (i == changed) CS_TRY_VOID(show("photo"));
    CS_TRY(exposure, devices.cameras[0]->trigger());
  }
  return exposure;
}

double mean_difference(const capture::Exposure& a, const capture::Exposure& b) {
  double sum = 0;
  for (std::size_t i = 0; i < a.values.data().size(); ++i) sum += std::abs(a.values.data()[i] - b.values.data()[i]);
  return sum / a.values.data().size() / a.full_scale;
}

Result<void> write_photo(const fs::path& file, const capture::Exposure& exposure) {
  Picture picture(exposure.values.width(), exposure.values.height(), 3);
  for (std::size_t i = 0; i < picture.data().size(); ++i)
    picture.data()[i] = static_cast<std::uint16_t>(
        std::lround(65535 * std::pow(std::clamp(exposure.values.data()[i] / exposure.full_scale, 0.0, 1.0), 1 / 2.2)));
  return write_picture(file, picture, 8);
}

// What the stages of a job say, in their order: the first complaint, or the numbers of a calibration without one.
struct Verdicts {
  std::string check = "-", capture = "-", calibrate = "-";
  double held_out = 0, chi2 = 0;
};

Verdicts run_job(const simdata::RigAndRoom& room, const std::shared_ptr<const simdata::Simulator>& simulator,
                 const std::vector<simdata::Fault>& faults, const fs::path& folder, Progress& progress) {
  std::error_code ignored;
  fs::remove_all(folder / "session", ignored);
  fs::remove_all(folder / "calibration", ignored);
  Verdicts v;
  const auto findings = tools::self_check(room.rig, simdata::simulated_devices(simulator, faults), progress);
  if (!findings) v.check = "error";
  for (const tools::Finding& f : findings ? *findings : std::vector<tools::Finding>())
    if (!f.ok && v.check == "-") v.check = f.what;
  const auto captured =
      capture::capture_session(room.rig, "", capture::default_sequence(room.rig),
                               simdata::simulated_devices(simulator, faults), folder / "session", {}, progress);
  if (!captured) {
    v.capture = "refused";
    return v;
  }
  const auto calibrated = tools::calibrate(folder / "session", folder / "calibration", {}, progress);
  if (!calibrated) {
    v.calibrate = "refused";
    return v;
  }
  v.held_out = 100 * calibrated->held_out_error;
  v.chi2 = calibrated->chi2;
  return v;
}

}  // namespace

Result<Study> sim_faults(const StudyContext& context) {
  Study study{"Every simulated fault at its default, on the documentation's room with a third of its pixels",
              {"fault", "value", "photo changes by % of full scale", "check", "capture", "calibrate", "held-out % W",
               "noticed by"},
              {},
              {},
              "",
              "",
              false};
  SilentProgress quiet;
  // A third of the pixels: twenty whole jobs in minutes. No figure of accuracy comes of it.
  simdata::RigAndRoom room = simdata::small_two_wall(3, {480, 300}, 1024);
  const fs::path folder = context.output / "sim-faults";
  std::error_code code;
  fs::create_directories(folder, code);
  CS_TRY(Device lens, simdata::true_camera(room.simulation, room.rig.cameras[0].id));
  lens.device_from_world = {};
  room.rig.cameras[0].model = folder / "camera.cameramodel";
  CS_TRY_VOID(write_cameramodel(room.rig.cameras[0].model, lens));
  CS_TRY(const auto simulator, simdata::Simulator::make(room.rig, room.simulation, *context.progress));
  const Verdicts good = run_job(room, simulator, {}, folder, quiet);
  study.rows.push_back(
      {"none", "-", "0", good.check, good.capture, good.calibrate, fmt::format("{:.3f}", good.held_out), "-"});
  int visible = 0, noticed = 0, done = 0;
  const int all = static_cast<int>(simdata::fault_kinds().size());
  for (const simdata::FaultKind& kind : simdata::fault_kinds()) {
    context.progress->step("faults", done++, all);
    const std::string name = kind.name;
    const std::vector<simdata::Fault> faults{{&kind, kind.value, static_cast<std::uint64_t>(kind.photo)}};
    const int last = kind.photo + (name == "person-walks-in" ? 7 : name == "warm-up" ? 35 : 0);
    CS_TRY(const capture::Exposure without, photo_number(simulator, {}, kind.photo, last));
    CS_TRY(const capture::Exposure with, photo_number(simulator, faults, kind.photo, last));
    CS_TRY_VOID(write_photo(folder / (name + ".png"), with));
    const double change = mean_difference(without, with);
    const bool jumps = with.counter != without.counter;
    visible += change > 0.002 || jumps;
    const Verdicts v = run_job(room, simulator, faults, folder, quiet);
    std::string by = v.check != "-"                   ? "check"
                     : v.capture != "-"               ? "capture"
                     : v.calibrate != "-"             ? "calibrate"
                     : v.held_out > 2 * good.held_out ? "held-out error"
                                                      : "nothing";
    noticed += by != "nothing";
    study.rows.push_back({name, fmt::format("{}", kind.value),
                          jumps ? "counter jumps" : fmt::format("{:.2f}", 100 * change), v.check, v.capture,
                          v.calibrate, v.held_out > 0 ? fmt::format("{:.3f}", v.held_out) : "-", by});
  }
  context.progress->step("faults", all, all);
  study.notes.push_back(fmt::format("pictures: {}/<fault>.png", folder.string()));
  study.notes.push_back(
      "verify is not part of this: what it sees when the rig changes after the calibration is not here");
  study.figure = fmt::format("{} of {} faults change the photos, {} are noticed by a stage", visible, all, noticed);
  study.bound = "all change them";
  study.ok = visible == all;
  return study;
}

}  // namespace countershade::bench
