#include "capture/pattern/decode.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <optional>

#include "calib/base/parallel.h"
#include "capture/pattern/levels.h"
#include "capture/pattern/pattern.h"
#include "capture/pattern/phase.h"
#include "capture/pattern/plan.h"
#include "capture/pattern/refine.h"

namespace countershade::capture {

namespace {

constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();
constexpr int kFineBits = 4;  // their stripes are too narrow to modulate light that comes by way of other surfaces

double percentile99_of_contrast(const Levels& levels) {
  std::vector<float> contrast;
  contrast.reserve(levels.white.pixels());
  for (std::size_t i = 0; i < levels.white.pixels(); ++i) {
    const float difference = levels.white.data()[i] - levels.black.data()[i];
    if (std::isfinite(difference)) contrast.push_back(difference);
  }
  if (contrast.empty()) return 0;
  const auto nth = contrast.begin() + static_cast<std::ptrdiff_t>(0.99 * (contrast.size() - 1));
  std::nth_element(contrast.begin(), nth, contrast.end());
  return *nth;
}

// Pixels that no code is read from: dark or saturated.
Mask judge_levels(const Levels& levels, const DecodeOptions& options) {
  const double dark = options.dark_fraction * percentile99_of_contrast(levels);
  Mask reason(levels.white.width(), levels.white.height(), 1);
  for (std::size_t i = 0; i < reason.data().size(); ++i) {
    const float white = levels.white.data()[i], black = levels.black.data()[i];
    const double least = options.min_snr * std::hypot(levels.noise.sigma(white), levels.noise.sigma(black));
    Reason why = Reason::kAccepted;
    if (!(white - black > std::max(dark, least)))  // NaN is dark
      why = Reason::kDark;
    else if (levels.saturated.data()[i])
      why = Reason::kSaturated;
    reason.data()[i] = static_cast<std::uint8_t>(why);
  }
  return reason;
}

// The bits of one axis. fine: strongest modulation so far by the finest stripes, the direct share of the light.
struct BitReader {
  const Levels& levels;
  const DecodeOptions& options;
  const Mask& skip;
  std::vector<float>& fine;

