#include "capture/pattern/read/levels.h"

#include <algorithm>
#include <array>
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

namespace {

constexpr std::size_t kSamples = 65536;  // pixels that know a variance to a hundredth

const StoredPhoto* find(const StoredPhotos& photos, int index) {
  const auto found = photos.find(index);
  return found == photos.end() ? nullptr : found->second.get();
}

// Rows of the level photos: lit, dark, and the finest bit with its inverse.
struct LevelRows {
  std::array<std::vector<float>, 4> light;
  LevelRows(const LevelPhotos& photos, int y) {
    for (std::size_t k = 0; k < 4; ++k)
      if (photos.photo[k] != nullptr)
        light[k].resize(photos.photo[k]->width()), photos.photo[k]->light_row(y, light[k].data());
  }
};

}  // namespace

LevelPhotos::LevelPhotos(const CodePlan& plan, const StoredPhotos& photos) {
  const AxisCode& code = plan.axis[plan.axis[0].bits.empty() ? 1 : 0];
  extremes = plan.white < 0 || plan.black < 0;
  const BitFrames &coarsest = code.bits.back(), &finest = code.bits.front();
  index = {extremes ? coarsest.plain : plan.white, extremes ? coarsest.inverse : plan.black, finest.plain,
           finest.inverse};
  if (index[2] == index[0]) index[2] = index[3] = -1;
  for (int k = 0; k < 4; ++k)
    if (index[k] >= 0) photo[k] = find(photos, index[k]);
}

bool LevelPhotos::complete() const {
  for (int k = 0; k < 4; ++k)
    if (index[k] >= 0 && photo[k] == nullptr) return false;
  return true;
}

bool LevelPhotos::need(int frame) const {
  return std::find(index.begin(), index.end(), frame) != index.end();
}

void LevelPhotos::row(int y, float* white, float* black, std::uint8_t* saturated) const {
  const int width = photo[0]->width();
  const LevelRows rows(*this, y);
  std::copy(rows.light[0].begin(), rows.light[0].end(), white);
  std::copy(rows.light[1].begin(), rows.light[1].end(), black);
  for (const StoredPhoto* p : photo)
    if (p != nullptr) p->mark_saturated(y, saturated);
  if (!extremes) return;
  for (const std::vector<float>& light : rows.light)
    for (int x = 0; x < static_cast<int>(light.size()) && x < width; ++x)
      white[x] = std::max(white[x], light[x]), black[x] = std::min(black[x], light[x]);
}

Levels measure_levels(const LevelPhotos& photos) {
  CS_CHECK(photos.complete(), "all photos of the levels are there");
  const int width = photos.photo[0]->width(), height = photos.photo[0]->height();
  const bool two = photos.photo[2] != nullptr;
  const int step = static_cast<int>(std::max<std::size_t>(1, std::size_t{1} * width * height / kSamples));
  Levels levels;
  std::vector<float> residuals, light, contrast, white(width), black(width);
  for (int y = std::min(step / 2, height - 1); y < height; y += step) {
    std::vector<std::uint8_t> saturated(width, 0);
    photos.row(y, white.data(), black.data(), saturated.data());
    const LevelRows rows(photos, y);
    for (int x = 0; x < width; ++x) {
      if (!std::isfinite(white[x] - black[x])) continue;
      levels.brightest = std::max(levels.brightest, white[x]), levels.darkest = std::min(levels.darkest, black[x]);
      contrast.push_back(white[x] - black[x]);
      if (!two || saturated[x]) continue;
      const float sum_a = rows.light[0][x] + rows.light[1][x], sum_b = rows.light[2][x] + rows.light[3][x];
      if (!std::isfinite(sum_a + sum_b)) continue;
      residuals.push_back(sum_a - sum_b), light.push_back(sum_a + sum_b);
    }
  }
  if (!contrast.empty()) {
    const auto nth = contrast.begin() + static_cast<std::ptrdiff_t>(0.99 * (contrast.size() - 1));
    std::nth_element(contrast.begin(), nth, contrast.end());
    levels.contrast = *nth;
  }
  if (two) {
    levels.noise = noise_of_residuals(residuals, light, 4);
  } else {
    const Photo lit{light_of(*photos.photo[0]), Mask(width, height, 1, 1), 0};
    levels.noise = estimate_noise(std::span(&lit, 1));
  }
  return levels;
}

}  // namespace countershade::capture
