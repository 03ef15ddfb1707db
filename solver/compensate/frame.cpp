// A frame on the CPU: reduce to patches, solve, take the indirect light out of every projector pixel.
#include <algorithm>
#include <atomic>
#include <cmath>

#include "calib/base/check.h"
#include "calib/base/parallel.h"
#include "solver/compensate/compensate.h"
#include "solver/compensate/frame_limits.h"
#include "solver/compensate/frame_plan.h"

namespace countershade::solver {
namespace {

using Eigen::Array4f;

// Fraction of controllable light of stored values, as Array4f (the fourth is 0).
Array4f fraction_at(const ProjectorPlan& plan, const std::uint16_t* value) {
  return {plan.fraction[value[0]], plan.fraction[value[1]], plan.fraction[value[2]], 0.f};
}

Array4f fraction_between(const ProjectorPlan& plan, const Picture& picture, float x, float y) {
  const Taps t = taps(x, y, plan.width, plan.height);
  Array4f sum = Array4f::Zero();
  for (int n = 0; n < 4; ++n)
    sum += t.weight[n] * fraction_at(plan, picture.data().data() + 3 * static_cast<std::size_t>(t.index[n]));
  return sum;
}

// Means of blocks of kLightReduction^2 pixels; the last ones of what there is.
std::vector<Array4f> reduce_picture(const ProjectorPlan& plan, const Picture& picture) {
  const int width = plan.reduced_width(), height = plan.reduced_height();
  std::vector<Array4f> reduced(static_cast<std::size_t>(width) * height, Array4f::Zero());
  if (picture.empty()) return reduced;
  parallel_for(height, [&](int j) {
    const int y0 = j * kLightReduction, y1 = std::min(y0 + kLightReduction, plan.height);
    for (int i = 0; i < width; ++i) {
      const int x0 = i * kLightReduction, x1 = std::min(x0 + kLightReduction, plan.width);
      Array4f sum = Array4f::Zero();
      for (int y = y0; y < y1; ++y)
        for (int x = x0; x < x1; ++x) sum += fraction_at(plan, picture.row(y) + 3 * static_cast<std::size_t>(x));
      reduced[static_cast<std::size_t>(j) * width + i] = sum / static_cast<float>((x1 - x0) * (y1 - y0));
    }
  });
  return reduced;
}

Array4f patch_light(const ProjectorPlan& plan, const std::vector<Array4f>& reduced, int patch) {
  constexpr int kSamples = kReduceSamples * kReduceSamples;
  const int width = plan.reduced_width(), height = plan.reduced_height();
  Array4f sum = Array4f::Zero();
  for (int n = 0; n < kSamples; ++n) {
    const LightSample& sample = plan.samples[static_cast<std::size_t>(patch) * kSamples + n];
    if (sample.gain == std::array<float, 3>{}) continue;
    const Taps t = taps(sample.x, sample.y, width, height);
    Array4f light = Array4f::Zero();
    for (int m = 0; m < 4; ++m) light += t.weight[m] * reduced[t.index[m]];
    sum += Array4f(sample.gain[0], sample.gain[1], sample.gain[2], 0.f) * (plan.black + plan.range * light);
  }
  return sum / kSamples;
}

std::uint16_t quantise(float encoded, int bits, float dither_lsb) {
  const std::uint32_t top = (1u << bits) - 1;
  const float code = std::floor(encoded * static_cast<float>(top) + (.5f + dither_lsb));
  const std::uint32_t n = static_cast<std::uint32_t>(std::clamp(code, 0.f, static_cast<float>(top)));
  return static_cast<std::uint16_t>((n * 65535u + top / 2) / top);
}

// Takes the indirect light out of the pixels of one projector.
class PixelStep {
 public:
  PixelStep(const Model& model, const FramePlan& plan, const std::vector<Chart>& indirect,
            std::span<const Picture> pictures, const CompensateOptions& options, int q)
      : map_(model.projectors[q].map),
        plan_(plan),
        own_(plan.projectors[q]),
        indirect_(indirect),
        pictures_(pictures),
        options_(options),
        q_(q) {}

  // Row y of the picture to show; returns how many pixels are clipped.
  int row(int y, std::uint16_t* out) const {
    static constexpr std::uint16_t kBlack[3] = {0, 0, 0};
    const Picture& picture = pictures_[q_];
    int clipped = 0;
    for (int x = 0; x < own_.width; ++x, out += 3) {
      const std::uint16_t* in = picture.empty() ? kBlack : picture.row(y) + 3 * static_cast<std::size_t>(x);
      std::copy(in, in + 3, out);
      const std::size_t i = static_cast<std::size_t>(y) * own_.width + x;
      if (map_.surface[i] >= 0) clipped += pixel(x, y, i, in, out);
    }
    return clipped;
  }

