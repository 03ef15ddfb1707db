#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "calib/file/file.h"
#include "tools/countershade/verbs.h"
#include "tools/job/calibration.h"

namespace countershade::tools {

namespace {

namespace fs = std::filesystem;

struct Options {
  std::vector<fs::path> sessions;
  fs::path out = "calibration";
  std::vector<int> patches;
};

std::string text_of(const CalibrationSummary& s, const fs::path& out) {
  std::string text;
  for (const DecodeSummary& d : s.decoded)
    text += fmt::format("decoded {:<12} {:5.1f} % of {} lit pixels{}\n", d.projector, 100 * d.accepted, d.lit,
                        d.judged ? fmt::format("; wrong by held-out patterns: {:.3f} %, by sigma {:.3f} %",
                                               100 * d.wrong, 100 * d.expected_wrong)
                                 : "") +
            (d.rejected.empty() ? "" : "  rejected: " + rejected_text(d.rejected) + "\n");
  for (std::size_t q = 0; q < s.reprojection_px.size(); ++q)
    text += fmt::format("reprojection {:<7} {:.3f} px rms\n", s.decoded[q].projector, s.reprojection_px[q]);
  for (std::size_t i = 0; i < s.crease_angle_deg.size(); ++i)
    text +=
        fmt::format("edge angle           {:.2f} +- {:.2f} degrees\n", s.crease_angle_deg[i], s.crease_sigma_deg[i]);
  if (s.has_model)
    text += fmt::format(
        "indirect gain k      {:.3f} {:.3f} {:.3f} (mean r g b)\nchi2 / freedom       {:.2f}\nheld-out error       "
        "{:.3f} % of white (99th percentile {:.3f} %)\n",
        s.mean_k[0], s.mean_k[1], s.mean_k[2], s.chi2, 100 * s.held_out_error, 100 * s.held_out_p99);
  for (const std::string& note : s.notes) text += "note: " + note + "\n";
  text += s.has_model ? fmt::format("wrote {0}\nnext: countershade verify {0} -o report/\n", out.string())
                      : fmt::format("wrote {}\n", out.string());
  return text;
}

Result<Answer> run_calibrate(const Options& options, const Context& context) {
  if (options.sessions.size() > 1)
    return error(ErrorCode::kUnsupported, "{} sessions given; this version evaluates one at a time",
                 options.sessions.size());
  CalibrateOptions calibrate_options;
  if (!options.patches.empty()) {
    if (options.patches[0] < 1 || options.patches[1] < 1 || options.patches[0] > 256 || options.patches[1] > 256)
      return error(ErrorCode::kBadValue, "--patches {} {}: each must be 1 to 256", options.patches[0],
                   options.patches[1]);
    calibrate_options.patches = {options.patches[0], options.patches[1]};
  }
  CS_TRY(const CalibrationSummary summary,
         calibrate(options.sessions[0], options.out, calibrate_options, *context.progress,
                   context.recorder({options.sessions[0] / "sequence.json", options.sessions[0] / "rig.toml"})));
  CS_TRY(const std::string document, read_text(options.out / "calibration.json"));
  return Answer{text_of(summary, options.out), document};
}

}  // namespace

void add_calibrate(CLI::App& app, Action& action) {
  auto* verb = app.add_subcommand("calibrate", "geometry, response, transport; prints held-out error");
  auto options = std::make_shared<Options>();
  verb->add_option("sessions", options->sessions, "session folder")->required();
  verb->add_option("-o,--output", options->out, "calibration folder to write")->capture_default_str();
  verb->add_option("--patches", options->patches, "patches per surface along u and v [default: auto]")->expected(2);
  verb->callback([options, &action] { action = [options](const Context& c) { return run_calibrate(*options, c); }; });
}

}  // namespace countershade::tools
