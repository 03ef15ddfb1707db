#include <CLI/CLI.hpp>
#include <chrono>
#include <nlohmann/json.hpp>

#include "calib/file/file.h"
#include "tools/countershade/console.h"
#include "tools/countershade/verbs.h"
#include "tools/job/devices.h"
#include "tools/job/verification.h"

namespace countershade::tools {

namespace {

namespace fs = std::filesystem;

struct Options {
  fs::path calibration, rig, out = "report";
  std::vector<std::string> pictures, photos;
  std::string picture = "photo";
  int exposures = 16;
  Engine engine = Engine::kAuto;
};

// Where the calibration's provenance tells: how long it took, and how long the capture of its session took.
void add_seconds(const fs::path& calibration, ReportContext& about) {
  const auto document = [](const fs::path& folder) {
    const Result<std::string> text = read_text(folder / "provenance.json");
    return nlohmann::json::parse(text ? *text : "", nullptr, false);
  };
  const nlohmann::json own = document(calibration);
  if (!own.is_object()) return;
  about.compute_seconds = own.value("seconds", 0.0);
  const nlohmann::json inputs = own.value("inputs", nlohmann::json::object());
  for (const auto& [path, hash] : inputs.items())
    if (const nlohmann::json session = document(fs::path(path).parent_path()); session.is_object())
      about.capture_seconds = session.value("seconds", 0.0);
}

// The simulated room of the session a calibration was made from: the provenance names the session.
Result<fs::path> simulation_of(const fs::path& calibration) {
  const auto missing = [&] {
    return error(ErrorCode::kDevice,
                 "calibration '{}' does not say where its devices are (no provenance.json of a simulated session); "
                 "give the rig with --rig, or photos with --photos",
                 calibration.string());
  };
  const Result<std::string> text = read_text(calibration / "provenance.json");
  if (!text) return missing();
  const nlohmann::json document = nlohmann::json::parse(*text, nullptr, false);
  if (document.is_discarded()) return missing();
  const nlohmann::json inputs = document.value("inputs", nlohmann::json::object());
  for (const auto& [path, hash] : inputs.items()) {
    const fs::path file = fs::path(path).parent_path() / "simulation.toml";
    if (fs::exists(file)) return file;
  }
  return missing();
}

// A photo as the session's photos are read; one channel stays one channel.
Result<Image> linear_photo(const fs::path& file, const Calibration& calibration) {
  CS_TRY(const Photo photo, read_photo(file, *calibration.rig.camera(calibration.camera_id)));
  if (!photo.value.same_size(calibration.camera.lens.width(), calibration.camera.lens.height()))
    return error(ErrorCode::kBadFile, "'{}' has {} x {} pixels, the calibrated camera has {} x {}", file.string(),
                 photo.value.width(), photo.value.height(), calibration.camera.lens.width(),
                 calibration.camera.lens.height());
  Image light = photo.value;
  take_out_veil(light, calibration.summary.veil);
  return light;
}

// U C [REFERENCE ...]: one reference is the target, several are parts of it that add up.
Result<Photographs> given_photos(const Options& options, const Calibration& calibration) {
  if (options.photos.size() < 3)
    return error(ErrorCode::kBadValue,
                 "--photos has {} files; it needs the plain show, the compensated show and at least one photo of the "
                 "target (the picture's parts, each shown alone, add up to it)",
                 options.photos.size());
  Photographs photos;
  CS_TRY(photos.uncompensated, linear_photo(options.photos[0], calibration));
  CS_TRY(photos.compensated, linear_photo(options.photos[1], calibration));
  CS_TRY(photos.target, linear_photo(options.photos[2], calibration));
  for (std::size_t i = 3; i < options.photos.size(); ++i) {
    CS_TRY(const Image part, linear_photo(options.photos[i], calibration));
    if (part.channels() != photos.target.channels())
      return error(ErrorCode::kBadFile, "'{}' has {} channels, the other photos {}", options.photos[i], part.channels(),
                   photos.target.channels());
    for (std::size_t k = 0; k < part.data().size(); ++k) photos.target.data()[k] += part.data()[k];
  }
  if (photos.uncompensated.channels() != photos.target.channels() ||
      photos.compensated.channels() != photos.target.channels())
    return error(ErrorCode::kBadFile, "the photos differ in their number of channels");
  Photo noise{photos.uncompensated, Mask(photos.uncompensated.width(), photos.uncompensated.height(), 1, 1), 0};
  photos.pixel_noise = estimate_noise(std::span(&noise, 1)).sigma(0.4);
  photos.exposures = static_cast<int>(options.photos.size());
  return photos;
}

std::string text_of(const Verification& v, const fs::path& out) {
  const VerifyNumbers& n = v.numbers;
  std::string text = fmt::format(
      "{}: suppression {:.1f}x ({:.1f}x where nothing clips), {:.2f} -> {:.3f} % of white from the target, edge zone "
      "{:.2f} -> {:.2f} grey levels\n",
      v.verdict.pass ? "PASS" : "FAIL", n.all.suppression, n.unclipped.suppression, n.all.uncompensated.mean_percent,
      n.all.compensated.mean_percent, n.edge.uncompensated.mean_grey, n.edge.compensated.mean_grey);
  for (const std::string& f : v.verdict.failures) text += "  " + f + "\n";
  return text + "report: " + (out / "report.html").string() + "\n";
}

Result<Answer> run_verify(const Options& options, const Context& context) {
  const auto start = std::chrono::steady_clock::now();
  CS_TRY(const Calibration calibration, open_calibration(options.calibration));
  const solver::PixelGeometry pixels = pixels_of(calibration);
  Photographs photos;
  Show show;
  if (!options.photos.empty()) {
    CS_TRY(photos, given_photos(options, calibration));
  } else {
    std::vector<Picture> pictures;
    if (options.pictures.empty()) {
      CS_TRY(pictures, test_pictures(calibration.model, options.picture));
    } else {
      CS_TRY(pictures, load_pictures(calibration.model, options.pictures));
    }
    CS_TRY(show, compensate_show(calibration.model, pictures, {}, options.engine, *context.progress));
    fs::path simulation = options.rig;
    if (simulation.empty()) {
      CS_TRY(simulation, simulation_of(options.calibration));
    }
    CS_TRY(const OpenDevices open, open_devices(calibration.rig, simulation, *context.progress));
    const CameraSpec& camera = *calibration.rig.camera(calibration.camera_id);
    CS_TRY(photos, photograph(open.devices, camera, pixels, pictures, show.compensated.pictures,
                              calibration.summary.veil, options.exposures, *context.progress));
  }
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  const Table effort{
      "Effort",
      {"what", "value"},
      {{"exposures", fmt::format("{}", photos.exposures)},
       {"verification took", duration_text(seconds)},
       {"picture", options.pictures.empty() ? options.picture : fmt::format("{}", fmt::join(options.pictures, ", "))}}};
  ReportContext about{options.calibration.string(), context.options, {effort}, {}, {}};
  add_seconds(options.calibration, about);
  CS_TRY(const Verification v,
         report_verification(calibration, options.calibration, pixels, photos, options.photos.empty() ? &show : nullptr,
                             about, options.out, context.recorder({options.calibration / "calibration.json"})));
  return Answer{text_of(v, options.out), numbers_json(v.numbers, v.verdict), v.verdict.pass ? 0 : 1};
}

}  // namespace

void add_verify(CLI::App& app, Action& action) {
  auto* verb = app.add_subcommand("verify", "photograph plain, compensated and target; report PASS or FAIL");
  auto options = std::make_shared<Options>();
  verb->add_option("calibration", options->calibration, "calibration folder")->required();
  auto* pictures =
      verb->add_option("--picture", options->pictures, "ID=file, per projector [default: the test picture]");
  verb->add_option("--test-picture", options->picture, "flat, gradient, photo, window, text, saturated or table-1")
      ->capture_default_str()
      ->excludes(pictures);
  verb->add_option("--photos", options->photos,
                   "take these photos instead of photographing: plain, compensated, target (several parts add up); the "
                   "glare that "
                   "the calibration knows is taken out of them")
      ->expected(1, 64);
  verb->add_option("--rig", options->rig, "rig.toml of the devices [default: those of the calibration's session]");
  verb->add_option("--exposures", options->exposures, "photos averaged for each picture")
      ->check(CLI::Range(1, 1024))
      ->capture_default_str();
  verb->add_option("--engine", options->engine, "auto, gl or cpu")
      ->transform(CLI::CheckedTransformer(
          std::map<std::string, Engine>{{"auto", Engine::kAuto}, {"gl", Engine::kGl}, {"cpu", Engine::kCpu}}));
  verb->add_option("-o,--output", options->out, "report folder to write")->capture_default_str();
  verb->callback([options, &action] { action = [options](const Context& c) { return run_verify(*options, c); }; });
}

}  // namespace countershade::tools
