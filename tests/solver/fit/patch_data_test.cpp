#include "solver/fit/patch_data.h"

#include <gtest/gtest.h>

#include <cmath>

#include "calib/base/random.h"

namespace countershade::solver {
namespace {

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

// 12 x 4 camera pixels: patch 0 on the left, patch 1 in the middle, no surface on the right. The only projector, of 8 x
// 4 pixels, lights the left half of patch 1 and all of patch 0, a pixel each.
struct View {
  PixelGeometry pixels;
  Photo photo;
  Image light{8, 4, 3};

  View() {
    pixels.width = 12, pixels.height = 4;
    pixels.beam.resize(1);
    Random random(hash_name("patch data"));
    photo.value = Image(12, 4, 3), photo.valid = Mask(12, 4, 1, 1);
    for (float& v : photo.value.data()) v = static_cast<float>(random.uniform(0.1, 0.9));
    for (float& v : light.data()) v = static_cast<float>(random.uniform(0, 1));
    for (int y = 0; y < 4; ++y)
      for (int x = 0; x < 12; ++x) {
        pixels.patch.push_back(x < 4 ? 0 : x < 8 ? 1 : -1);
        pixels.chart.push_back({x < 8 ? 0 : -1, 0, 0});
        const bool lit = x < 6;
        pixels.beam[0].emplace_back(lit ? static_cast<float>(x) : kNan, lit ? static_cast<float>(y) : kNan);
      }
  }
  PatchFrame reduced() const {
    const Image lights[1] = {light};
    return reduce_frame(pixels, 2, photo, {0.01, 0}, lights);
  }
  double mean(const Image& image, int x0, int x1, int c) const {
    double sum = 0;
    for (int y = 0; y < 4; ++y)
      for (int x = x0; x < x1; ++x) sum += image.at(x, y, c) / (4. * (x1 - x0));
    return sum;
  }
};

TEST(ReduceFrame, GivesMeansOfPatchesOfThePhotoAndOfThePicture) {
  const View view;
  const PatchFrame frame = view.reduced();
  for (int c = 0; c < 3; ++c) {
    EXPECT_NEAR(frame.m(0, c), view.mean(view.photo.value, 0, 4, c), 1e-6);
    EXPECT_NEAR(frame.m(1, c), view.mean(view.photo.value, 4, 8, c), 1e-6);
    EXPECT_NEAR(frame.sigma(0, c), 0.01 / 4, 1e-8);  // 16 pixels
    EXPECT_NEAR(frame.p[0](0, c), view.mean(view.light, 0, 4, c), 1e-6);
    EXPECT_NEAR(frame.p[0](1, c), view.mean(view.light, 4, 6, c) / 2, 1e-6) << "half of it is lit";
    EXPECT_NEAR(frame.mean[c], view.mean(view.photo.value, 0, 12, c), 1e-6) << "beside the surfaces too";
    EXPECT_NEAR(frame.shown[0][c], view.mean(view.light, 0, 8, c), 1e-6) << "beside what the camera sees too";
  }
}

TEST(ReduceFrame, PatchThatLosesPixelsHasNoSigmaAndOneThatLosesAllNoLight) {
  View view;
  for (int y = 0; y < 4; ++y) view.photo.valid.at(3, y) = 0;
  const PatchFrame quarter = view.reduced();
  EXPECT_TRUE(std::isinf(quarter.sigma(0, 1)));
  EXPECT_NEAR(quarter.m(0, 1), view.mean(view.photo.value, 0, 3, 1), 1e-6);
  EXPECT_FALSE(std::isinf(quarter.sigma(1, 1)));
  for (int y = 0; y < 4; ++y)
    for (int x = 0; x < 3; ++x) view.photo.valid.at(x, y) = 0;
  EXPECT_EQ(view.reduced().m(0, 1), 0);
  EXPECT_TRUE(std::isinf(view.reduced().sigma(0, 1)));
}

TEST(ReduceFrame, OneChannelStandsForAll) {
  View view;
  view.photo.value = luminance_mean(view.photo.value);
  const PatchFrame frame = view.reduced();
  for (int c = 0; c < 3; ++c) {
    EXPECT_EQ(frame.m(0, c), frame.m(0, 0));
    EXPECT_EQ(frame.mean[c], frame.mean[0]);
  }
  EXPECT_NEAR(frame.mean[2], view.mean(view.photo.value, 0, 12, 0), 1e-6);
}

}  // namespace
}  // namespace countershade::solver
