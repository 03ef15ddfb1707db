// What a frame needs and no picture changes: where projector pixels and patches meet. The GL runtime uploads the same.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "solver/transport/model.h"

namespace countershade::solver {

inline constexpr int kLightReduction =
    4;  // pictures are averaged over that many pixels squared before patches sample them
inline constexpr int kReduceSamples = 8;  // every patch is the mean of that many points squared
inline constexpr float kNowhere = -1e9f;  // a pixel coordinate that no picture has

// Cell-centred samples of one surface, three channels and a zero.
struct Chart {
  int nu = 0, nv = 0;
  std::vector<Eigen::Array4f> cells;
  // Bilinear between the cells' centres, clamped: never another surface.
  Eigen::Array4f sample(float u, float v) const;
};

// The four cells around a point and their weights; (x, y) in cells, the first cell's centre is (0, 0), clamped.
struct Taps {
  std::array<int, 4> index;  // row-major in a grid `width` wide
  std::array<float, 4> weight;
};
Taps taps(float x, float y, int width, int height);

// Encoded value of a fraction of controllable light, 0..1 -> 0..1, at table speed: linear between entries spaced by the
// float's own bits, 256 per octave (relative error 2e-6 of gamma 2.2), down to 2^-32.
class EncodeTable {
 public:
  static constexpr std::uint32_t kFirstBits = (127u - 32u) << 23;
  static constexpr int kShift = 15;
  explicit EncodeTable(const Response& response);
  float operator()(float fraction) const;
  const std::vector<float>& values() const { return values_; }

 private:
  std::vector<float> values_;
};

// A sample point of a patch in one projector: pixel of the reduced picture, and direct gain (0 = not lit).
struct LightSample {
  float x = 0, y = 0;
  std::array<float, 3> gain{0, 0, 0};
};

// Pixels of one projector that another lights too: those of the rectangle (x0, y0, width, height), with the other's
// pixel (kNowhere where it does not reach).
struct Overlap {
  int other = 0;
  int x0 = 0, y0 = 0, width = 0, height = 0;
  std::vector<std::array<float, 2>> pixel;
};

struct ProjectorPlan {
  int width = 0, height = 0;
  float black = 0, range = 1;   // light = black + range * fraction
  std::vector<float> fraction;  // of controllable light, per stored value 0..65535
  EncodeTable encode;
  std::vector<LightSample> samples;  // (P, kReduceSamples^2)
  std::vector<Chart> gain;           // per surface; what is not finite or negative is 0
  std::vector<Overlap> overlaps;
  int reduced_width() const { return (width + kLightReduction - 1) / kLightReduction; }
  int reduced_height() const { return (height + kLightReduction - 1) / kLightReduction; }
};

struct FramePlan {
  std::vector<ProjectorPlan> projectors;
  Radiosity low, high;  // direct light of all projectors black and white, (P, 3)
};

FramePlan make_frame_plan(const Model& model);

// Pixel of projector q that lights a point of the screen: inside its picture, from the front, and not where the pixel
// map says that another surface is in the way. (kNowhere, kNowhere) if none.
Eigen::Vector2f lighting_pixel(const ProjectorModel& projector, const Eigen::Vector3d& projector_position,
                               const Screen& screen, const ChartPoint& point);

}  // namespace countershade::solver
