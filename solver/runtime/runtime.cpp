#include "solver/runtime/runtime.h"

#include <epoxy/gl.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <numeric>

#include "calib/base/check.h"
#include "solver/compensate/frame_limits.h"
#include "solver/compensate/frame_plan.h"
#include "solver/runtime/matrix.h"
#include "solver/runtime/upload.h"

namespace countershade::solver {
namespace {

constexpr int kCounters = 64, kStateWords = 2 + kCounters;  // of state.glsl, before the changes

int groups(int count, int size) {
  return (count + size - 1) / size;
}

// How many gathers the clipped solution can need: every one shrinks the move by kappa (PHYSICS 4).
int gathers_needed(const Gather& K, const FramePlan& plan, double white, int most) {
  const double kappa = K.kappa();
  if (plan.high.size() == 0 || kappa <= 0) return 1;
  if (kappa >= 1) return most;
  const double first = std::max(kappa * plan.high.maxCoeff() / white, 1e-9);
  const double needed = 2 + std::ceil(std::log(std::max(first / kClipTolerance, 1.)) / -std::log(kappa));
  return static_cast<int>(std::min<double>(needed, most));
}

struct Programs {
  Program reduce, patch_target, gather, pixel;
};

Result<Programs> make_programs(Precision precision) {
  const auto program = [](const char* name, std::vector<std::string> defines) -> Result<Program> {
    defines.push_back("MAX_PROJECTORS " + std::to_string(kMostProjectors));
    defines.push_back("MAX_SURFACES " + std::to_string(kMostSurfaces));
    CS_TRY(const ShaderText text, shader_text(name, defines));
    return Program::make(text);
  };
  Programs programs;
  CS_TRY(programs.reduce, program("reduce.comp", {"REDUCTION " + std::to_string(kLightReduction)}));
  CS_TRY(programs.patch_target, program("patch_target.comp", {}));
  std::vector<std::string> half;
  if (precision == Precision::kHalf) half.emplace_back("HALF");
  CS_TRY(programs.gather, program("gather.comp", half));
  CS_TRY(programs.pixel, program("pixel.comp", {}));
  return programs;
}

class GlRuntime final : public Runtime {
 public:
  static Result<std::unique_ptr<Runtime>> make(const Model& model, const CompensateOptions& options,
                                               Precision precision);
  Result<void> render(std::span<const Picture> pictures) override;
  void choose(SolverChoice solver) override { options_.solver = solver; }
  unsigned output_texture(int q) const override { return upload_.projectors[q].shown.id(); }
  Result<Compensated> read() override;
  Result<Radiosity> read_receiver_indirect() override;
  Result<Radiosity> solve_patches(int H, int passes) override;

 private:
  Result<void> make_work_buffers();
  void solve();
  void show_pixels();
  float invisible() const;
  bool copied(const std::vector<unsigned>& state) const;
  FrameReport report(const std::vector<unsigned>& state) const;
  std::vector<unsigned> read_state() const {
    return state_.read_words(kStateWords + static_cast<std::size_t>(gathers_));
  }

