#include "calib/image/image.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace countershade {

double NoiseModel::sigma(double value) const {
  return std::sqrt(read * read + photon * std::max(0.0, value));
}

namespace {

constexpr std::size_t kLeastSamples = 200;   // per bin: its variance is then good to 10 %
constexpr std::size_t kRowSamples = 500000;  // pixels looked at, over all photos

struct Bin {
  std::vector<float> differences;
  double sum = 0;
};

// Second differences v[x] - (v[x-1] + v[x+1]) / 2 by brightness. The brightness is the mean of all three pixels: it is
// uncorrelated with the difference, so that sorting by it biases nothing. Bins are uniform in sqrt(brightness), as
// photon noise is.
void collect(const Photo& photo, int row_step, std::vector<Bin>& bins) {
  const Image& image = photo.value;
  const auto last = static_cast<float>(bins.size() - 1);
  for (int y = 0; y < image.height(); y += row_step)
    for (int x = 1; x + 1 < image.width(); ++x) {
      if (!photo.valid.at(x - 1, y) || !photo.valid.at(x, y) || !photo.valid.at(x + 1, y)) continue;
      for (int c = 0; c < image.channels(); ++c) {
        const float sides = image.at(x - 1, y, c) + image.at(x + 1, y, c), middle = image.at(x, y, c);
        const float mean = (sides + middle) / 3;
        if (!std::isfinite(mean)) continue;
        Bin& bin = bins[std::lround(std::sqrt(std::clamp(mean, 0.0f, 1.0f)) * last)];
        bin.differences.push_back(std::abs(middle - 0.5f * sides));
        bin.sum += mean;
      }
    }
}

float quantile(std::vector<float>& values, double q) {
  const auto at = values.begin() + static_cast<std::ptrdiff_t>(q * (values.size() - 1));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

// Standard deviation of normal deviates given as absolute values, some of them outliers: from the median, then from
// what lies within 3 sigma (whose variance is .97334 sigma^2), which is finer where the values are whole steps of the
// camera. The 95 % quantile starts it where over half of the values are 0.
double robust_sigma(std::vector<float>& absolute) {
  double sigma = quantile(absolute, 0.5) / 0.6745;
  if (sigma == 0) sigma = quantile(absolute, 0.95) / 1.96;
  for (int i = 0; i < 8; ++i) {
    double sum = 0;
    std::size_t count = 0;
    for (const float d : absolute)
      if (d <= 3 * sigma) sum += double{d} * d, ++count;
    sigma = std::sqrt(sum / count / 0.97334);
  }
  return sigma;
}

// What one bin knows.
struct Level {
  double mean = 0, variance = 0, count = 0;
};

// Non-negative line through the variances of the levels with weight; least squares relative to the line `now`.
NoiseModel refit(const std::vector<Level>& levels, const std::vector<double>& weights, const NoiseModel& now) {
  double s = 0, sx = 0, sy = 0, sxx = 0, sxy = 0;
  for (std::size_t i = 0; i < levels.size(); ++i) {
    const double x = levels[i].mean, y = levels[i].variance, sigma = now.sigma(x);
    const double w = sigma > 0 ? weights[i] / (sigma * sigma * sigma * sigma) : 0;
    s += w, sx += w * x, sy += w * y, sxx += w * x * x, sxy += w * x * y;
  }
  if (s <= 0) return now;
  const double determinant = s * sxx - sx * sx;
  double photon = determinant > 1e-9 * s * sxx ? (s * sxy - sx * sy) / determinant : 0;
  double read2 = (sy - photon * sx) / s;
  if (photon < 0) photon = 0, read2 = sy / s;
  if (read2 < 0) read2 = 0, photon = sxx > 0 ? std::max(0.0, sxy / sxx) : 0;
  return {std::sqrt(read2), photon};
}

// Square of the relative misfit of a level, at most 1: a level is an outlier where its variance is off by over 30 %.
double misfit(const Level& level, const NoiseModel& line) {
  const double sigma = line.sigma(level.mean), predicted = sigma * sigma;
  if (predicted <= 0) return level.variance > 0 ? 1 : 0;
  const double r = (level.variance / predicted - 1) / 0.3;
  return std::min(1.0, r * r);
}

// The line that most pixels agree with: of the lines through two levels (or one), the one with the least truncated
// misfit, then refined on the levels that it explains. Levels between a pattern's bright and dark hold its edges, whose
// variance is far too high; there are few such pixels.
NoiseModel consensus(const std::vector<Level>& levels) {
  NoiseModel best;
  double least = HUGE_VAL;
  for (std::size_t i = 0; i < levels.size(); ++i)
    for (std::size_t j = i; j < levels.size(); ++j) {
      std::vector<double> weights(levels.size(), 0.0);
      weights[i] = weights[j] = 1;
      const NoiseModel line = refit(levels, weights, {1, 0});
      double total = 0;
      for (const Level& level : levels) total += level.count * misfit(level, line);
      if (total < least) least = total, best = line;
    }
  for (int pass = 0; pass < 3; ++pass) {
    std::vector<double> weights;
    for (const Level& level : levels) weights.push_back(misfit(level, best) < 1 ? level.count : 0);
    best = refit(levels, weights, best);
  }
  return best;
}

}  // namespace

NoiseModel estimate_noise(std::span<const Photo> photos) {
  std::size_t pixels = 0;
  for (const Photo& photo : photos) pixels += photo.value.pixels();
  std::vector<Bin> bins(48);
  for (const Photo& photo : photos) collect(photo, static_cast<int>(1 + pixels / kRowSamples), bins);
  std::vector<Level> levels;
  for (Bin& bin : bins) {
    const auto count = static_cast<double>(bin.differences.size());
    if (bin.differences.size() < kLeastSamples) continue;
    const double sigma = robust_sigma(bin.differences);
    levels.push_back({bin.sum / count, sigma * sigma / 1.5, count});
  }
  if (levels.empty()) return {1e-3, 0};
  return consensus(levels);
}

double rounding_sigma(std::span<const Photo> photos) {
  std::vector<float> values;
  for (const Photo& photo : photos) {
    const std::vector<float>& all = photo.value.data();
    const std::size_t stride = 1 + all.size() * photos.size() / 40000;
    for (std::size_t i = 0; i < all.size(); i += stride)
      if (std::isfinite(all[i])) values.push_back(all[i]);
  }
  std::sort(values.begin(), values.end());
  double step = 0;
  for (std::size_t i = 1; i < values.size(); ++i) {
    const double gap = static_cast<double>(values[i]) - values[i - 1];
    if (gap > 1e-7 && (step == 0 || gap < step)) step = gap;
  }
  return step / std::sqrt(12.0);
}

float sample_bilinear(const Image& image, double x, double y, int c) {
  if (std::isnan(x) || std::isnan(y)) return std::numeric_limits<float>::quiet_NaN();
  x = std::clamp(x, 0.0, image.width() - 1.0);
  y = std::clamp(y, 0.0, image.height() - 1.0);
  const int x0 = std::min(static_cast<int>(x), image.width() - 1),
            y0 = std::min(static_cast<int>(y), image.height() - 1);
  const int x1 = std::min(x0 + 1, image.width() - 1), y1 = std::min(y0 + 1, image.height() - 1);
  const float fx = static_cast<float>(x - x0), fy = static_cast<float>(y - y0);
  const float top = image.at(x0, y0, c) * (1 - fx) + image.at(x1, y0, c) * fx;
  const float bottom = image.at(x0, y1, c) * (1 - fx) + image.at(x1, y1, c) * fx;
  return top * (1 - fy) + bottom * fy;
}

Image box_reduce(const Image& image, int factor) {
  CS_CHECK(factor >= 1, "a box has at least one pixel");
  Image out(image.width() / factor, image.height() / factor, image.channels());
  for (int y = 0; y < out.height(); ++y)
    for (int x = 0; x < out.width(); ++x)
      for (int c = 0; c < image.channels(); ++c) {
        double sum = 0;
        for (int dy = 0; dy < factor; ++dy)
          for (int dx = 0; dx < factor; ++dx) sum += image.at(x * factor + dx, y * factor + dy, c);
        out.at(x, y, c) = static_cast<float>(sum / (factor * factor));
      }
  return out;
}

std::array<float, 3> channel_means(const Image& image) {
  const int channels = image.channels();
  std::array<double, 3> sum{0, 0, 0};
  for (std::size_t i = 0; i < image.data().size(); ++i) sum[i % channels] += image.data()[i];
  std::array<float, 3> means{0, 0, 0};
  for (int c = 0; c < 3 && image.pixels() > 0; ++c)
    means[c] = static_cast<float>(sum[std::min(c, channels - 1)] / static_cast<double>(image.pixels()));
  return means;
}

void take_out_veil(Image& photo, double share) {
  if (share == 0) return;
  const std::array<float, 3> means = channel_means(photo);
  const int channels = photo.channels();
  for (std::size_t i = 0; i < photo.data().size(); ++i)
    photo.data()[i] -= static_cast<float>(share) * means[i % channels];
}

Image luminance_mean(const Image& image) {
  Image out(image.width(), image.height(), 1);
  const int channels = image.channels();
  for (std::size_t i = 0; i < image.pixels(); ++i) {
    float sum = 0;
    for (int c = 0; c < channels; ++c) sum += image.data()[i * channels + c];
    out.data()[i] = sum / channels;
  }
  return out;
}

}  // namespace countershade
