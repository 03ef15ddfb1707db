#include "solver/fit/patch_data.h"

#include <gtest/gtest.h>

#include <cmath>

#include "calib/base/random.h"
#include "solver/compensate/compensate.h"
#include "tests/support/test_model.h"

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

// A room that shines by itself: what its photo holds beyond its direct light has bounced.
TEST(BouncedLight, IsWhatAPhotoHoldsBeyondTheDirectLight) {
  const Model model = test::room();
  const int patches = model.patches.size();
  Radiosity direct(patches, 3);
  for (int i = 0; i < patches; ++i)
    for (int c = 0; c < 3; ++c) direct(i, c) = static_cast<float>(.2 + .1 * std::sin(.7 * i + c));
  const Radiosity shines = forward(model, direct), bounced = shines - direct;
  // Every patch is seen by 8 x 8 pixels, but for every so manyth, which no pixel sees; of every fifth what is guessed
  // of them shows, but far less than if they were dark.
  for (const auto& [every, bound] : {std::pair(patches, .03), {5, .05}}) {
    const auto unseen = [every = every](int i) { return i % every == 0; };
    PixelGeometry pixels;
    pixels.width = 64, pixels.height = patches;
    for (const int channels : {3, 1}) {
      pixels.chart.clear(), pixels.patch.clear();
      Image photo(64, patches, channels);
      for (int i = 0; i < patches; ++i) {
        const int s = model.patches.surface_of(i), first = i - model.patches.offset(s), nu = model.patches.nu(s);
        for (int x = 0; x < 64; ++x) {
          pixels.chart.push_back({unseen(i) ? -1 : s, (first % nu + (x % 8 + .5) / 8) / nu,
                                  (first / nu + (x / 8 + .5) / 8) / model.patches.nv(s)});
          pixels.patch.push_back(unseen(i) ? -1 : i);
          for (int c = 0; c < channels; ++c) photo.at(x, i, c) = channels == 3 ? shines(i, c) : shines.row(i).mean();
        }
      }
      const Image found = bounced_light(pixels, model, photo);
      double error = 0, sum = 0;
      for (int i = 0; i < patches; ++i)
        for (int c = 0; c < channels && !unseen(i); ++c) {
          double mean = 0;
          for (int x = 0; x < 64; ++x) mean += found.at(x, i, c) / 64;
          const double right = channels == 3 ? bounced(i, c) : bounced.row(i).mean();
          error += std::abs(mean - right), sum += right;
        }
      EXPECT_LT(error, bound * sum) << channels << " " << every;
      for (int x = 0; x < 64; ++x) EXPECT_EQ(found.at(x, 0), 0) << "no surface";
    }
  }
}

}  // namespace
}  // namespace countershade::solver
