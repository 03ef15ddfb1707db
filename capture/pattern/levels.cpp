#include "capture/pattern/levels.h"

#include <algorithm>
#include <cmath>

namespace countershade::capture {

namespace {

struct Bin {
  std::vector<float> residuals;
  double light = 0;  // sum of the four values
};

// Variance of the values within four robust sigma of their median.
double trimmed_variance(std::vector<float>& values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  const float median = *middle;
  std::vector<float> spread(values.size());
  std::transform(values.begin(), values.end(), spread.begin(), [&](float v) { return std::abs(v - median); });
  const auto high = spread.begin() + static_cast<std::ptrdiff_t>(0.9 * (spread.size() - 1));
  std::nth_element(spread.begin(), high, spread.end());
  const float limit = 2.5f * *high;  // the 90th percentile of a normal distribution's |value| is 1.64 sigma
  double sum = 0, squares = 0, n = 0;
  for (float v : values)
    if (std::abs(v - median) <= limit) n += 1, sum += v - median, squares += (v - median) * (v - median);
  return std::max(0.0, squares / n - (sum / n) * (sum / n));
}

// variance = terms read^2 + photon light through the bins, each weighted by how well it knows its variance; both
// non-negative.
NoiseModel line_through(std::vector<Bin>& bins, int terms) {
  double s = 0, sx = 0, sy = 0, sxx = 0, sxy = 0;
  for (Bin& bin : bins) {
    const double n = static_cast<double>(bin.residuals.size());
    if (n < 200) continue;
    const double variance = trimmed_variance(bin.residuals), light = bin.light / n;
    const double weight = n / std::max(1e-18, variance * variance);
    s += weight, sx += weight * light, sy += weight * variance;
    sxx += weight * light * light, sxy += weight * light * variance;
  }
  if (s <= 0) return {1e-3, 0};
  const double determinant = s * sxx - sx * sx;
  double slope = determinant > 1e-12 * s * sxx ? (s * sxy - sx * sy) / determinant : 0;
  double offset = (sy - slope * sx) / s;
  if (slope < 0) slope = 0, offset = sy / s;
  if (offset < 0) offset = 0, slope = sxx > 0 ? sxy / sxx : 0;
  return {std::sqrt(offset / terms), slope};
}

Error sizes_differ(int first, int second, const Image& a, const Image& b) {
  return error(ErrorCode::kBadFile,
               "photos {:04} and {:04} differ in size ({} x {} and {} x {}); all photos of a camera have one size",
               first, second, a.width(), a.height(), b.width(), b.height());
}

// Two frames that sum to full light.
struct Pair {
  int first, second;
  Image a, b;  // means of channels
};

Result<void> load(const PhotoSource& photos, Pair& pair, Levels& levels) {
  CS_TRY(const Photo first, photos(pair.first));
  CS_TRY(const Photo second, photos(pair.second));
  pair.a = luminance_mean(first.value), pair.b = luminance_mean(second.value);
  if (levels.white.empty()) {
    levels.white = pair.a, levels.black = pair.b;
    levels.saturated = Mask(pair.a.width(), pair.a.height(), 1);
  }
  for (const Image* image : {&pair.a, &pair.b})
    if (!image->same_size(levels.white.width(), levels.white.height()))
      return sizes_differ(pair.first, pair.second, levels.white, *image);
  for (std::size_t i = 0; i < levels.saturated.data().size(); ++i)
    if (!first.valid.data()[i] || !second.valid.data()[i]) levels.saturated.data()[i] = 1;
  return {};
}

void widen(const Image& image, Levels& levels) {
  for (std::size_t i = 0; i < image.data().size(); ++i) {
    levels.white.data()[i] = std::max(levels.white.data()[i], image.data()[i]);
    levels.black.data()[i] = std::min(levels.black.data()[i], image.data()[i]);
  }
}

}  // namespace

NoiseModel noise_of_residuals(const std::vector<float>& residuals, const std::vector<float>& light, int terms) {
  std::vector<Bin> bins(48);
  const int last = static_cast<int>(bins.size()) - 1;
  for (std::size_t i = 0; i < residuals.size(); ++i) {
    Bin& bin = bins[std::clamp(static_cast<int>(light[i] / terms * bins.size()), 0, last)];
    bin.residuals.push_back(residuals[i]);
    bin.light += light[i];
  }
  return line_through(bins, terms);
}

NoiseModel noise_of_pairs(const Image& a, const Image& a_inverse, const Image& b, const Image& b_inverse,
                          const Mask& skip) {
  std::vector<float> residuals, light;
  const std::size_t step = std::max<std::size_t>(1, a.pixels() / 400000);
  for (std::size_t i = 0; i < a.pixels(); i += step) {
    if (skip.data()[i]) continue;
    const float sum_a = a.data()[i] + a_inverse.data()[i], sum_b = b.data()[i] + b_inverse.data()[i];
    if (!std::isfinite(sum_a + sum_b)) continue;
    residuals.push_back(sum_a - sum_b);
    light.push_back(sum_a + sum_b);
  }
  return noise_of_residuals(residuals, light, 4);
}

Result<Levels> measure_levels(const CodePlan& plan, const PhotoSource& photos) {
  const AxisCode& code = plan.axis[plan.axis[0].bits.empty() ? 1 : 0];
  const auto pair_of = [](const BitFrames& bit) { return Pair{bit.plain, bit.inverse, {}, {}}; };
  const bool has_levels = plan.white >= 0 && plan.black >= 0;
  Pair full = has_levels ? Pair{plan.white, plan.black, {}, {}} : pair_of(code.bits.back());
  Levels levels;
  CS_TRY_VOID(load(photos, full, levels));
  Pair other = pair_of(code.bits.front());
  const bool two = other.first != full.first;
  if (two) CS_TRY_VOID(load(photos, other, levels));
  if (!has_levels) {
    widen(full.a, levels), widen(full.b, levels);
    if (two) widen(other.a, levels), widen(other.b, levels);
  }
  if (two) {
    levels.noise = noise_of_pairs(full.a, full.b, other.a, other.b, levels.saturated);
  } else {
    const Photo lit{full.a, Mask(full.a.width(), full.a.height(), 1, 1), 0};
    levels.noise = estimate_noise(std::span(&lit, 1));
  }
  return levels;
}

}  // namespace countershade::capture
