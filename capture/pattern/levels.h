// What the decoder knows of a camera's pixels before it reads a bit: how bright, how dark, how noisy.
#pragma once

#include "capture/pattern/decode.h"

namespace countershade::capture {

// Frame indices of one Gray code; -1 = not there.
struct BitFrames {
  int plain = -1, inverse = -1;
};
struct AxisCode {
  std::vector<BitFrames> bits;     // by bit, least significant first
  int cell_px = 1, length_px = 0;  // pixels per cell, and along the axis
  bool exists() const { return !bits.empty(); }
};
struct CodePlan {
  int white = -1, black = -1;  // of that projector alone; -1 = not there
  AxisCode axis[2];            // x, y
};

// Which frames carry the code of `projector`. Error: kRefused when there is none, or a bit lacks its inverse.
Result<CodePlan> plan_code(const Sequence& sequence, const std::string& projector);

struct Levels {
  Image white, black;  // (height, width, 1), mean of channels, linear; without such frames: extremes of two bits
  Mask saturated;      // 1 where one of these photos is
  NoiseModel noise;    // of one pixel's mean of channels
};
// Error: kBadFile when photos differ in size.
Result<Levels> measure_levels(const CodePlan& plan, const PhotoSource& photos);

// Noise from the law that light adds: a pattern and its inverse sum to the same light in every pixel, whatever bounces
// and whatever the picture, so the difference of two such sums is noise, of four exposures:
//   variance(a + a' - b - b') = 4 read^2 + photon (a + a' + b + b')
// All (height, width, 1); pixels where `skip` is not 0 do not count. Needs 200 pixels; {1e-3, 0} below.
NoiseModel noise_of_pairs(const Image& a, const Image& a_inverse, const Image& b, const Image& b_inverse,
                          const Mask& skip);

}  // namespace countershade::capture
