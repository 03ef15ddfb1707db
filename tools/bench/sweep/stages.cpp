#include "tools/bench/sweep/stages.h"

#include <algorithm>
#include <cmath>

#include "calib/image/image_file.h"
#include "tools/bench/decode/decode_trial.h"
#include "tools/job/calibration.h"
#include "tools/job/check/self_check.h"
#include "tools/job/coded_capture.h"

namespace countershade::bench {

namespace {

namespace fs = std::filesystem;

// What calibrate wrote of one view.
Result<capture::Correspondence> written(const fs::path& folder, const Rig& rig, const ProjectorSpec& projector) {
  CS_TRY(std::vector<Image> read,
         read_exr(folder / (rig.cameras[0].id + "-" + projector.id + ".exr"), {"x", "y", "sigma", "reason"}));
  capture::Correspondence c;
  c.camera = rig.cameras[0].id, c.projector = projector.id, c.projector_resolution = projector.resolution;
  c.x = std::move(read[0]), c.y = std::move(read[1]), c.sigma = std::move(read[2]);
  c.reason = Mask(c.x.width(), c.x.height(), 1);
  for (std::size_t i = 0; i < c.reason.data().size(); ++i)
    c.reason.data()[i] = static_cast<std::uint8_t>(read[3].data()[i]);
  return c;
}

void worst(double& of, double value, bool least) {
  of = least ? std::fmin(of, value) : std::fmax(of, value);
}

void hear_choices(const std::vector<capture::CodeChoice>& choices, Decoding& d) {
  for (const capture::CodeChoice& choice : choices) {
    d.codes += (d.codes.empty() ? "" : ", ") + choice.code;
    for (const capture::CodeForecast& f : choice.forecasts)
      if (f.code == choice.code) worst(d.forecast_percent, 100 * (1 - f.lost), true);
  }
}

// What the camera saw before somebody touched it, and after: a code that was taken anew is of the latter, one of both
// is right by neither.
std::vector<simdata::TrueGeometry> true_views(const SweepSetting& setting, const simdata::Simulator& simulator) {
  std::vector<simdata::TrueGeometry> views{simulator.geometry(0)};
  std::vector<simdata::Fault> touched;
  for (const simdata::Fault& f : setting.faults)
    if (std::string_view(f.kind->name) == "camera-turned") touched.push_back(f);
  constexpr std::uint64_t kLate = 1u << 20;
  if (const auto move = simdata::Faults(touched, setting.room.simulation.seed).camera_move(kLate))
    views.push_back(simulator.geometry(0, simulator.moved_view(0, *move).get()));
  return views;
}

}  // namespace

void check_rig(const SweepSetting& setting, const std::shared_ptr<const simdata::Simulator>& simulator,
               SweepPoint& point) {
  Listener listener;
  const auto findings =
      tools::self_check(setting.room.rig, simdata::simulated_devices(simulator, setting.faults), listener);
  if (!findings) point.check = findings.error().message;
  for (const tools::Finding& f : findings ? *findings : std::vector<tools::Finding>())
    if (!f.ok && point.check.empty()) point.check = f.what + ": " + f.measured;
}

Result<void> run_decoding(const SweepSetting& setting, const std::shared_ptr<const simdata::Simulator>& simulator,
                          const fs::path& folder, SweepPoint& point) {
  std::error_code ignored;
  for (const char* name : {"session", "calibration"}) fs::remove_all(folder / name, ignored);
  const Rig& rig = setting.room.rig;
  Decoding& d = point.decoding.emplace();
  check_rig(setting, simulator, point);
  Listener listener;
  const auto captured = tools::capture_with_code(rig, "", "auto", simdata::simulated_devices(simulator, setting.faults),
                                                 folder / "session", listener);
  point.notes = listener.first();
  if (!captured) {
    point.refusal = "capture: " + captured.error().message;
    return {};
  }
  hear_choices(captured->choices, d);
  const auto made = tools::calibrate(folder / "session", folder / "calibration", {}, listener);
  if (!made) {
    point.refusal = "calibrate: " + made.error().message;
    return {};
  }
  // The last note says that there is no lens, which is so.
  CS_CHECK(!made->notes.empty() && made->notes.back().find("no lens model") != std::string::npos,
           "calibrate without a lens says so last");
  if (made->notes.size() > 1) point.calibrate = made->notes.front();
  const std::vector<simdata::TrueGeometry> views = true_views(setting, *simulator);
  for (std::size_t q = 0; q < rig.projectors.size(); ++q) {
    worst(d.printed_percent, 100 * made->decoded[q].accepted, true);
    if (made->decoded[q].judged) worst(d.held_out_wrong_percent, 100 * made->decoded[q].wrong, false);
    CS_TRY(const capture::Correspondence c, written(folder / "calibration" / "correspondence", rig, rig.projectors[q]));
    DecodeScore s = score_decode(views.front(), static_cast<int>(q), c);
    if (const DecodeScore after = score_decode(views.back(), static_cast<int>(q), c); after.wrong < s.wrong) s = after;
    worst(d.accepted_percent, 100 * s.coverage(), true), worst(d.wrong_percent, 100 * s.wrong_share(), false);
    worst(d.bias_px, s.bias, false), worst(d.random_px, s.random, false), worst(d.z, std::sqrt(s.z2), false);
  }
  return {};
}

}  // namespace countershade::bench
