#include "calib/image/stored_photo.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace countershade {

namespace {

// Plain loops over one row: the compiler makes vectors of them.
template <class T, class Light>
void mean_of_channels(const T* stored, int width, int channels, Light&& light_of, float* light) {
  if (channels == 1) {
    for (int x = 0; x < width; ++x) light[x] = light_of(stored[x]);
    return;
  }
  for (int x = 0; x < width; ++x) {
    float sum = 0;
    for (int c = 0; c < channels; ++c) sum += light_of(stored[x * channels + c]);
    light[x] = sum / static_cast<float>(channels);
  }
}

}  // namespace

int StoredPhoto::width() const {
  return std::visit([](const auto& values) { return values.width(); }, values_);
}
int StoredPhoto::height() const {
  return std::visit([](const auto& values) { return values.height(); }, values_);
}
std::size_t StoredPhoto::bytes() const {
  return std::visit([](const auto& values) { return values.data().size() * sizeof(values.data()[0]); }, values_);
}

void StoredPhoto::light_row(int y, float* light) const {
  const auto read = [&](const auto& values) {
    using T = std::remove_cvref_t<decltype(values.at(0, 0))>;
    const auto mean = [&](auto&& of) { mean_of_channels(values.row(y), values.width(), values.channels(), of, light); };
    if constexpr (std::is_same_v<T, float>) {
      mean([](float v) { return v; });
    } else if (!scale_.table.empty()) {
      const float* table = scale_.table.data();
      const int last = static_cast<int>(scale_.table.size()) - 1;
      mean([=](T v) { return table[std::min<int>(v, last)]; });
    } else {
      mean([gain = gain(), offset = offset()](T v) { return static_cast<float>(int{v}) * gain + offset; });
    }
  };
  std::visit(read, values_);
}

void StoredPhoto::mark_saturated(int y, std::uint8_t* flags) const {
  const auto mark = [&](const auto& values) {
    using T = std::remove_cvref_t<decltype(values.at(0, 0))>;
    const int width = values.width();  // flags may lie anywhere, for all that the compiler knows
    if constexpr (std::is_same_v<T, float>) {
      const std::uint8_t* valid = valid_.row(y);
      for (int x = 0; x < width; ++x) flags[x] |= !valid[x];
    } else {
      const T* row = values.row(y);
      if (scale_.saturated_from > std::numeric_limits<T>::max()) return;
      const auto limit = static_cast<T>(std::max(0.0, std::ceil(scale_.saturated_from)));
      const int channels = values.channels();
      if (channels == 1)
        for (int x = 0; x < width; ++x) flags[x] |= static_cast<std::uint8_t>(row[x] >= limit);
      else
        for (int i = 0; i < width * channels; ++i) flags[i / channels] |= static_cast<std::uint8_t>(row[i] >= limit);
    }
  };
  std::visit(mark, values_);
}

Image light_of(const StoredPhoto& photo) {
  Image light(photo.width(), photo.height(), 1);
  for (int y = 0; y < light.height(); ++y) photo.light_row(y, light.row(y));
  return light;
}

}  // namespace countershade
