#include "calib/image/image.h"

#include <algorithm>
#include <cmath>

namespace countershade {

double NoiseModel::sigma(double value) const {
  return std::sqrt(read * read + photon * std::max(0.0, value));
}

namespace {

struct Bin {
  std::vector<float> differences;
  double mean = 0;
};

// Deviations of pixels from the mean of their two horizontal neighbours, by brightness.
void collect(const Photo& photo, std::vector<Bin>& bins) {
  const Image& image = photo.value;
  const int step = std::max<int>(1, static_cast<int>(image.pixels() / 400000));
  for (int y = 0; y < image.height(); y += step)
    for (int x = 1; x + 1 < image.width(); ++x) {
      if (!photo.valid.at(x - 1, y) || !photo.valid.at(x, y) || !photo.valid.at(x + 1, y)) continue;
      for (int c = 0; c < image.channels(); ++c) {
        const float mean = 0.5f * (image.at(x - 1, y, c) + image.at(x + 1, y, c));
        const int bin = std::clamp(static_cast<int>(mean * bins.size()), 0, static_cast<int>(bins.size()) - 1);
        bins[bin].differences.push_back(image.at(x, y, c) - mean);
        bins[bin].mean += mean;
      }
    }
}

}  // namespace

NoiseModel estimate_noise(std::span<const Photo> photos) {
  std::vector<Bin> bins(48);
  for (const Photo& photo : photos) collect(photo, bins);
  // variance = read^2 + photon mean, weighted by how well each bin knows its variance; both non-negative.
  double s = 0, sx = 0, sy = 0, sxx = 0, sxy = 0;
  for (Bin& bin : bins) {
    if (bin.differences.size() < 200) continue;
    const double mean = bin.mean / bin.differences.size();
    for (float& d : bin.differences) d = std::abs(d);
    const auto middle = bin.differences.begin() + bin.differences.size() / 2;
    std::nth_element(bin.differences.begin(), middle, bin.differences.end());
    const double sigma = *middle / 0.6745 / std::sqrt(1.5);
    const double variance = sigma * sigma, weight = bin.differences.size() / std::max(1e-18, variance * variance);
    s += weight, sx += weight * mean, sy += weight * variance, sxx += weight * mean * mean,
        sxy += weight * mean * variance;
  }
  if (s <= 0) return {1e-3, 0};
  const double determinant = s * sxx - sx * sx;
  double photon = determinant > 1e-12 * s * sxx ? (s * sxy - sx * sy) / determinant : 0;
  double read2 = (sy - photon * sx) / s;
  if (photon < 0) photon = 0, read2 = sy / s;
  if (read2 < 0) read2 = 0, photon = sxx > 0 ? sxy / sxx : 0;
  return {std::sqrt(read2), photon};
}

float sample_bilinear(const Image& image, double x, double y, int c) {
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
