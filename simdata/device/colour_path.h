// What a projector makes of an encoded picture before the light leaves its lens.
#pragma once

#include <Eigen/Dense>
#include <array>
#include <optional>
#include <vector>

#include "calib/file/rig.h"
#include "calib/image/image.h"

namespace countershade::simdata {

using Light4 = Eigen::Array4f;  // RGB and one idle lane

// In this order, each step leaving white white:
//
//   scaler          the encoded picture, bilinear, on the native pixels
//   curve           v = response(encoded), or encoded^gamma, per primary
//   white segment   v <- (v + s min(v)) / (1 + s)
//   black level     v <- b + (1 - b) v
//   shares          v <- share v          (of an exposure, where primaries take turns)
//   mixing          v <- M v              (so black is as coloured as white)
//   native pixels   light, bilinear, on the picture's pixels
//   flare           v <- (1 - f) v + f mean(v)
//
// All that follows the white segment is linear in light.
class ColourPath {
 public:
  ColourPath(const SimulatedProjector& spec, int width, int height);

  // (height, width) row by row; an empty picture is black. `share`: of r, g, b.
  std::vector<Light4> light(const Picture& picture, const Light4& share) const;
  // Where light() depends on the pixel's values alone, channel by channel: light at encoded / 65535, black level
  // included, shares left out.
  const std::array<std::vector<float>, 3>* table() const { return plain_ ? &table_ : nullptr; }

 private:
  std::vector<Light4> of_native(const Picture& picture, const Light4& share) const;

  int width_, height_;
  std::array<int, 2> native_;
  bool plain_ = true;
  std::array<std::vector<float>, 3> table_;
  Eigen::Matrix4f mixing_ = Eigen::Matrix4f::Zero();
  float white_segment_, black_level_, flare_;
};

}  // namespace countershade::simdata
