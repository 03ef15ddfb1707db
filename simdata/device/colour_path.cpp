#include "simdata/device/colour_path.h"

#include <algorithm>
#include <cmath>

#include "calib/base/parallel.h"

namespace countershade::simdata {

namespace {

constexpr int kLevels = 65536;

// Light at equally spaced encoded values 0..1, linear in between.
double on_curve(const std::vector<double>& curve, double encoded) {
  const double at = encoded * static_cast<double>(curve.size() - 1);
  const std::size_t i = std::min(static_cast<std::size_t>(at), curve.size() - 2);
  return curve[i] + (at - static_cast<double>(i)) * (curve[i + 1] - curve[i]);
}

// Bilinear: where pixel i of `to` lies among the pixels of `from`, both covering the same length.
struct Between {
  int low, high;
  float share;  // of high
  Between(int i, int to, int from) {
    const double at = std::clamp((i + 0.5) * from / to - 0.5, 0.0, from - 1.0);
    low = static_cast<int>(at);
    high = std::min(low + 1, from - 1);
    share = static_cast<float>(at - low);
  }
};

template <class T, class Value>
T blend(const Between& x, const Between& y, Value value) {
  const T top = value(x.low, y.low) * (1 - x.share) + value(x.high, y.low) * x.share;
  const T bottom = value(x.low, y.high) * (1 - x.share) + value(x.high, y.high) * x.share;
  return top * (1 - y.share) + bottom * y.share;
}

Picture scaled(const Picture& picture, int width, int height) {
  Picture out(width, height, 3);
  parallel_for(height, [&](int y) {
    const Between row(y, height, picture.height());
    for (int x = 0; x < width; ++x) {
      const Between column(x, width, picture.width());
      for (int c = 0; c < 3; ++c)
        out.at(x, y, c) = static_cast<std::uint16_t>(std::lround(
            blend<float>(column, row, [&](int i, int j) { return static_cast<float>(picture.at(i, j, c)); })));
    }
  });
  return out;
}

}  // namespace

ColourPath::ColourPath(const SimulatedProjector& spec, int width, int height)
    : width_(width),
      height_(height),
      native_(spec.native_resolution[0] > 0 ? spec.native_resolution : std::array<int, 2>{width, height}),
      white_segment_(static_cast<float>(spec.white_segment)),
      black_level_(static_cast<float>(spec.black_level)),
      flare_(static_cast<float>(spec.flare)) {
  plain_ = spec.white_segment == 0 && spec.flare == 0 && native_ == std::array<int, 2>{width, height} &&
           spec.colour_mixing == std::array<double, 9>{1, 0, 0, 0, 1, 0, 0, 0, 1};
  const std::vector<double>* curves[3] = {&spec.response_r, &spec.response_g, &spec.response_b};
  for (int c = 0; c < 3; ++c) {
    for (int k = 0; k < 3; ++k) mixing_(c, k) = static_cast<float>(spec.colour_mixing[3 * c + k]);
    // What follows the white segment comes on top of the curve alone.
    const double black = plain_ ? spec.black_level : 0;
    table_[c].resize(kLevels);
    for (int i = 0; i < kLevels; ++i) {
      const double v = i / 65535.0;
      const double curve = curves[c]->empty() ? std::pow(v, spec.gamma[c]) : on_curve(*curves[c], v);
      table_[c][i] = static_cast<float>(black + (1 - black) * curve);
    }
  }
}

std::vector<Light4> ColourPath::of_native(const Picture& picture, const Light4& share) const {
  const int width = native_[0], height = native_[1];
  std::vector<Light4> light(static_cast<std::size_t>(width) * height);
  const float black = plain_ ? 0 : black_level_;
  parallel_for(height, [&](int y) {
    const std::uint16_t* from = picture.empty() ? nullptr : picture.row(y);
    Light4* to = light.data() + static_cast<std::size_t>(y) * width;
    for (int x = 0; x < width; ++x, from += from ? 3 : 0) {
      Light4 v(table_[0][from ? from[0] : 0], table_[1][from ? from[1] : 0], table_[2][from ? from[2] : 0], 0);
      v = (v + white_segment_ * std::min({v[0], v[1], v[2]})) / (1 + white_segment_);
      v = (black + (1 - black) * v) * share;
      to[x] = (mixing_ * v.matrix()).array();
    }
  });
  return light;
}

std::vector<Light4> ColourPath::light(const Picture& picture, const Light4& share) const {
  const bool rescaled = native_ != std::array<int, 2>{width_, height_};
  std::vector<Light4> light =
      of_native(rescaled && !picture.empty() ? scaled(picture, native_[0], native_[1]) : picture, share);
  if (rescaled) {
    const std::vector<Light4> native = std::move(light);
    light.assign(static_cast<std::size_t>(width_) * height_, Light4::Zero());
    parallel_for(height_, [&](int y) {
      const Between row(y, height_, native_[1]);
      for (int x = 0; x < width_; ++x)
        light[static_cast<std::size_t>(y) * width_ + x] =
            blend<Light4>(Between(x, width_, native_[0]), row,
                          [&](int i, int j) -> Light4 { return native[static_cast<std::size_t>(j) * native_[0] + i]; });
    });
  }
  if (flare_ > 0) {
    Eigen::Array4d sum = Eigen::Array4d::Zero();
    for (const Light4& v : light) sum += v.cast<double>();
    const Light4 veil = (sum * (flare_ / static_cast<double>(light.size()))).cast<float>();
    for (Light4& v : light) v = (1 - flare_) * v + veil;
  }
  return light;
}

}  // namespace countershade::simdata
