// Images in memory: linear floats, interleaved channels, row 0 on top, the centre of the first pixel at (0, 0).
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "calib/base/check.h"

namespace countershade {

template <class T>
class Raster {
 public:
  Raster() = default;
  Raster(int width, int height, int channels, T fill = T{})
      : width_(width),
        height_(height),
        channels_(channels),
        data_(static_cast<std::size_t>(width) * height * channels, fill) {}
  int width() const { return width_; }
  int height() const { return height_; }
  int channels() const { return channels_; }
  bool empty() const { return data_.empty(); }
  std::size_t pixels() const { return static_cast<std::size_t>(width_) * height_; }
  T* row(int y) { return data_.data() + static_cast<std::size_t>(y) * width_ * channels_; }
  const T* row(int y) const { return data_.data() + static_cast<std::size_t>(y) * width_ * channels_; }
  T& at(int x, int y, int c = 0) { return row(y)[static_cast<std::size_t>(x) * channels_ + c]; }
  T at(int x, int y, int c = 0) const { return row(y)[static_cast<std::size_t>(x) * channels_ + c]; }
  std::vector<T>& data() { return data_; }
  const std::vector<T>& data() const { return data_; }
  bool same_size(int width, int height) const { return width_ == width && height_ == height; }

 private:
  int width_ = 0, height_ = 0, channels_ = 0;
  std::vector<T> data_;
};

using Image = Raster<float>;            // light, or any other real quantity; 1 or 3 channels (RGB)
using Mask = Raster<std::uint8_t>;      // 1 = valid
using Picture = Raster<std::uint16_t>;  // encoded values as sent to a projector, 16 bits full range, 3 channels RGB

// A photo as the rest of the program sees it: linear light, pedestal subtracted, 1 = full scale of the camera.
// value: (height, width, 1 or 3). valid: 0 where any channel is saturated or the file says nothing.
struct Photo {
  Image value;
  Mask valid;
  double exposure_ms = 0;
};

// Standard deviation of one pixel of a photo: sigma^2 = read^2 + photon * value, in units of full scale.
struct NoiseModel {
  double read = 0;
  double photon = 0;
  double sigma(double value) const;
};

// Noise of photos of one camera, from the differences of neighbouring pixels (robust against edges): median absolute
// second difference per brightness bin, then the line through variance against mean that most pixels agree with.
// Photos as in Photo; valid has one channel. {1e-3, 0} where no bin has enough valid pixels.
NoiseModel estimate_noise(std::span<const Photo> photos);
// Standard deviation of what a converter rounds away, by the smallest step between values that occurs (step /
// sqrt(12)); coarse converters hide the noise that estimate_noise looks for. 0 where all values are equal.
double rounding_sigma(std::span<const Photo> photos);

// Mean of every channel; those beyond the image's are its last one's, 0 where there is no pixel.
std::array<float, 3> channel_means(const Image& image);

// Takes out what veiling glare lays over a photo evenly: `share` of its own mean, per channel.
void take_out_veil(Image& photo, double share);

// Value of channel c at (x, y) between pixel centres, bilinear, clamped at the border; NaN for a NaN.
float sample_bilinear(const Image& image, double x, double y, int c);

// Mean of squares of factor x factor pixels; a last partial row or column is dropped.
Image box_reduce(const Image& image, int factor);

// Mean over channels: (height, width, 1).
Image luminance_mean(const Image& image);

}  // namespace countershade
