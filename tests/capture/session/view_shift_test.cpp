#include "capture/session/view_shift.h"

#include <gtest/gtest.h>

#include <cmath>

#include "calib/base/random.h"

namespace countershade::capture {
namespace {

constexpr int kWidth = 300, kHeight = 190;

struct Scene {
  double dx = 0, dy = 0;      // of all that the camera sees
  double corner_dx = 0;       // of what it sees left above alone: somebody leant on that projector
  double gain = 1, lamp = 0;  // of all; light that a lamp adds, more on the right
  double full_well_e = 10000;
  bool edges = true;  // of the lit rectangle; without them there is only a slow slope
};

double step(double x) {
  return 0.5 + 0.5 * std::erf(x / (std::sqrt(2.0) * 0.8));
}  // as blurred as a lens does

// A lit rectangle with a seam in it, on a dark wall: what white of one projector looks like.
Bins photo(const Scene& scene, std::uint64_t seed) {
  Random random(seed);
  Bins photo;
  photo.light = Image(kWidth, kHeight, 1);
  photo.colour = photo.light;
  photo.valid = Mask(kWidth, kHeight, 1, 1);
  for (int v = 0; v < kHeight; ++v)
    for (int u = 0; u < kWidth; ++u) {
      const bool corner = u < kWidth / 3 && v < kHeight / 2;
      const double x = u - scene.dx - (corner ? scene.corner_dx : 0), y = v - scene.dy;
      const double lit = scene.edges ? step(x - 31.3) * step(251.7 - x) * step(y - 22.6 - 0.1 * x) * step(171.2 - y) *
                                           (1 - 0.3 * step(x - 170.4))
                                     : 1;
      const double light = scene.gain * (0.02 + 0.5 * lit * (0.8 + 0.001 * x)) + scene.lamp * (1 + 0.5 * u / kWidth);
      photo.light.at(u, v) =
          static_cast<float>(light + random.normal() * std::sqrt(light * scene.full_well_e + 25) / scene.full_well_e);
    }
  return photo;
}

TEST(ViewShift, NoiseAndLightThatDriftsAreNoShift) {
  for (std::uint64_t seed = 1; seed <= 40; ++seed) {
    EXPECT_LT(view_shift_px(photo({}, seed), photo({}, 100 + seed)), 0.05) << seed;
    EXPECT_LT(view_shift_px(photo({}, seed), photo({.gain = 1.08, .lamp = 0.05}, 100 + seed)), 0.05) << seed;
    EXPECT_LT(view_shift_px(photo({.full_well_e = 500}, seed), photo({.full_well_e = 500}, 100 + seed)), 0.1) << seed;
    EXPECT_LT(view_shift_px(photo({.edges = false}, seed), photo({.dx = 3, .edges = false}, 100 + seed)), 0.05)
        << "nothing to be seen";
  }
}

TEST(ViewShift, IsMeasuredToATenthOfAPixelInEveryDirection) {
  for (int i = 0; i < 12; ++i)
    for (const double length : {0.15, 0.4, 0.9}) {
      const double angle = 0.26 + i * 0.52;
      const Scene moved{.dx = length * std::cos(angle), .dy = length * std::sin(angle)};
      const double found = view_shift_px(photo({}, 7), photo(moved, 8 + i));
      // A tile tells one direction at least: that of an edge in it, at most 45 degrees beside.
      EXPECT_GT(found, 0.65 * length - 0.05) << angle;
      EXPECT_LT(found, length + 0.1) << angle;
    }
}

TEST(ViewShift, OfAPartOfTheViewIsSeen) {
  EXPECT_GT(view_shift_px(photo({}, 1), photo({.corner_dx = 0.4}, 2)), 0.3);
}

TEST(ViewShift, IsToldFromSaturatedPixelsByNothing) {
  Bins before = photo({}, 1), now = photo({.dx = 0.8}, 2);
  for (auto& v : now.valid.data()) v = 0;
  EXPECT_EQ(view_shift_px(before, now), 0);
}

}  // namespace
}  // namespace countershade::capture
