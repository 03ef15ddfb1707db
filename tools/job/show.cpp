#include "tools/job/show.h"

#include <chrono>

#include "calib/base/parallel.h"
#include "calib/file/file.h"
#include "calib/image/image_file.h"
#include "solver/runtime/runtime.h"
#include "tools/job/test_pictures.h"

namespace countershade::tools {

namespace {

Result<Picture> load_picture(const std::filesystem::path& file, const ProjectorResponse& response) {
  if (file.extension() != ".exr") return read_picture(file);
  CS_TRY(const StoredImage linear, read_image(file));
  Picture picture(linear.values.width(), linear.values.height(), 3);
  const int channels = linear.values.channels();
  for (std::size_t i = 0; i < picture.pixels(); ++i)
    for (int c = 0; c < 3; ++c)
      picture.data()[3 * i + c] = static_cast<std::uint16_t>(
          std::lround(65535 * response.curve.encode(linear.values.data()[channels * i + (channels == 3 ? c : 0)])));
  return picture;
}

Result<Show> show_on_gl(const solver::Model& model, std::span<const Picture> pictures,
                        const solver::CompensateOptions& options) {
  CS_TRY(const auto context, solver::HeadlessContext::make());
  CS_TRY(const auto runtime, solver::Runtime::make(model, options, solver::Precision::kHalf));
  const auto start = std::chrono::steady_clock::now();
  CS_TRY_VOID(runtime->render(pictures));
  CS_TRY(solver::Compensated compensated, runtime->read());
  const std::chrono::duration<double, std::milli> took = std::chrono::steady_clock::now() - start;
  return Show{
      {pictures.begin(), pictures.end()}, std::move(compensated), "GL: " + context->description(), took.count()};
}

}  // namespace

NamedPicture parse_named_picture(const std::string& text) {
  const std::size_t equals = text.find('=');
  if (equals == std::string::npos) return {"", text};
  return {text.substr(0, equals), text.substr(equals + 1)};
}

Result<std::vector<Picture>> load_pictures(const solver::Model& model, const std::vector<std::string>& named) {
  std::vector<Picture> pictures(model.projectors.size());
  for (const std::string& text : named) {
    const NamedPicture one = parse_named_picture(text);
    if (one.id.empty())
      return error(ErrorCode::kUnsupported,
                   "--picture {}: pictures on the screen's own chart need a registration, which this version does not "
                   "have; name the "
                   "projector: --picture {}={}",
                   text, model.projectors[0].id, text);
    std::size_t q = 0;
    while (q < model.projectors.size() && model.projectors[q].id != one.id) ++q;
    if (q == model.projectors.size()) {
      std::string known;
      for (const auto& p : model.projectors) known += (known.empty() ? "" : ", ") + p.id;
      return error(ErrorCode::kBadValue, "--picture {}: the calibration has no projector '{}'; it has {}", text, one.id,
                   known);
    }
    const solver::ProjectorModel& p = model.projectors[q];
    CS_TRY(pictures[q], load_picture(one.file, p.response));
    if (!pictures[q].same_size(p.device.lens.width(), p.device.lens.height()))
      return error(ErrorCode::kBadValue,
                   "'{}' is {} x {} pixels, projector '{}' has {} x {}; scale the picture to the projector",
                   one.file.string(), pictures[q].width(), pictures[q].height(), p.id, p.device.lens.width(),
                   p.device.lens.height());
  }
  return pictures;
}

Result<std::vector<Picture>> test_pictures(const solver::Model& model, const std::string& name) {
  std::vector<Picture> pictures;
  for (std::size_t q = 0; q < model.projectors.size(); ++q) {
    const Lens& lens = model.projectors[q].device.lens;
    CS_TRY(Picture picture, test_picture(name, static_cast<int>(q), lens.width(), lens.height()));
    pictures.push_back(std::move(picture));
  }
  return pictures;
}

Result<Show> compensate_show(const solver::Model& model, std::span<const Picture> pictures,
                             const solver::CompensateOptions& options, Engine engine, Progress& progress) {
  if (engine != Engine::kCpu) {
    Result<Show> show = show_on_gl(model, pictures, options);
    if (show || engine == Engine::kGl) return show;
    progress.note("no GL: " + show.error().message + "; the frame is computed on the CPU");
  }
  const solver::Compensator compensator(model);
  const auto start = std::chrono::steady_clock::now();
  Show show{{pictures.begin(), pictures.end()}, compensator.frame(pictures, options), "CPU", 0};
  const std::chrono::duration<double, std::milli> took = std::chrono::steady_clock::now() - start;
  show.milliseconds = took.count();
  return show;
}

Result<void> write_show(const solver::Model& model, const Show& show, int bits, const std::filesystem::path& folder,
                        const FillFolder& record) {
  return create_folder_atomically(
      folder,
      [&](const std::filesystem::path& hidden) -> Result<void> {
        for (std::size_t q = 0; q < model.projectors.size(); ++q)
          CS_TRY_VOID(write_picture(hidden / (model.projectors[q].id + ".png"), show.compensated.pictures[q], bits));
        return {};
      },
      record);
}

}  // namespace countershade::tools