  // One row of one bit; `is_fine`: its stripes are too narrow to modulate indirect light. A direct share d makes +-d of
  // the difference, light by way of other surfaces up to +-(1 - d): a coarse bit is certain only beyond what the latter
  // can do against the former, 1 - 2 d (Xu & Aliaga 2007, robust pixel classification; their bounds for on and off,
  // written for the difference). As the strongest of several modulations, `fine` is a few percent more than d.
  void row(int y, int bit, bool is_fine, const Image& plain, const Image& inverse, AxisReading& reading) const {
    const std::size_t start = static_cast<std::size_t>(y) * plain.width();
    for (int x = 0; x < plain.width(); ++x) {
      const std::size_t i = start + x;
      if (skip.data()[i]) continue;
      const float a = plain.data()[i], b = inverse.data()[i], difference = a - b;
      const float range = levels.white.data()[i] - levels.black.data()[i], size = std::abs(difference);
      const NoiseModel& noise = levels.noise;
      const double sigma = std::sqrt(2 * noise.read * noise.read + noise.photon * std::max(0.0f, a + b));
      double least = std::max(options.min_snr * sigma, options.min_modulation * range);
      if (is_fine)
        fine[i] = std::max(fine[i], size / range);
      else
        least = std::max(least, (1.0 - 1.8 * fine[i]) * range + options.min_snr * sigma);
      if (difference > 0) reading.code[i] |= 1u << bit;
      if (!(size > least)) reading.uncertain[i] |= 1u << bit;
    }
  }
};

// Means of channels of a bit's two photos, read at the same time.
Result<std::array<Image, 2>> read_pair(const BitFrames& frames, const PhotoSource& photos, const Mask& shape) {
  std::array<Image, 2> light;
  std::array<std::optional<Error>, 2> failed;
  parallel_for(2, [&](int k) {
    const int index = k ? frames.inverse : frames.plain;
    const Result<Photo> photo = photos(index);
    if (!photo) {
      failed[k] = photo.error();
      return;
    }
    light[k] = luminance_mean(photo->value);
    if (!light[k].same_size(shape.width(), shape.height()))
      failed[k] = error(ErrorCode::kBadFile, "photo {:04} is {} x {} pixels, the others are {} x {}", index,
                        light[k].width(), light[k].height(), shape.width(), shape.height());
  });
  for (const std::optional<Error>& error : failed)
    if (error) return *error;
  return light;
}

// Bits that were shown in exclusive or with another become those of the Gray code; where that one is in doubt, so are
// they.
void take_off_base(const AxisCode& code, AxisReading& reading) {
  std::uint32_t combined = 0;
  for (std::size_t b = 0; b < code.bits.size(); ++b)
    if (code.bits[b].base >= 0) combined |= 1u << b, reading.base = code.bits[b].base;
  if (!combined) return;
  for (std::size_t i = 0; i < reading.code.size(); ++i) {
    if ((reading.code[i] >> reading.base) & 1) reading.code[i] ^= combined;
    if ((reading.uncertain[i] >> reading.base) & 1) reading.uncertain[i] |= combined;
  }
}

Result<void> read_bits(const AxisCode& code, const PhotoSource& photos, const BitReader& reader,
                       const std::function<void()>& tick, AxisReading& reading) {
  for (std::size_t b = 0; b < code.bits.size(); ++b) {
    CS_TRY(const auto light, read_pair(code.bits[b], photos, reader.skip));
    const int bit = static_cast<int>(b);
    const bool is_fine = bit < kFineBits || code.bits[b].base >= 0;
    parallel_for(reader.skip.height(), [&](int y) { reader.row(y, bit, is_fine, light[0], light[1], reading); });
    tick();
  }
  take_off_base(code, reading);
  return {};
}

// The coordinate that bits say [px]: a cell's middle, or the border of two where the one bit in doubt decides between
// them (Gray code changes one bit from cell to cell). Nothing where doubt leaves more open.
std::optional<float> coordinate(std::uint32_t code, std::uint32_t uncertain, int cell_px) {
  const auto middle = [&](unsigned cell) {
    return static_cast<float>(cell) * cell_px + 0.5f * static_cast<float>(cell_px - 1);
  };
  const unsigned cell = binary_from_gray(code);
  if (!uncertain) return middle(cell);
  if (std::popcount(uncertain) > 1) return std::nullopt;
  const unsigned other = binary_from_gray(code ^ uncertain);
  if (std::max(cell, other) - std::min(cell, other) > 1) return std::nullopt;
  return 0.5f * (middle(cell) + middle(other));
}

void read_coordinates(AxisReading& reading) {
  parallel_for(reading.q.height(), [&](int y) {
    for (int x = 0; x < reading.q.width(); ++x) {
      const std::size_t i = static_cast<std::size_t>(y) * reading.q.width() + x;
      if (reading.reason.data()[i]) continue;
      const auto q = coordinate(reading.code[i], reading.uncertain[i], reading.cell_px);
      Reason why = Reason::kAccepted;
      if (!q)
        why = Reason::kUncertainBit;
      else if (*q > static_cast<float>(reading.length_px) - 0.5f)
        why = Reason::kInconsistent;
      else
        reading.q.data()[i] = *q;
      reading.reason.data()[i] = static_cast<std::uint8_t>(why);
    }
  });
}

AxisReading new_reading(const AxisCode& code, const Levels& levels, const Mask& skip) {
  AxisReading reading;
  reading.cell_px = code.cell_px, reading.length_px = code.length_px;
  reading.bits = static_cast<int>(code.bits.size());
  reading.q = reading.sigma = Image(skip.width(), skip.height(), 1, kNaN);
  reading.contrast = levels.white;
  for (std::size_t i = 0; i < skip.data().size(); ++i) reading.contrast.data()[i] -= levels.black.data()[i];
  reading.code.assign(skip.data().size(), 0);
  reading.uncertain.assign(skip.data().size(), 0);
  return reading;
}

// Joins the axes: a pixel is accepted when every axis with a code is.
void join(const Mask& judged, const AxisReading* axes[2], Correspondence& c) {
  c.reason = judged;
  for (std::size_t i = 0; i < c.reason.data().size(); ++i) {
    std::uint8_t& reason = c.reason.data()[i];
    for (int a = 0; a < 2; ++a)
      if (axes[a] && !reason) reason = axes[a]->reason.data()[i];
    const auto why = static_cast<Reason>(reason);
    if (why != Reason::kDark && why != Reason::kIndirect) ++c.lit;
    if (why != Reason::kAccepted) continue;
    ++c.accepted;
    float sigma = 0;
    for (int a = 0; a < 2; ++a) {
      if (!axes[a]) continue;
      (a ? c.y : c.x).data()[i] = axes[a]->q.data()[i];
      sigma = std::max(sigma, axes[a]->sigma.data()[i]);
    }
    c.sigma.data()[i] = sigma;
  }
}

Error nothing_decoded(const Correspondence& c, const Levels& levels) {
  const auto saturated =
      std::count(c.reason.data().begin(), c.reason.data().end(), static_cast<std::uint8_t>(Reason::kSaturated));
  const bool too_bright = saturated > static_cast<std::ptrdiff_t>(c.reason.data().size() / 100);
  const float white = *std::max_element(levels.white.data().begin(), levels.white.data().end());
  const float black = *std::min_element(levels.black.data().begin(), levels.black.data().end());
  return error(ErrorCode::kRefused,
               "projector '{}': no camera pixel can be decoded: {} (brightest white {:.1f} %, darkest black {:.1f} % "
               "of full scale). {}",
               c.projector,
               too_bright                        ? "every lit pixel is saturated"
               : c.lit < c.reason.pixels() / 100 ? "none is lit by it"
                                                 : "its code is not visible where it lights the scene",
               100 * white, 100 * black,
               too_bright ? "Shorten exposures_ms"
                          : "Is the projector on and in focus, the lens cap off, the exposure long enough, does the "
                            "camera see its picture, and is each photo of the frame that sequence.json says?");
}

}  // namespace

namespace {

// Everything decode_frames knows while it reads.
struct Decoder {
  const CodePlan& plan;
  const PhotoSource& photos;
  const DecodeOptions& options;
  std::function<void()> tick;
  Levels levels;  // of the bits; of the sinusoids, where there are no bits
  Mask judged;    // Reason of pixels that no code is read from
  AxisReading readings[2];
  std::optional<PhaseReading> waves[2];

