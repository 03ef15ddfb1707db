// run: check, capture, calibrate, compensate, verify, in one go.
#include <CLI/CLI.hpp>
#include <chrono>

#include "calib/file/file.h"
#include "tools/countershade/console.h"
#include "tools/countershade/verbs.h"
#include "tools/job/check/self_check.h"
#include "tools/job/coded_capture.h"
#include "tools/job/devices.h"
#include "tools/job/verification.h"

namespace countershade::tools {

namespace {

namespace fs = std::filesystem;

struct Options {
  fs::path rig, out = "results";
  std::string picture = "photo";
  int exposures = 16;
};

class Stopwatch {
 public:
  double lap() {
    const auto now = std::chrono::steady_clock::now();
    const double seconds = std::chrono::duration<double>(now - last_).count();
    last_ = now;
    return seconds;
  }

 private:
  std::chrono::steady_clock::time_point last_ = std::chrono::steady_clock::now();
};

Result<void> stop_if_wrong(const std::vector<Finding>& findings) {
  for (const Finding& f : findings)
    if (!f.ok)
      return error(ErrorCode::kDevice, "the check before capture failed: {}: {}; {}", f.what, f.measured, f.remedy);
  return {};
}

Result<Answer> run_all(const Options& options, const Context& context) {
  Progress& progress = *context.progress;
  CS_TRY(const Rig rig, read_rig(options.rig));
  const fs::path session = options.out / "session", calibration_folder = options.out / "calibration",
                 report = options.out / "report";
  if (fs::exists(report))
    return error(ErrorCode::kExists, "'{}' exists already; choose another folder with -o or remove it",
                 report.string());
  std::error_code code;
  fs::create_directories(options.out, code);
  if (code) return error(ErrorCode::kIo, "cannot create '{}': {}", options.out.string(), code.message());
  Stopwatch watch;
  CS_TRY(const OpenDevices open, open_devices(rig, options.rig, progress));
  const double opened = watch.lap();
  CS_TRY(const std::vector<Finding> findings, self_check(rig, open.devices, progress));
  CS_TRY_VOID(stop_if_wrong(findings));
  const std::string simulation = open.simulator ? simulation_text(open.simulator->simulation()) : "";
  CS_TRY(const CodedCapture coded, capture_with_code(rig, simulation, "auto", open.devices, session, progress));
  const double captured = watch.lap();
  if (fs::exists(calibration_folder)) {
    progress.note(fmt::format("'{}' stands already: it is not made anew", calibration_folder.string()));
  } else {
    CalibrateOptions calibrate_options;
    calibrate_options.decoded = coded.decoded;
    CS_TRY_VOID(calibrate(session, calibration_folder, calibrate_options, progress,
                          context.recorder({session / "sequence.json", session / "rig.toml"})));
  }
  const double calibrated = watch.lap();
  CS_TRY(const Calibration calibration, open_calibration(calibration_folder));
  const CalibrationSummary& summary = calibration.summary;
  const solver::PixelGeometry pixels = pixels_of(calibration);
  CS_TRY(const std::vector<Picture> pictures, test_pictures(calibration.model, options.picture));
  CS_TRY(const Show show, compensate_show(calibration.model, pictures, {}, Engine::kAuto, progress));
  CS_TRY(const Photographs photos, photograph(open.devices, *rig.camera(calibration.camera_id), pixels, pictures,
                                              show.compensated.pictures, summary.veil, options.exposures, progress));
  const double photographed = watch.lap();
  Table effort{
      "Effort",
      {"step", "photos", "seconds"},
      {{"devices opened", "", fmt::format("{:.1f}", opened)},
       {"check and capture", fmt::format("{}", coded.sequence.frames.size()), fmt::format("{:.1f}", captured)},
       {"calibrate", "", fmt::format("{:.1f}", calibrated)},
       {"compensate and photograph", fmt::format("{}", photos.exposures), fmt::format("{:.1f}", photographed)}}};
  Table codes{"Which projector pixel is it", {"projector", "code", "direct light", "forecast: lost", "why"}, {}};
  for (const capture::CodeChoice& c : coded.choices)
    for (const capture::CodeForecast& f : c.forecasts)
      if (f.code == c.code)
        codes.rows.push_back({c.projector, c.code, fmt::format("{:.0f} %", 100 * c.direct),
                              fmt::format("{:.2f} %", 100 * f.lost), c.reason});
  Table checks{"Check before capture", {"what", "measured"}, {}};
  for (const Finding& f : findings) checks.rows.push_back({f.what, f.measured});
  const ReportContext about{fmt::format("{}, picture {}", options.rig.string(), options.picture),
                            context.options,
                            {effort, checks, codes},
                            captured,
                            calibrated + show.milliseconds / 1000};
  CS_TRY(const Verification v,
         report_verification(calibration, calibration_folder, pixels, photos, &show, about, report,
                             context.recorder({calibration_folder / "calibration.json"})));
  const VerifyNumbers& n = v.numbers;
  std::string text = choices_text(coded);
  text += fmt::format(
      "{}: suppression {:.1f}x, {:.2f} -> {:.3f} % of white from the target, edge zone {:.2f} -> {:.2f} grey levels, "
      "held-out error {:.3f} % of white\n",
      v.verdict.pass ? "PASS" : "FAIL", n.all.suppression, n.all.uncompensated.mean_percent,
      n.all.compensated.mean_percent, n.edge.uncompensated.mean_grey, n.edge.compensated.mean_grey,
      100 * summary.held_out_error);
  for (const std::string& f : v.verdict.failures) text += "  " + f + "\n";
  text += fmt::format("opened {:.1f} s, captured {:.1f} s, calibrated {:.1f} s, photographed {:.1f} s\nreport: {}\n",
                      opened, captured, calibrated, photographed, (report / "report.html").string());
  return Answer{text, numbers_json(n, v.verdict), v.verdict.pass ? 0 : 1};
}

}  // namespace

void add_run(CLI::App& app, Action& action) {
  auto* verb = app.add_subcommand("run", "all of it, to the report: check, capture, calibrate, compensate, verify");
  auto options = std::make_shared<Options>();
  verb->add_option("rig", options->rig, "rig.toml")->required();
  verb->add_option("-o,--output", options->out,
                   "folder for session, calibration and report; a job that was stopped goes on where it stood")
      ->capture_default_str();
  verb->add_option("--test-picture", options->picture, "picture to verify with")->capture_default_str();
  verb->add_option("--exposures", options->exposures, "photos averaged for each picture")
      ->check(CLI::Range(1, 1024))
      ->capture_default_str();
  verb->callback([options, &action] { action = [options](const Context& c) { return run_all(*options, c); }; });
}

}  // namespace countershade::tools
