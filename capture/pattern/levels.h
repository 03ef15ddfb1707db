// What the decoder knows of a camera's pixels before it reads a bit: how bright, how dark, how noisy.
#pragma once

#include "capture/pattern/plan.h"

namespace countershade::capture {

struct Levels {
  Image white, black;  // (height, width, 1), mean of channels, linear; without such frames: extremes of two bits
  Mask saturated;      // 1 where one of these photos is
  NoiseModel noise;    // of one pixel's mean of channels
};
// Needs bits on one axis at least. Error: kBadFile when photos differ in size.
Result<Levels> measure_levels(const CodePlan& plan, const PhotoSource& photos);

// Noise from the law that light adds: a pattern and its inverse sum to the same light in every pixel, whatever bounces
// and whatever the picture, so the difference of two such sums is noise, of four exposures:
//   variance(a + a' - b - b') = 4 read^2 + photon (a + a' + b + b')
// All (height, width, 1); pixels where `skip` is not 0 do not count. Needs 200 pixels; {1e-3, 0} below.
NoiseModel noise_of_pairs(const Image& a, const Image& a_inverse, const Image& b, const Image& b_inverse,
                          const Mask& skip);

// Noise from residuals of photos (or of sums of `terms` photos, whose light is given as a sum, too): the line through
// their variance against the light. {1e-3, 0} where fewer than 200 fall into every bin.
NoiseModel noise_of_residuals(const std::vector<float>& residuals, const std::vector<float>& light, int terms);

}  // namespace countershade::capture