  Result<void> read_all_bits();
  Result<void> read_waves(int axis);
  void settle_waves();
};

Result<void> Decoder::read_all_bits() {
  CS_TRY(levels, measure_levels(plan, photos));
  tick();
  judged = judge_levels(levels, options);
  std::vector<float> fine(judged.data().size(), 0.0f);
  const BitReader reader{levels, options, judged, fine};
  for (int a = 0; a < 2; ++a) {
    if (plan.axis[a].bits.empty()) continue;
    readings[a] = new_reading(plan.axis[a], levels, judged);
    CS_TRY_VOID(read_bits(plan.axis[a], photos, reader, tick, readings[a]));
  }
  for (std::size_t i = 0; i < fine.size(); ++i)
    if (!judged.data()[i] && fine[i] < options.fine_modulation)
      judged.data()[i] = static_cast<std::uint8_t>(Reason::kIndirect);
  for (int a = 0; a < 2; ++a) {
    if (plan.axis[a].bits.empty()) continue;
    readings[a].reason = judged;
    read_coordinates(readings[a]);
    refine_by_neighbours(readings[a]);
  }
  return {};
}

// Photos of all sinusoids of an axis, two at a time.
Result<WavePhotos> load_waves(const AxisCode& code, const PhotoSource& photos, const std::function<void()>& tick) {
  WavePhotos loaded;
  loaded.light.resize(code.waves.size());
  std::vector<std::optional<Error>> failed(code.waves.size());
  std::vector<Mask> valid(code.waves.size());
  const int count = static_cast<int>(code.waves.size());
  for (int first = 0; first < count; first += 2) {
    parallel_for(std::min(2, count - first), [&](int k) {
      const Result<Photo> photo = photos(code.waves[first + k].index);
      if (!photo) {
        failed[first + k] = photo.error();
        return;
      }
      loaded.light[first + k] = luminance_mean(photo->value);
      valid[first + k] = photo->valid;
    });
    tick();
  }
  for (int k = 0; k < count; ++k) {
    if (failed[k]) return *failed[k];
    const Image &light = loaded.light[k], &other = loaded.light[0];
    if (!light.same_size(other.width(), other.height()))
      return error(ErrorCode::kBadFile, "photo {:04} is {} x {} pixels, the others are {} x {}", code.waves[k].index,
                   light.width(), light.height(), other.width(), other.height());
    if (k == 0) loaded.skip = Mask(light.width(), light.height(), 1);
    for (std::size_t i = 0; i < loaded.skip.data().size(); ++i) loaded.skip.data()[i] |= !valid[k].data()[i];
  }
  return loaded;
}

Result<void> Decoder::read_waves(int axis) {
  const AxisCode& code = plan.axis[axis];
  CS_TRY(const WavePhotos waves, load_waves(code, photos, tick));
  const bool alone = judged.empty() || code.bits.empty();
  if (judged.empty()) judged = Mask(waves.skip.width(), waves.skip.height(), 1);
  for (std::size_t i = 0; i < judged.data().size(); ++i)
    if (waves.skip.data()[i] && !judged.data()[i]) judged.data()[i] = static_cast<std::uint8_t>(Reason::kSaturated);
  if (levels.white.empty()) {
    levels.white = levels.black = waves.light[0];
    for (const Image& light : waves.light)
      for (std::size_t i = 0; i < light.data().size(); ++i) {
        levels.white.data()[i] = std::max(levels.white.data()[i], light.data()[i]);
        levels.black.data()[i] = std::min(levels.black.data()[i], light.data()[i]);
      }
  }
  const Image* coarse = alone ? nullptr : &readings[axis].q;
  const WaveModel model = fit_wave_model(code, waves, coarse, levels.noise);
  this->waves[axis] = read_phase(code, waves, model, coarse, options);
  return {};
}

// Once the sinusoids of both axes are read. A pixel that is lit in part may keep its contrast on one of them, where
// what is left of it is less blurred: the axes share the smaller one.
void Decoder::settle_waves() {
  if (waves[0] && waves[1]) {
    std::vector<float>&x = waves[0]->reading.contrast.data(), &y = waves[1]->reading.contrast.data();
    for (std::size_t i = 0; i < x.size(); ++i) x[i] = y[i] = std::min(x[i], y[i]);
  }
  for (int a = 0; a < 2; ++a) {
    if (!waves[a]) continue;
    AxisReading& read = waves[a]->reading;
    check_by_neighbours(read, waves[a]->other);
    AxisReading& result = readings[a];
    if (plan.axis[a].bits.empty()) {
      result = std::move(read);
      continue;
    }
    for (std::size_t i = 0; i < judged.data().size(); ++i)  // where sinusoids say nothing, the Gray code does
      if (!result.reason.data()[i] && !read.reason.data()[i]) {
        result.q.data()[i] = read.q.data()[i];
        result.sigma.data()[i] = read.sigma.data()[i];
      }
  }
}

}  // namespace

Result<Correspondence> decode_frames(const Sequence& sequence, const PhotoSource& photos, const std::string& camera,
                                     const std::string& projector, const DecodeOptions& options, Progress& progress) {
  CS_TRY(const CodePlan plan, plan_code(sequence, projector));
  const std::string stage = "decode " + projector;
  const bool has_bits = !plan.axis[0].bits.empty() || !plan.axis[1].bits.empty();
  double total = has_bits, done = 0;
  for (const AxisCode& code : plan.axis)
    total += static_cast<double>(code.bits.size()) + static_cast<double>((code.waves.size() + 1) / 2);
  progress.step(stage, 0, total);
  Decoder decoder{plan, photos, options, [&] { progress.step(stage, ++done, total); }, {}, {}, {}, {}};
  if (has_bits) CS_TRY_VOID(decoder.read_all_bits());
  for (int a = 0; a < 2; ++a)
    if (!plan.axis[a].waves.empty()) CS_TRY_VOID(decoder.read_waves(a));
  decoder.settle_waves();

  Correspondence c;
  c.camera = camera, c.projector = projector;
  c.projector_resolution = {plan.axis[0].length_px, plan.axis[1].length_px};
  const Mask& judged = decoder.judged;
  c.x = c.y = c.sigma = Image(judged.width(), judged.height(), 1, kNaN);
  const AxisReading* axes[2] = {nullptr, nullptr};
  for (int a = 0; a < 2; ++a)
    if (plan.axis[a].exists()) axes[a] = &decoder.readings[a];
  join(judged, axes, c);
  if (c.accepted == 0) return nothing_decoded(c, decoder.levels);
  return c;
}

Result<Correspondence> decode(const Session& session, const std::string& camera, const std::string& projector,
                              const DecodeOptions& options, Progress& progress) {
  return decode_frames(
      session.sequence(), [&](int index) { return session.photo(camera, index); }, camera, projector, options,
      progress);
}

}  // namespace countershade::capture
