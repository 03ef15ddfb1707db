// A photo whose numbers are still the camera's own, read row by row.
#pragma once

#include <variant>

#include "calib/image/image.h"

namespace countershade {

// light = (stored - pedestal) / (full_scale - pedestal), or table[stored] where the response is not linear. A pixel is
// saturated where a channel is at saturated_from or more.
struct StoredScale {
  double pedestal = 0, full_scale = 255;
  double saturated_from = 0.995 * 255;
  std::vector<float> table;  // empty, or the light of every number that can be stored
};

class StoredPhoto {
 public:
  // values: (height, width, 1 or 3), as stored.
  StoredPhoto(Raster<std::uint8_t> values, StoredScale scale) : values_(std::move(values)), scale_(std::move(scale)) {}
  StoredPhoto(Raster<std::uint16_t> values, StoredScale scale) : values_(std::move(values)), scale_(std::move(scale)) {}
  // Linear light already.
  explicit StoredPhoto(Photo photo) : values_(std::move(photo.value)), valid_(std::move(photo.valid)) {}

  int width() const;
  int height() const;
  std::size_t bytes() const;  // memory of the values
  // Row y as it is stored where that has one channel of type T and is linear, so that light = stored gain() + offset();
  // null otherwise.
  template <class T>
  const T* linear_row(int y) const {
    const auto* values = std::get_if<Raster<T>>(&values_);
    return values != nullptr && values->channels() == 1 && scale_.table.empty() ? values->row(y) : nullptr;
  }
  float gain() const { return static_cast<float>(1 / (scale_.full_scale - scale_.pedestal)); }
  float offset() const { return -static_cast<float>(scale_.pedestal) * gain(); }
  // Mean over the channels of row y, linear light: `light` has width() floats.
  void light_row(int y, float* light) const;
  // Sets flags[x] to 1 where row y is saturated (or says nothing), leaves the others.
  void mark_saturated(int y, std::uint8_t* flags) const;

 private:
  std::variant<Raster<std::uint8_t>, Raster<std::uint16_t>, Image> values_;
  StoredScale scale_;
  Mask valid_;  // of floats
};

// Mean over channels: (height, width, 1).
Image light_of(const StoredPhoto& photo);

}  // namespace countershade