  CompensateOptions options_;
  double white_ = 1;
  int patches_ = 0, receivers_ = 0, gathers_ = 1;
  std::int64_t modelled_ = 0;
  std::vector<std::array<int, 2>> sizes_;
  std::vector<std::string> ids_;
  Programs programs_;
  Upload upload_;
  GlMatrix F_, G_;
  Buffer target_, work_[2], indirect_, state_;
  BufferTexture indirect_texture_;
};

Result<std::unique_ptr<Runtime>> GlRuntime::make(const Model& model, const CompensateOptions& options,
                                                 Precision precision) {
  CS_CHECK(options.bits >= 1 && options.bits <= 16, "bits must be 1..16, not " + std::to_string(options.bits));
  CS_CHECK(options.max_gathers >= 1, "max_gathers must be at least 1");
  CS_TRY_VOID(check_gl_version());
  auto runtime = std::make_unique<GlRuntime>();
  const FramePlan plan = make_frame_plan(model);
  runtime->options_ = options;
  runtime->white_ = model.white;
  runtime->patches_ = model.patches.size();
  runtime->receivers_ = model.receivers();
  runtime->gathers_ = gathers_needed(Gather::patches(model), plan, model.white, options.max_gathers);
  for (const ProjectorModel& projector : model.projectors) {
    const auto& surface = projector.map.surface;
    runtime->modelled_ += std::count_if(surface.begin(), surface.end(), [](int s) { return s >= 0; });
    runtime->sizes_.push_back({projector.map.width, projector.map.height});
    runtime->ids_.push_back(projector.id);
  }
  CS_TRY(runtime->programs_, make_programs(precision));
  CS_TRY(runtime->upload_, Upload::make(model, plan));
  const int per_patch = model.receiver_factor * model.receiver_factor;
  CS_TRY(runtime->F_, GlMatrix::make("the form factors of the patches", model.F, model.k,
                                     row_bands(model.F, model.patches, 1), precision, largest_storage_block()));
  CS_TRY(runtime->G_, GlMatrix::make("the form factors of the receivers", model.G, receiver_gain(model),
                                     row_bands(model.G, model.patches, per_patch), precision, largest_storage_block()));
  CS_TRY_VOID(runtime->make_work_buffers());
  return std::unique_ptr<Runtime>(std::move(runtime));
}

Result<void> GlRuntime::make_work_buffers() {
  const std::size_t bytes = 16 * static_cast<std::size_t>(patches_);
  const std::vector<float> zeros(4 * static_cast<std::size_t>(std::max(patches_, receivers_)), 0.f);
  CS_TRY(target_, Buffer::make("the target", bytes, zeros.data()));
  CS_TRY(work_[0], Buffer::make("the solution", bytes, zeros.data()));
  CS_TRY(work_[1], Buffer::make("the solution", bytes, zeros.data()));
  CS_TRY(indirect_, Buffer::make("the receivers", 16 * static_cast<std::size_t>(receivers_), zeros.data()));
  CS_TRY(indirect_texture_, BufferTexture::make("the receivers", indirect_, static_cast<std::size_t>(receivers_)));
  CS_TRY(state_, Buffer::make("the state", 4 * (kStateWords + static_cast<std::size_t>(gathers_)), nullptr));
  state_.clear();
  return {};
}

Result<void> GlRuntime::render(std::span<const Picture> pictures) {
  CS_CHECK(pictures.size() == sizes_.size(), "one picture per projector expected");
  for (std::size_t q = 0; q < pictures.size(); ++q)
    if (!pictures[q].empty() && (!pictures[q].same_size(sizes_[q][0], sizes_[q][1]) || pictures[q].channels() != 3))
      return error(ErrorCode::kBadValue,
                   "the picture of projector {} is {} x {} x {} and must be {} x {} x 3: scale it", ids_[q],
                   pictures[q].width(), pictures[q].height(), pictures[q].channels(), sizes_[q][0], sizes_[q][1]);
  upload_.send(pictures);
  state_.clear();
  upload_.block.bind_uniform(0);
  upload_.pictures.bind_storage(0);
  upload_.tables.bind_storage(1);
  upload_.reduced.bind_storage(2);
  for (int q = 0; q < static_cast<int>(sizes_.size()); ++q) {
    programs_.reduce.set(0, q);
    programs_.reduce.dispatch(groups(groups(sizes_[q][0], kLightReduction), 8),
                              groups(groups(sizes_[q][1], kLightReduction), 8));
  }
  storage_barrier();
  upload_.samples.bind_storage(0);
  upload_.reduced.bind_storage(1);
  upload_.ambient.bind_storage(2);
  target_.bind_storage(3);
  programs_.patch_target.dispatch(patches_);
  storage_barrier();
  if (options_.solver != SolverChoice::kCopy) solve();
  show_pixels();
  return {};
}

// Indirect light below this is left alone; 0 = never, 1 with an empty state = always.
float GlRuntime::invisible() const {
  if (options_.solver == SolverChoice::kCopy) return 1;
  return options_.solver == SolverChoice::kAuto ? kInvisible * static_cast<float>(white_) : 0.f;
}

// The first step also measures the indirect light and whether anything clips; where nothing does, it is the closed
// form, and the steps behind it find themselves done. So the graphics card decides as the CPU does, and nothing is read
// back.
void GlRuntime::solve() {
  upload_.low.bind_storage(4);
  upload_.high.bind_storage(5);
  state_.bind_storage(7);
  const bool closed_form = options_.solver == SolverChoice::kClosedForm;
  const int count = closed_form ? 1 : gathers_;
  const Buffer* shown = &target_;
  for (int n = 0; n < count; ++n) {
    const Buffer* next = &work_[n % 2];
    F_.run(programs_.gather,
           {GatherMode::kClip, shown, next, &target_, n, kClipTolerance * static_cast<float>(white_), invisible()});
    shown = next;
  }
  G_.run(programs_.gather, {GatherMode::kStore, closed_form ? &target_ : shown, &indirect_});
}

void GlRuntime::show_pixels() {
  upload_.pictures.bind_storage(0);
  upload_.tables.bind_storage(1);
  upload_.chart_texture.bind_texture(0);
  indirect_texture_.bind_texture(1);
  state_.bind_storage(7);
  for (int q = 0; q < static_cast<int>(sizes_.size()); ++q) {
    const ProjectorUpload& p = upload_.projectors[q];
    p.map.bind_storage(4);
    p.overlap_map.bind_storage(5);
    p.overlaps.bind_uniform(1);
    p.shown.bind_image(0);
    programs_.pixel.set(0, q);
    programs_.pixel.set(1, options_.bits);
    programs_.pixel.set(2, options_.dither ? 1 : 0);
    programs_.pixel.set(3, invisible());
    programs_.pixel.dispatch(groups(sizes_[q][0], 8), groups(sizes_[q][1], 8));
  }
  glMemoryBarrier(GL_TEXTURE_FETCH_BARRIER_BIT | GL_TEXTURE_UPDATE_BARRIER_BIT | GL_FRAMEBUFFER_BARRIER_BIT |
                  GL_BUFFER_UPDATE_BARRIER_BIT | GL_SHADER_STORAGE_BARRIER_BIT);
}

bool GlRuntime::copied(const std::vector<unsigned>& state) const {
  return std::bit_cast<float>(state[0]) < invisible();
}

FrameReport GlRuntime::report(const std::vector<unsigned>& state) const {
  FrameReport report;
  if (options_.solver == SolverChoice::kCopy) return report;
  report.largest_indirect = std::bit_cast<float>(state[0]) / white_;
  report.gathers = 1;
  const double clipped = std::accumulate(state.begin() + 2, state.begin() + 2 + kCounters, 0.);
  report.clipped_pixels = modelled_ > 0 ? clipped / static_cast<double>(modelled_) : 0;
  if (copied(state)) return report;
  const bool clips = state[1] != 0 || options_.solver == SolverChoice::kClipped;
  report.used =
      clips && options_.solver != SolverChoice::kClosedForm ? SolverChoice::kClipped : SolverChoice::kClosedForm;
  if (report.used == SolverChoice::kClosedForm) return report;
  const float tolerance = kClipTolerance * static_cast<float>(white_);
  while (report.gathers < gathers_ && std::bit_cast<float>(state[kStateWords + report.gathers - 1]) > tolerance)
    ++report.gathers;
  return report;
}

Result<Compensated> GlRuntime::read() {
  Compensated result;
  for (std::size_t q = 0; q < sizes_.size(); ++q) {
    Picture& picture = result.pictures.emplace_back(sizes_[q][0], sizes_[q][1], 3);
    glBindTexture(GL_TEXTURE_2D, upload_.projectors[q].shown.id());
    glPixelStorei(GL_PACK_ALIGNMENT, 1);
    glGetTexImage(GL_TEXTURE_2D, 0, GL_RGB, GL_UNSIGNED_SHORT, picture.data().data());
  }
  result.report = report(read_state());
  if (const unsigned code = glGetError(); code != GL_NO_ERROR)
    return error(ErrorCode::kDevice, "GL error {:#x} while reading a frame back: restart the GL context or use the CPU",
                 code);
  return result;
}

Result<Radiosity> GlRuntime::read_receiver_indirect() {
  if (copied(read_state())) return Radiosity(Radiosity::Zero(receivers_, 3));
  return from_vec4(indirect_.read_floats(4 * static_cast<std::size_t>(receivers_)));
}

Result<Radiosity> GlRuntime::solve_patches(int H, int passes) {
  CS_CHECK(H >= 0, "H must not be negative");
  upload_.low.bind_storage(4);  // not read in these modes, but declared
  upload_.high.bind_storage(5);
  state_.bind_storage(7);
  const std::size_t floats = 4 * static_cast<std::size_t>(patches_);
  if (H == 0) {
    F_.run(programs_.gather, {GatherMode::kSubtract, &target_, &work_[0], &target_});
    return from_vec4(work_[0].read_floats(floats));
  }
  CS_TRY(Buffer direct, Buffer::make("the direct light", 4 * floats, nullptr));
  CS_TRY(Buffer next, Buffer::make("the direct light", 4 * floats, nullptr));
  const Buffer* D = &target_;
  for (int pass = 0; pass < passes; ++pass) {
    const Buffer* sum = D;  // D + K D + .. + K^(H-1) D, by Horner
    for (int level = 1; level < H; ++level) {
      const Buffer* out = &work_[level % 2];
      F_.run(programs_.gather, {GatherMode::kAdd, sum, out, D});
      sum = out;
    }
    F_.run(programs_.gather, {GatherMode::kSubtract, sum, &next, &target_});
    std::swap(direct, next);
    D = &direct;
  }
  return from_vec4(D->read_floats(floats));
}

}  // namespace

Result<std::unique_ptr<Runtime>> Runtime::make(const Model& model, const CompensateOptions& options,
                                               Precision precision) {
  return GlRuntime::make(model, options, precision);
}

}  // namespace countershade::solver
