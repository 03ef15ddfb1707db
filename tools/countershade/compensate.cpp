#include <CLI/CLI.hpp>

#include "tools/countershade/verbs.h"
#include "tools/job/calibration.h"
#include "tools/job/show.h"

namespace countershade::tools {

namespace {

struct Options {
  std::filesystem::path calibration, out = "out";
  std::vector<std::string> pictures;
  int bits = 8;
  Engine engine = Engine::kAuto;
};

const char* name_of(solver::SolverChoice choice) {
  switch (choice) {
    case solver::SolverChoice::kCopy:
      return "copy";
    case solver::SolverChoice::kClosedForm:
      return "closed form";
    case solver::SolverChoice::kClipped:
      return "clipped";
    case solver::SolverChoice::kAuto:
      break;
  }
  return "auto";
}

Result<Answer> run_compensate(const Options& options, const Context& context) {
  CS_TRY(const Calibration calibration, open_calibration(options.calibration));
  CS_TRY(const std::vector<Picture> pictures, load_pictures(calibration.model, options.pictures));
  solver::CompensateOptions how;
  how.bits = options.bits;
  CS_TRY(const Show show, compensate_show(calibration.model, pictures, how, options.engine, *context.progress));
  std::vector<std::filesystem::path> inputs{options.calibration / "calibration.json"};
  for (const std::string& text : options.pictures) inputs.push_back(parse_named_picture(text).file);
  CS_TRY_VOID(write_show(calibration.model, show, options.bits, options.out, context.recorder(inputs)));
  const solver::FrameReport& r = show.compensated.report;
  return Answer{
      fmt::format("{} on {}: solver {}, {} gathers, {:.1f} % of white scattered at most, {:.2f} % of pixels "
                  "clipped\nwrote {}\n",
                  options.calibration.string(), show.engine, name_of(r.used), r.gathers, 100 * r.largest_indirect,
                  100 * r.clipped_pixels, options.out.string()),
      fmt::format("{{\"engine\": \"{}\", \"solver\": \"{}\", \"gathers\": {}, \"clipped_share\": {:.6g}, "
                  "\"largest_indirect\": {:.6g}, \"output\": \"{}\"}}\n",
                  show.engine, name_of(r.used), r.gathers, r.clipped_pixels, r.largest_indirect, options.out.string())};
}

}  // namespace

void add_compensate(CLI::App& app, Action& action) {
  auto* verb = app.add_subcommand("compensate", "write the pictures to show instead of the given ones");
  auto options = std::make_shared<Options>();
  verb->add_option("calibration", options->calibration, "calibration folder")->required();
  verb->add_option("--picture", options->pictures,
                   "ID=file: PNG, TIFF or linear EXR in that projector's pixels; projectors without one show black")
      ->required();
  verb->add_option("-o,--output", options->out, "folder to write")->capture_default_str();
  verb->add_option("--bits", options->bits, "8 (dithered) or 16")->check(CLI::IsMember({8, 16}))->capture_default_str();
  verb->add_option("--engine", options->engine, "auto, gl or cpu")
      ->transform(CLI::CheckedTransformer(
          std::map<std::string, Engine>{{"auto", Engine::kAuto}, {"gl", Engine::kGl}, {"cpu", Engine::kCpu}}));
  verb->callback([options, &action] { action = [options](const Context& c) { return run_compensate(*options, c); }; });
}

}  // namespace countershade::tools