 private:
  bool pixel(int x, int y, std::size_t i, const std::uint16_t* in, std::uint16_t* out) const {
    const auto surface = static_cast<std::size_t>(map_.surface[i]);
    const Array4f S = indirect_[surface].sample(map_.u[i], map_.v[i]);
    const Array4f a = own_.gain[surface].sample(map_.u[i], map_.v[i]);
    const Array4f own = fraction_at(own_, in);
    const Array4f C = a * own_.range * own + others(x, y, i);
    bool clipped = false;
    for (int c = 0; c < 3; ++c) {
      if (!(S[c] > 0) || !(a[c] > 0)) continue;  // nothing to remove, or nothing known here: as it was
      clipped |= S[c] > C[c];
      const float keep = C[c] > S[c] ? 1 - S[c] / C[c] : 0.f;
      out[c] = quantise(own_.encode(own[c] * keep), options_.bits, options_.dither ? dither(x, y, c) : 0.f);
    }
    return clipped;
  }

  // Controllable light that the other projectors add at this pixel.
  Array4f others(int x, int y, std::size_t i) const {
    Array4f sum = Array4f::Zero();
    for (const Overlap& overlap : own_.overlaps) {
      const int u = x - overlap.x0, v = y - overlap.y0;
      if (u < 0 || v < 0 || u >= overlap.width || v >= overlap.height || pictures_[overlap.other].empty()) continue;
      const std::array<float, 2>& p = overlap.pixel[static_cast<std::size_t>(v) * overlap.width + u];
      if (p[0] == kNowhere) continue;
      const ProjectorPlan& other = plan_.projectors[overlap.other];
      sum += other.gain[map_.surface[i]].sample(map_.u[i], map_.v[i]) * other.range *
             fraction_between(other, pictures_[overlap.other], p[0], p[1]);
    }
    return sum;
  }

