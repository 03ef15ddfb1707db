// What the decoder knows of a camera's pixels before it reads a bit: how bright, how dark, how noisy.
#pragma once

#include <array>
#include <map>
#include <memory>
#include <vector>

#include "calib/image/stored_photo.h"
#include "capture/pattern/plan.h"

namespace countershade::capture {

using StoredPhotos = std::map<int, std::shared_ptr<const StoredPhoto>>;  // by frame

// The two pairs of photos that sum to the same light in every pixel, whatever bounces and whatever the picture: white
// and black (or the coarsest bit and its inverse), and the finest bit and its inverse.
struct LevelPhotos {
  std::array<int, 4> index{-1, -1, -1, -1};   // frames; -1 = the axis has one bit and no levels
  std::array<const StoredPhoto*, 4> photo{};  // null = not there (yet)
  bool extremes = false;                      // no white and black were shown: extremes of the four take their place

  // Needs bits on one axis at least.
  LevelPhotos(const CodePlan& plan, const StoredPhotos& photos);
  bool complete() const;
  bool need(int frame) const;
  // White and black of a row [linear light]; sets `saturated` to 1 where one of the photos is.
  void row(int y, float* white, float* black, std::uint8_t* saturated) const;
};

struct Levels {
  NoiseModel noise;                       // of one pixel's mean of channels
  float contrast = 0;                     // 99th percentile of white - black
  float brightest = -1e9, darkest = 1e9;  // white and black at their extremes
};
// From evenly spread rows of some 65,000 pixels. Noise is what the difference of the two sums has:
//   variance(a + a' - b - b') = 4 read^2 + photon (a + a' + b + b')
Levels measure_levels(const LevelPhotos& photos);

// Noise from residuals of photos (or of sums of `terms` photos, whose light is given as a sum, too): the line through
// their variance against the light. {1e-3, 0} where fewer than 200 fall into every bin.
NoiseModel noise_of_residuals(const std::vector<float>& residuals, const std::vector<float>& light, int terms);

}  // namespace countershade::capture
