#include "capture/pattern/decode.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "calib/base/parallel.h"
#include "capture/pattern/pattern.h"
#include "capture/pattern/refine.h"

namespace countershade::capture {

namespace {

constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();

// Frame indices of one Gray code; -1 = not there.
struct BitFrames {
  int plain = -1, inverse = -1;
};
struct AxisCode {
  std::vector<BitFrames> bits;  // by bit, least significant first
  int cell_px = 1, length = 0;  // length: pixels along the axis
  bool exists() const { return !bits.empty(); }
};

struct Plan {
  int white = -1, black = -1;
  AxisCode axis[2];  // x, y
};

Result<Plan> plan_for(const Sequence& sequence, const std::string& projector) {
  Plan plan;
  for (const auto& [id, resolution] : sequence.projectors)
    if (id == projector) plan.axis[0].length = resolution[0], plan.axis[1].length = resolution[1];
  const bool alone = sequence.projectors.size() == 1;
  for (const Frame& frame : sequence.frames) {
    const Role& role = frame.role;
    if (role.projector != projector && !(alone && role.projector.empty())) continue;
    if (role.kind == "white" && plan.white < 0) plan.white = frame.index;
    if (role.kind == "black" && plan.black < 0) plan.black = frame.index;
    if (role.kind != "gray") continue;
    AxisCode& code = plan.axis[role.axis == "x" ? 0 : 1];
    code.cell_px = role.cell_px;
    code.bits.resize(std::max<std::size_t>(code.bits.size(), role.bit + 1));
    (role.inverse ? code.bits[role.bit].inverse : code.bits[role.bit].plain) = frame.index;
  }
  for (int a = 0; a < 2; ++a)
    for (std::size_t b = 0; b < plan.axis[a].bits.size(); ++b)
      if (plan.axis[a].bits[b].plain < 0 || plan.axis[a].bits[b].inverse < 0)
        return error(ErrorCode::kRefused, "projector '{}': Gray code bit {} of axis {} lacks its {} frame; this decoder needs every bit with its inverse", projector, b, a ? "y" : "x",
                     plan.axis[a].bits[b].plain < 0 ? "plain" : "inverse");
  if (!plan.axis[0].exists() && !plan.axis[1].exists())
    return error(ErrorCode::kRefused, "the sequence has no Gray code for projector '{}'; its frames' roles must be {{\"kind\":\"gray\"}} with projector '{}'", projector, projector);
  return plan;
}

// What is known of each camera pixel while the photos stream by.
struct Pixels {
  int width = 0, height = 0;
  Image white, black;        // mean of channels
  Mask saturated;
  std::vector<float> fine;   // strongest modulation among the finest bits
  std::vector<std::uint32_t> code, uncertain;  // of the axis at hand: bits, and those in doubt
};

Image mean_of(const Photo& photo) { return luminance_mean(photo.value); }

Result<void> load_levels(const Plan& plan, const PhotoSource& photos, Pixels& pixels, NoiseModel& noise) {
  std::vector<std::pair<int, int>> pairs;
  if (plan.white >= 0 && plan.black >= 0) pairs.emplace_back(plan.white, plan.black);
  else
    for (const AxisCode& code : plan.axis)
      for (std::size_t b = 0; b < code.bits.size(); b += std::max<std::size_t>(1, code.bits.size() - 1)) pairs.emplace_back(code.bits[b].plain, code.bits[b].inverse);
  for (const auto& [first, second] : pairs) {
    CS_TRY(Photo a, photos(first));
    CS_TRY(const Photo b, photos(second));
    const Image mean_a = mean_of(a), mean_b = mean_of(b);
    if (!mean_b.same_size(mean_a.width(), mean_a.height()))
      return error(ErrorCode::kBadFile, "photos {:04} and {:04} differ in size ({} x {} and {} x {}); all photos of a camera have one size", first, second, mean_a.width(), mean_a.height(), mean_b.width(), mean_b.height());
    if (pixels.white.empty()) {
      pixels.width = mean_a.width(), pixels.height = mean_a.height();
      pixels.white = Image(pixels.width, pixels.height, 1, 0.0f);
      pixels.black = Image(pixels.width, pixels.height, 1, std::numeric_limits<float>::max());
      pixels.saturated = Mask(pixels.width, pixels.height, 1);
      a.value = mean_a;
      noise = estimate_noise(std::span(&a, 1));
    }
    for (std::size_t i = 0; i < pixels.white.data().size(); ++i) {
      pixels.white.data()[i] = std::max({pixels.white.data()[i], mean_a.data()[i], mean_b.data()[i]});
      pixels.black.data()[i] = std::min({pixels.black.data()[i], mean_a.data()[i], mean_b.data()[i]});
      if (!a.valid.data()[i] || !b.valid.data()[i]) pixels.saturated.data()[i] = 1;
    }
  }
  return {};
}

double percentile99(const Pixels& pixels) {
  std::vector<float> difference(pixels.white.data().size());
  for (std::size_t i = 0; i < difference.size(); ++i) difference[i] = pixels.white.data()[i] - pixels.black.data()[i];
  const auto nth = difference.begin() + static_cast<std::ptrdiff_t>(0.99 * (difference.size() - 1));
  std::nth_element(difference.begin(), nth, difference.end());
  return *nth;
}

Result<void> read_bits(const AxisCode& code, const PhotoSource& photos, const NoiseModel& noise, const DecodeOptions& options, const std::function<void()>& tick, Pixels& pixels) {
  pixels.code.assign(pixels.white.data().size(), 0);
  pixels.uncertain.assign(pixels.white.data().size(), 0);
  for (std::size_t bit = 0; bit < code.bits.size(); ++bit) {
    CS_TRY(const Photo plain, photos(code.bits[bit].plain));
    CS_TRY(const Photo inverse, photos(code.bits[bit].inverse));
    if (!plain.value.same_size(pixels.width, pixels.height) || !inverse.value.same_size(pixels.width, pixels.height))
      return error(ErrorCode::kBadFile, "photo {:04} or {:04} is not {} x {} pixels as the others are", code.bits[bit].plain, code.bits[bit].inverse, pixels.width, pixels.height);
    const int channels = plain.value.channels();
    parallel_for(pixels.height, [&](int y) {
      for (int x = 0; x < pixels.width; ++x) {
        const std::size_t i = static_cast<std::size_t>(y) * pixels.width + x;
        float a = 0, b = 0;
        for (int c = 0; c < channels; ++c) a += plain.value.at(x, y, c), b += inverse.value.at(x, y, c);
        a /= channels, b /= channels;
        const float difference = a - b, range = std::max(1e-9f, pixels.white.data()[i] - pixels.black.data()[i]);
        if (difference > 0) pixels.code[i] |= 1u << bit;
        const double sigma = std::hypot(noise.sigma(a), noise.sigma(b));
        if (std::abs(difference) < std::max(options.min_snr * sigma, options.min_modulation * range)) pixels.uncertain[i] |= 1u << bit;
        if (bit < 4) pixels.fine[i] = std::max(pixels.fine[i], std::abs(difference) / range);
      }
    });
    tick();
  }
  return {};
}

// A decoded coordinate [px] and its sigma, or nothing where too many bits are in doubt.
struct Reading {
  float q = kNaN, sigma = 0;
};

std::optional<Reading> reading_of(std::uint32_t code, std::uint32_t uncertain, const AxisCode& axis) {
  const auto centre = [&](unsigned cell) { return cell * axis.cell_px + 0.5f * (axis.cell_px - 1); };
  const float cell_sigma = axis.cell_px * 0.2887f;  // uniform over a cell
  if (!uncertain) return Reading{centre(binary_from_gray(code)), cell_sigma};
  // All readings that the doubtful bits allow; they must be neighbouring cells.
  unsigned low = binary_from_gray(code), high = low;
  for (std::uint32_t subset = uncertain;; subset = (subset - 1) & uncertain) {
    const unsigned cell = binary_from_gray((code & ~uncertain) | subset);
    low = std::min(low, cell), high = std::max(high, cell);
    if (!subset || high - low > 3) break;
  }
  const unsigned span = high - low;
  if (span > 3) return std::nullopt;
  return Reading{0.5f * (centre(low) + centre(high)), span <= 1 ? cell_sigma : axis.cell_px * 0.29f * static_cast<float>(span + 1)};
}

int count_bits(std::uint32_t v) { return __builtin_popcount(v); }

void read_axis(const Pixels& pixels, const AxisCode& axis, Image& q, Image& sigma, Mask& reason) {
  parallel_for(pixels.height, [&](int y) {
    for (int x = 0; x < pixels.width; ++x) {
      const std::size_t i = static_cast<std::size_t>(y) * pixels.width + x;
      if (reason.data()[i] != static_cast<std::uint8_t>(Reason::kAccepted)) continue;
      // More than a few doubtful bits cannot be neighbouring cells; do not enumerate them.
      const auto reading = count_bits(pixels.uncertain[i]) <= 4 ? reading_of(pixels.code[i], pixels.uncertain[i], axis) : std::nullopt;
      if (!reading) reason.data()[i] = static_cast<std::uint8_t>(Reason::kUncertainBit);
      else if (reading->q > axis.length - 0.5f) reason.data()[i] = static_cast<std::uint8_t>(Reason::kInconsistent);
      else q.data()[i] = reading->q, sigma.data()[i] = std::max(sigma.data()[i], reading->sigma);
    }
  });
}

void mark(const Pixels& pixels, double dark, const NoiseModel& noise, const DecodeOptions& options, Mask& reason) {
  for (std::size_t i = 0; i < reason.data().size(); ++i) {
    const float white = pixels.white.data()[i], black = pixels.black.data()[i];
    Reason why = Reason::kAccepted;
    if (white - black < dark || white - black < options.min_snr * std::hypot(noise.sigma(white), noise.sigma(black))) why = Reason::kDark;
    else if (pixels.saturated.data()[i]) why = Reason::kSaturated;
    reason.data()[i] = static_cast<std::uint8_t>(why);
  }
}

void finish(const Pixels& pixels, const DecodeOptions& options, Correspondence& c) {
  for (std::size_t i = 0; i < c.reason.data().size(); ++i) {
    auto why = static_cast<Reason>(c.reason.data()[i]);
    if (why != Reason::kDark && why != Reason::kSaturated && pixels.fine[i] < options.fine_modulation) why = Reason::kIndirect;
    c.reason.data()[i] = static_cast<std::uint8_t>(why);
    if (why != Reason::kDark && why != Reason::kIndirect) ++c.lit;
    if (why == Reason::kAccepted) ++c.accepted;
    else c.x.data()[i] = c.y.data()[i] = c.sigma.data()[i] = kNaN;
  }
}

Error nothing_lit(const std::string& projector, const Pixels& pixels, bool saturated) {
  const float white = *std::max_element(pixels.white.data().begin(), pixels.white.data().end());
  const float black = *std::min_element(pixels.black.data().begin(), pixels.black.data().end());
  return error(ErrorCode::kRefused, "projector '{}': no camera pixel can be decoded: {} (brightest white {:.1f} %, darkest black {:.1f} % of full scale). {}", projector,
               saturated ? "every lit pixel is saturated" : "none is lit by it", 100 * white, 100 * black,
               saturated ? "Shorten exposures_ms" : "Is the projector on, the lens cap off, the exposure long enough, and does the camera see its picture?");
}

}  // namespace

Result<Correspondence> decode_frames(const Sequence& sequence, const PhotoSource& photos, const std::string& camera, const std::string& projector, const DecodeOptions& options,
                                     Progress& progress) {
  CS_TRY(const Plan plan, plan_for(sequence, projector));
  Pixels pixels;
  NoiseModel noise;
  const std::string stage = "decode " + projector;
  const double total = 1.0 + plan.axis[0].bits.size() + plan.axis[1].bits.size();
  double done = 0;
  progress.step(stage, 0, total);
  CS_TRY_VOID(load_levels(plan, photos, pixels, noise));
  progress.step(stage, ++done, total);
  Correspondence c;
  c.camera = camera, c.projector = projector;
  c.projector_resolution = {plan.axis[0].length, plan.axis[1].length};
  c.x = c.y = Image(pixels.width, pixels.height, 1, kNaN);
  c.sigma = Image(pixels.width, pixels.height, 1, 0.0f);
  c.reason = Mask(pixels.width, pixels.height, 1);
  mark(pixels, options.dark_fraction * percentile99(pixels), noise, options, c.reason);
  pixels.fine.assign(pixels.white.data().size(), 0.0f);
  for (int a = 0; a < 2; ++a) {
    if (!plan.axis[a].exists()) continue;
    CS_TRY_VOID(read_bits(plan.axis[a], photos, noise, options, [&] { progress.step(stage, ++done, total); }, pixels));
    read_axis(pixels, plan.axis[a], a ? c.y : c.x, c.sigma, c.reason);
  }
  refine_by_neighbours(plan.axis[0].exists(), plan.axis[1].exists(), std::max(plan.axis[0].cell_px, plan.axis[1].cell_px), c);
  finish(pixels, options, c);
  if (c.accepted == 0) {
    const bool saturated = std::count(c.reason.data().begin(), c.reason.data().end(), static_cast<std::uint8_t>(Reason::kSaturated)) > static_cast<std::ptrdiff_t>(c.reason.data().size() / 100);
    return nothing_lit(projector, pixels, saturated);
  }
  return c;
}

Result<Correspondence> decode(const Session& session, const std::string& camera, const std::string& projector, const DecodeOptions& options, Progress& progress) {
  return decode_frames(session.sequence(), [&](int index) { return session.photo(camera, index); }, camera, projector, options, progress);
}

}  // namespace countershade::capture