  const PixelMap& map_;
  const FramePlan& plan_;
  const ProjectorPlan& own_;
  const std::vector<Chart>& indirect_;
  std::span<const Picture> pictures_;
  const CompensateOptions& options_;
  int q_;
};

// Receivers of every surface as a chart.
std::vector<Chart> receiver_charts(const Model& model, const Radiosity& indirect) {
  std::vector<Chart> charts;
  for (int s = 0; s < model.screen.size(); ++s) {
    Chart chart{model.receivers_u(s), model.receivers_v(s), {}};
    for (int i = 0; i < chart.nu * chart.nv; ++i) {
      const Eigen::RowVector3f S = indirect.row(model.receiver_offset(s) + i);
      chart.cells.emplace_back(S[0], S[1], S[2], 0.f);
    }
    charts.push_back(std::move(chart));
  }
  return charts;
}

void check_options(const CompensateOptions& options) {
  CS_CHECK(options.bits >= 1 && options.bits <= 16, "bits must be 1..16, not " + std::to_string(options.bits));
  CS_CHECK(options.max_gathers >= 1, "max_gathers must be at least 1");
}

}  // namespace

float dither(int x, int y, int channel) {
  const std::uint32_t px = static_cast<std::uint32_t>(x + 47 * channel),
                      py = static_cast<std::uint32_t>(y + 17 * channel);
  // frac(52.9829189 frac(.06711056 x + .00583715 y)), fractions as multiples of 2^-32.
  const std::uint32_t inner = px * 288237660u + py * 25070368u;
  const std::uint64_t part = static_cast<std::uint64_t>(inner) * 4221604526u;  // .9829189
  const std::uint32_t outer = inner * 52u + static_cast<std::uint32_t>(part >> 32);
  return (static_cast<float>(outer >> 8) * 0x1p-24f - .5f) * .996f;  // short of .5, so that whole codes stay
}

Image light_of_picture(const ProjectorResponse& response, const Picture& picture) {
  Image light(picture.width(), picture.height(), picture.channels());
  std::vector<float> table = response.curve.decode_table(65536);
  const float black = static_cast<float>(response.black_level);
  for (float& f : table) f = black + (1 - black) * f;
  parallel_for(picture.height(), [&](int y) {
    const std::size_t n = static_cast<std::size_t>(picture.width()) * picture.channels();
    std::transform(picture.row(y), picture.row(y) + n, light.row(y), [&](std::uint16_t v) { return table[v]; });
  });
  return light;
}

struct Compensator::Parts {
  const Model& model;
  FramePlan plan;
  Gather patches, receivers;
};

Compensator::Compensator(const Model& model)
    : parts_(new Parts{model, make_frame_plan(model), Gather::patches(model), Gather::receivers(model)}) {}
Compensator::~Compensator() = default;
Compensator::Compensator(Compensator&&) noexcept = default;
Compensator& Compensator::operator=(Compensator&&) noexcept = default;

const FramePlan& Compensator::plan() const {
  return parts_->plan;
}

PatchTarget Compensator::patch_target(std::span<const Picture> pictures) const {
  const FramePlan& plan = parts_->plan;
  CS_CHECK(pictures.size() == plan.projectors.size(), "one picture per projector expected");
  PatchTarget result{parts_->model.e, plan.low, plan.high};
  for (std::size_t q = 0; q < pictures.size(); ++q) {
    const ProjectorPlan& p = plan.projectors[q];
    CS_CHECK(pictures[q].empty() || (pictures[q].same_size(p.width, p.height) && pictures[q].channels() == 3),
             "the picture of projector " + parts_->model.projectors[q].id + " must have its size and three channels");
    const std::vector<Array4f> reduced = reduce_picture(p, pictures[q]);
    parallel_for(static_cast<int>(result.target.rows()),
                 [&](int i) { result.target.row(i) += patch_light(p, reduced, i).head<3>().matrix().transpose(); });
  }
  return result;
}

Radiosity Compensator::receiver_indirect(const PatchTarget& target, const CompensateOptions& options,
                                         FrameReport& report) const {
  check_options(options);
  const Parts& parts = *parts_;
  const float white = static_cast<float>(parts.model.white);
  Radiosity nothing = Radiosity::Zero(parts.receivers.rows(), 3);
  report = {};
  if (options.solver == SolverChoice::kCopy || target.target.rows() == 0) return nothing;
  const Radiosity indirect = parts.patches(target.target);
  report.largest_indirect = indirect.maxCoeff() / white;
  report.gathers = 1;
  const bool free = options.solver == SolverChoice::kAuto;
  if (free && report.largest_indirect < kInvisible) return nothing;
  const bool clips = ((target.target - indirect).array() < target.low.array()).any();
  if (options.solver == SolverChoice::kClosedForm || (free && !clips)) {
    report.used = SolverChoice::kClosedForm;
    return parts.receivers(target.target);
  }
  report.used = SolverChoice::kClipped;
  const Clipped clipped = clipped_direct_for(parts.patches, target.target, target.low, target.high,
                                             kClipTolerance * white, options.max_gathers);
  report.gathers = clipped.gathers;
  return parts.receivers(clipped.shown);
}

std::vector<Picture> Compensator::remove(std::span<const Picture> pictures, const Radiosity& indirect,
                                         const CompensateOptions& options, FrameReport& report) const {
  check_options(options);
  const Parts& parts = *parts_;
  const std::vector<Chart> charts = receiver_charts(parts.model, indirect);
  std::vector<Picture> result;
  std::atomic<std::int64_t> clipped = 0, modelled = 0;
  for (std::size_t q = 0; q < pictures.size(); ++q) {
    const ProjectorPlan& p = parts.plan.projectors[q];
    const PixelStep step(parts.model, parts.plan, charts, pictures, options, static_cast<int>(q));
    Picture& out = result.emplace_back(p.width, p.height, 3);
    parallel_for(p.height, [&](int y) { clipped += step.row(y, out.row(y)); });
    const auto& surface = parts.model.projectors[q].map.surface;
    modelled += std::count_if(surface.begin(), surface.end(), [](int s) { return s >= 0; });
  }
  report.clipped_pixels = modelled > 0 ? static_cast<double>(clipped) / static_cast<double>(modelled) : 0;
  return result;
}

Compensated Compensator::frame(std::span<const Picture> pictures, const CompensateOptions& options) const {
  Compensated result;
  const Radiosity indirect = receiver_indirect(patch_target(pictures), options, result.report);
  result.pictures = remove(pictures, indirect, options, result.report);
  return result;
}

Compensated compensate_frame(const Model& model, std::span<const Picture> pictures, const CompensateOptions& options) {
  return Compensator(model).frame(pictures, options);
}

}  // namespace countershade::solver
