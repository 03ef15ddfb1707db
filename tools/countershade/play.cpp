// play: the compensation runtime on the displays, or as frames into a folder.
#include <poll.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <thread>

#include "calib/file/file.h"
#include "calib/image/image_file.h"
#include "capture/device/display.h"
#include "capture/device/window.h"
#include "solver/runtime/runtime.h"
#include "tools/countershade/verbs.h"
#include "tools/job/calibration.h"
#include "tools/job/show.h"
#include "tools/job/test_pictures.h"

namespace countershade::tools {

namespace {

namespace fs = std::filesystem;

struct Options {
  fs::path calibration;
  std::string source;
  fs::path frames;
  double rate = 25, seconds = 0;
  bool plain = false;
  Engine engine = Engine::kAuto;
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

// The projectors' windows. Pictures change seldom, frames are shown always.
class Stage {
 public:
  virtual ~Stage() = default;
  virtual Result<void> draw(std::span<const Picture> pictures, bool compensated) = 0;
  virtual Result<void> show() = 0;  // what was drawn last
  virtual std::string typed() = 0;
  virtual std::string engine() const = 0;
};

// The GL runtime draws on the graphics card of the windows; nothing is read back.
class GlStage final : public Stage {
 public:
  static Result<std::unique_ptr<Stage>> open(const solver::Model& model,
                                             const std::vector<capture::DisplayWindow>& windows) {
    auto stage = std::make_unique<GlStage>();
    CS_TRY(stage->display_, capture::TextureDisplay::open(windows));
    CS_TRY(stage->runtime_, solver::Runtime::make(model, {}, solver::Precision::kHalf));
    for (std::size_t q = 0; q < windows.size(); ++q)
      stage->textures_.push_back(stage->runtime_->output_texture(static_cast<int>(q)));
    return std::unique_ptr<Stage>(std::move(stage));
  }
  Result<void> draw(std::span<const Picture> pictures, bool compensated) override {
    runtime_->choose(compensated ? solver::SolverChoice::kAuto : solver::SolverChoice::kCopy);
    return runtime_->render(pictures);
  }
  Result<void> show() override { return display_->present(textures_); }
  std::string typed() override { return display_->typed(); }
  std::string engine() const override { return "GL"; }

 private:
  std::unique_ptr<capture::TextureDisplay> display_;  // before the runtime: it goes last
  std::unique_ptr<solver::Runtime> runtime_;
  std::vector<unsigned> textures_;
};

// Where the display has no OpenGL 4.3: the library computes, plain windows show.
class CpuStage final : public Stage {
 public:
  static Result<std::unique_ptr<Stage>> open(const solver::Model& model,
                                             const std::vector<capture::DisplayWindow>& windows) {
    auto stage = std::make_unique<CpuStage>(model);
    for (const capture::DisplayWindow& w : windows) {
      CS_TRY(auto window,
             capture::open_window_projector(w.projector, w.width, w.height, w.monitor, "countershade " + w.projector));
      stage->windows_.push_back(std::move(window));
    }
    return std::unique_ptr<Stage>(std::move(stage));
  }
  explicit CpuStage(const solver::Model& model) : compensator_(model) {}
  Result<void> draw(std::span<const Picture> pictures, bool compensated) override {
    const auto solver = compensated ? solver::SolverChoice::kAuto : solver::SolverChoice::kCopy;
    drawn_ = compensator_.frame(pictures, {.solver = solver}).pictures;
    return {};
  }
  Result<void> show() override {
    for (std::size_t q = 0; q < windows_.size(); ++q) CS_TRY_VOID(windows_[q]->show(drawn_[q]));
    return {};
  }
  std::string typed() override { return ""; }
  std::string engine() const override { return "CPU"; }

 private:
  solver::Compensator compensator_;
  std::vector<std::unique_ptr<capture::Projector>> windows_;
  std::vector<Picture> drawn_;
};

Result<std::unique_ptr<Stage>> open_stage(const Options& options, const Calibration& calibration, Progress& progress) {
  std::vector<capture::DisplayWindow> windows;
  for (const solver::ProjectorModel& p : calibration.model.projectors) {
    const ProjectorSpec* spec = calibration.rig.projector(p.id);
    windows.push_back({p.id, p.device.lens.width(), p.device.lens.height(), spec ? spec->monitor : ""});
  }
  if (options.engine != Engine::kCpu) {
    Result<std::unique_ptr<Stage>> stage = GlStage::open(calibration.model, windows);
    if (stage || options.engine == Engine::kGl) return stage;
    progress.note(stage.error().message + "; frames are computed on the CPU");
  }
  return CpuStage::open(calibration.model, windows);
}

// Letters typed on standard input since the last call (a terminal hands them over with Enter).
class Terminal {
 public:
  std::string typed() {
    std::string letters;
    char c = 0;
    pollfd input{STDIN_FILENO, POLLIN, 0};
    while (open_ && poll(&input, 1, 0) > 0) {
      open_ = read(STDIN_FILENO, &c, 1) == 1;
      if (open_) letters += c;
    }
    return letters;
  }

