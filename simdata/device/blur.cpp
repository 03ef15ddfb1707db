#include "simdata/device/blur.h"

#include <algorithm>
#include <cmath>

#include "calib/base/parallel.h"

namespace countershade::simdata {

int blur_radius(double sigma_px) {
  return sigma_px > 0 ? static_cast<int>(std::ceil(4 * sigma_px)) : 0;
}

std::vector<float> blur_kernel(double sigma_px) {
  const int radius = blur_radius(sigma_px);
  std::vector<double> weights(2 * radius + 1, 1);
  double sum = 0;
  for (int i = -radius; i <= radius; ++i) {
    if (radius > 0) weights[i + radius] = std::exp(-0.5 * i * i / (sigma_px * sigma_px));
    sum += weights[i + radius];
  }
  std::vector<float> kernel;
  for (double w : weights) kernel.push_back(static_cast<float>(w / sum));
  return kernel;
}

Image blurred(const Image& image, double sigma_px) {
  const int radius = blur_radius(sigma_px);
  if (radius == 0) return image;
  const std::vector<float> kernel = blur_kernel(sigma_px);
  const int width = image.width(), height = image.height(), channels = image.channels(), n = width * channels;
  Image out(width, height, channels);
  parallel_for(height, [&](int y) {
    std::vector<float> column(n + 2 * radius * channels, 0.0f);
    float* middle = column.data() + radius * channels;
    for (int k = -radius; k <= radius; ++k) {
      const float* row = image.row(std::clamp(y + k, 0, height - 1));
      const float w = kernel[k + radius];
      for (int i = 0; i < n; ++i) middle[i] += w * row[i];
    }
    for (int i = 0; i < radius * channels; ++i) {
      column[i] = middle[i % channels];
      middle[n + i] = middle[n - channels + i % channels];
    }
    float* to = out.row(y);
    for (int i = 0; i < n; ++i) to[i] = kernel[0] * column[i];
    for (int k = 1; k <= 2 * radius; ++k) {
      const float* shifted = column.data() + k * channels;
      for (int i = 0; i < n; ++i) to[i] += kernel[k] * shifted[i];
    }
  });
  return out;
}

}  // namespace countershade::simdata
