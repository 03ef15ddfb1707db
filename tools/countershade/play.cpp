// play: the compensation runtime on the displays, or as frames into a folder.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <thread>

#include "calib/file/file.h"
#include "calib/image/image_file.h"
#include "capture/device/window.h"
#include "tools/countershade/calibration.h"
#include "tools/countershade/show.h"
#include "tools/countershade/test_pictures.h"
#include "tools/countershade/verbs.h"

namespace countershade::tools {

namespace {

namespace fs = std::filesystem;

struct Options {
  fs::path calibration;
  std::string source;
  fs::path frames;
  double rate = 25, seconds = 0;
  bool plain = false;
};

// One moment of the show: a picture per projector.
struct Moment {
  std::string name;
  std::vector<Picture> pictures;
};

// A test picture by name; a folder <projector id>.png; or a folder of such folders or of numbered <n>/<projector
// id>.png.
Result<std::vector<Moment>> load_source(const solver::Model& model, const std::string& source) {
  const auto& names = test_picture_names();
  if (std::find(names.begin(), names.end(), source) != names.end()) {
    CS_TRY(std::vector<Picture> pictures, test_pictures(model, source));
    return std::vector<Moment>{{source, std::move(pictures)}};
  }
  if (!fs::is_directory(source))
    return error(ErrorCode::kBadValue,
                 "source '{}' is neither a folder nor a test picture ({}); a folder holds <projector id>.png, or one "
                 "such folder per frame",
                 source, fmt::join(names, ", "));
  std::vector<fs::path> folders;
  for (const auto& entry : fs::directory_iterator(source))
    if (entry.is_directory()) folders.push_back(entry.path());
  std::sort(folders.begin(), folders.end());
  if (folders.empty()) folders.push_back(source);
  std::vector<Moment> moments;
  for (const fs::path& folder : folders) {
    std::vector<std::string> named;
    for (const auto& p : model.projectors)
      for (const char* extension : {".png", ".tif", ".exr"})
        if (fs::exists(folder / (p.id + extension)))
          named.push_back(p.id + "=" + (folder / (p.id + extension)).string());
    if (named.empty())
      return error(ErrorCode::kBadFile, "'{}' holds no picture of a projector; expected '{}.png'", folder.string(),
                   model.projectors[0].id);
    CS_TRY(std::vector<Picture> pictures, load_pictures(model, named));
    moments.push_back({folder.filename().string(), std::move(pictures)});
  }
  return moments;
}

Result<Answer> write_frames(const Options& options, const solver::Model& model, const std::vector<Moment>& moments,
                            const Context& context) {
  CS_TRY_VOID(create_folder_atomically(options.frames, [&](const fs::path& hidden) -> Result<void> {
    for (std::size_t i = 0; i < moments.size(); ++i) {
      context.progress->step("frames", i, moments.size());
      Show show{{}, {moments[i].pictures, {}}, "", 0};
      if (!options.plain) {
        CS_TRY(show, compensate_show(model, moments[i].pictures, {}, Engine::kAuto, *context.progress));
      }
      CS_TRY_VOID(write_show(model, show, 8, hidden / fmt::format("{:04}", i)));
    }
    return {};
  }));
  context.progress->step("frames", moments.size(), moments.size());
  return Answer{fmt::format("wrote {} frames to {}\n", moments.size(), options.frames.string()),
                fmt::format("{{\"frames\": {}, \"output\": \"{}\"}}\n", moments.size(), options.frames.string())};
}

Result<Answer> play_in_windows(const Options& options, const Calibration& calibration,
                               const std::vector<Moment>& moments, const Context& context) {
  std::vector<std::unique_ptr<capture::Projector>> windows;
  for (const solver::ProjectorModel& p : calibration.model.projectors) {
    const ProjectorSpec* spec = calibration.rig.projector(p.id);
    CS_TRY(auto window, capture::open_window_projector(p.id, p.device.lens.width(), p.device.lens.height(),
                                                       spec ? spec->monitor : "", "countershade " + p.id));
    windows.push_back(std::move(window));
  }
  const auto start = std::chrono::steady_clock::now();
  const auto elapsed = [&] { return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count(); };
  int frames = 0;
  const double until = options.seconds > 0 ? options.seconds : HUGE_VAL;
  while (elapsed() < until) {
    const Moment& moment = moments[frames % moments.size()];
    Show show{{}, {moment.pictures, {}}, "", 0};
    if (!options.plain) {
      CS_TRY(show, compensate_show(calibration.model, moment.pictures, {}, Engine::kAuto, *context.progress));
    }
    for (std::size_t q = 0; q < windows.size(); ++q) {
      const Picture& picture = show.compensated.pictures[q];
      CS_TRY_VOID(windows[q]->show(picture.empty() ? Picture(windows[q]->width(), windows[q]->height(), 3) : picture));
    }
    ++frames;
    std::this_thread::sleep_for(std::chrono::duration<double>(std::max(0.0, frames / options.rate - elapsed())));
  }
  return Answer{fmt::format("played {} frames in {:.1f} s\n", frames, elapsed()),
                fmt::format("{{\"frames\": {}, \"seconds\": {:.3f}}}\n", frames, elapsed())};
}

Result<Answer> run_play(const Options& options, const Context& context) {
  CS_TRY(const Calibration calibration, open_calibration(options.calibration));
  CS_TRY(const std::vector<Moment> moments, load_source(calibration.model, options.source));
  if (!options.frames.empty()) return write_frames(options, calibration.model, moments, context);
  return play_in_windows(options, calibration, moments, context);
}

}  // namespace

void add_play(CLI::App& app, Action& action) {
  auto* verb = app.add_subcommand("play", "show a source, compensated, on the displays");
  auto options = std::make_shared<Options>();
  verb->add_option("calibration", options->calibration, "calibration folder")->required();
  verb->add_option("source", options->source,
                   "test picture, folder with <projector id>.png, or folder of such folders (one per frame)")
      ->required();
  verb->add_option("--frames", options->frames, "write frames into this folder instead of opening windows");
  verb->add_option("--rate", options->rate, "frames per second")->check(CLI::Range(0.1, 240.0))->capture_default_str();
  verb->add_option("--seconds", options->seconds, "stop after this long [default: when the window is closed]");
  verb->add_flag("--plain", options->plain, "without compensation");
  verb->callback([options, &action] { action = [options](const Context& c) { return run_play(*options, c); }; });
}

}  // namespace countershade::tools