 private:
  bool open_ = true;
};

// What the operator can switch while it plays.
struct Switches {
  bool compensated = true, quit = false;
  int pattern = -1;  // of test_picture_names(); -1 = the source

  void press(const std::string& letters) {
    const int patterns = static_cast<int>(test_picture_names().size());
    for (char c : letters) {
      if (c == 'c') compensated = !compensated;
      if (c == 't') pattern = pattern + 1 == patterns ? -1 : pattern + 1;
      if (c == 'q') quit = true;
    }
  }
  std::string text() const {
    return fmt::format("compensation {}, {}", compensated ? "on" : "off",
                       pattern < 0 ? "source" : "test picture " + test_picture_names()[pattern]);
  }
};

Result<Answer> play_in_windows(const Options& options, const Calibration& calibration,
                               const std::vector<Moment>& moments, const Context& context) {
  CS_TRY(const auto stage, open_stage(options, calibration, *context.progress));
  context.progress->note("keys, in a window or here with Enter: c compensation, t test picture, q quit");
  Terminal terminal;
  Switches switches;
  switches.compensated = !options.plain;
  const auto start = std::chrono::steady_clock::now();
  const auto elapsed = [&] { return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count(); };
  const double until = options.seconds > 0 ? options.seconds : HUGE_VAL;
  int frames = 0, late = 0;
  std::string drawn, said;
  while (elapsed() < until && !switches.quit) {
    switches.press(stage->typed() + terminal.typed());
    const Moment& moment = moments[frames % moments.size()];
    if (const std::string wanted = switches.text() + (switches.pattern < 0 ? moment.name : ""); wanted != drawn) {
      std::vector<Picture> pictures;
      if (switches.pattern >= 0) {
        CS_TRY(pictures, test_pictures(calibration.model, test_picture_names()[switches.pattern]));
      }
      CS_TRY_VOID(stage->draw(switches.pattern >= 0 ? pictures : moment.pictures, switches.compensated));
      drawn = wanted;
    }
    CS_TRY_VOID(stage->show());
    if (switches.text() != said) context.progress->note(said = switches.text());
    ++frames;
    late += elapsed() > (frames + 1) / options.rate;
    std::this_thread::sleep_for(std::chrono::duration<double>(std::max(0.0, frames / options.rate - elapsed())));
  }
  return Answer{fmt::format("played {} frames in {:.1f} s on {}, {} late\n", frames, elapsed(), stage->engine(), late),
                fmt::format("{{\"frames\": {}, \"seconds\": {:.3f}, \"engine\": \"{}\", \"late\": {}}}\n", frames,
                            elapsed(), stage->engine(), late)};
}

Result<Answer> run_play(const Options& options, const Context& context) {
  CS_TRY(const Calibration calibration, open_calibration(options.calibration));
  CS_TRY(const std::vector<Moment> moments, load_source(calibration.model, options.source));
  if (!options.frames.empty()) return write_frames(options, calibration.model, moments, context);
  return play_in_windows(options, calibration, moments, context);
}

}  // namespace

void add_play(CLI::App& app, Action& action) {
  auto* verb =
      app.add_subcommand("play", "show a source, compensated, on the displays; keys c, t, q switch while it plays");
  auto options = std::make_shared<Options>();
  verb->add_option("calibration", options->calibration, "calibration folder")->required();
  verb->add_option("source", options->source,
                   "test picture, folder with <projector id>.png, or folder of such folders (one per frame)")
      ->required();
  verb->add_option("--frames", options->frames, "write frames into this folder instead of opening windows");
  verb->add_option("--rate", options->rate, "frames per second")->check(CLI::Range(0.1, 240.0))->capture_default_str();
  verb->add_option("--seconds", options->seconds, "stop after this long [default: when a window is closed]");
  verb->add_option("--engine", options->engine, "auto, gl or cpu")
      ->transform(CLI::CheckedTransformer(
          std::map<std::string, Engine>{{"auto", Engine::kAuto}, {"gl", Engine::kGl}, {"cpu", Engine::kCpu}}));
  verb->add_flag("--plain", options->plain, "begin without compensation");
  verb->callback([options, &action] { action = [options](const Context& c) { return run_play(*options, c); }; });
}

}  // namespace countershade::tools
