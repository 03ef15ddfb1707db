#include "calib/image/image.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>

#include "calib/base/random.h"

namespace countershade {
namespace {

Random seeded() {
  const auto* info = ::testing::UnitTest::GetInstance()->current_test_info();
  return Random(hash_name(fmt::format("{}.{}", info->test_suite_name(), info->name())));
}

constexpr NoiseModel kTruth{0.0009, 0.00016};

struct Scene {
  int stripe = 0;       // width of the bars of a black and white pattern; 0 = none
  double bright = 0.8;  // at the right, where it is brightest; falls to a third of this on the left
  double step = 1.0 / 4095;
  int channels = 1;
};

// A bar pattern with blurred edges on an unevenly lit wall, with photon and read noise, stored in whole steps.
Photo photo_of(const Scene& scene, const NoiseModel& noise, Random& random) {
  const int width = 480, height = 360;
  Photo photo{Image(width, height, scene.channels), Mask(width, height, 1, 1), 10};
  const auto pattern = [&](int x) { return scene.stripe && x / scene.stripe % 2 ? 0.01 : 1.0; };
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x)
      for (int c = 0; c < scene.channels; ++c) {
        const double bars = 0.25 * pattern(x) + 0.5 * pattern(x + 1) + 0.25 * pattern(x + 2);
        const double lit = scene.bright * (width + 2.0 * x) / (3 * width) * (1 - 0.2 * y / height) / (1 + 0.4 * c);
        const double value = bars * lit;
        const double seen = value + noise.sigma(value) * random.normal();
        photo.value.at(x, y, c) =
            static_cast<float>(scene.step > 0 ? scene.step * std::round(seen / scene.step) : seen);
      }
  return photo;
}

void expect_noise(const NoiseModel& found, const NoiseModel& truth, double tolerance,
                  std::initializer_list<double> at) {
  for (double value : at)
    EXPECT_NEAR(found.sigma(value) / truth.sigma(value), 1, tolerance)
        << "at " << value << ": read " << found.read << ", photon " << found.photon;
}

TEST(NoiseModel, AddsReadAndPhotonNoiseInSquares) {
  const NoiseModel noise{0.003, 0.0001};
  EXPECT_DOUBLE_EQ(noise.sigma(0.16), 0.005);  // 3-4-5
  EXPECT_DOUBLE_EQ(noise.sigma(0), 0.003);
  EXPECT_DOUBLE_EQ(noise.sigma(-0.1), 0.003);
}

// 10 %, as promised: 170 000 pixels in some 20 bins know a sigma to 1 % each; the rest is what edges leave behind.
constexpr double kPromised = 0.10;

TEST(EstimateNoise, FindsReadAndPhotonNoiseOfASmoothWall) {
  Random random = seeded();
  const std::vector<Photo> photos = {photo_of({0, 0.8}, kTruth, random), photo_of({0, 0.01}, kTruth, random)};
  const NoiseModel found = estimate_noise(photos);
  EXPECT_NEAR(found.read / kTruth.read, 1, kPromised);
  EXPECT_NEAR(found.photon / kTruth.photon, 1, 0.05);   // no edges here: statistics alone
  expect_noise(found, kTruth, 0.007, {0.3, 0.5, 0.7});  // 170 000 pixels know sigma to .2 %
}

TEST(EstimateNoise, IsNotFooledByTheEdgesOfPatterns) {
  Random random = seeded();
  for (int stripe : {60, 12, 8}) {
    const Photo photo = photo_of({stripe}, kTruth, random);
    SCOPED_TRACE(stripe);
    expect_noise(estimate_noise(std::span(&photo, 1)), kTruth, kPromised, {0, 0.005, 0.3, 0.5, 0.8});
  }
}

TEST(EstimateNoise, UsesAllChannels) {
  Random random = seeded();
  const Photo photo = photo_of({20, 0.9, 1.0 / 4095, 3}, kTruth, random);
  expect_noise(estimate_noise(std::span(&photo, 1)), kTruth, kPromised, {0, 0.005, 0.15, 0.3, 0.8});
}

TEST(EstimateNoise, CountsTheStepsOfTheCameraAsNoise) {
  Random random = seeded();
  // 8 bits, noise of .4 steps: most differences are 0 or one step.
  const NoiseModel truth{0.4 / 255, 0};
  const Photo photo = photo_of({0, 0.7, 1.0 / 255}, truth, random);
  const double sigma = std::sqrt(truth.read * truth.read + 1.0 / 12 / 255 / 255);  // with the rounding's own
  expect_noise(estimate_noise(std::span(&photo, 1)), {sigma, 0}, kPromised, {0.2, 0.5, 0.7});
}

TEST(EstimateNoise, IsNotZeroWhereMostNeighboursAreEqual) {
  Random random = seeded();
  const Photo photo = photo_of({0, 0.7, 1.0 / 255}, {0.15 / 255, 0}, random);
  const double steps = estimate_noise(std::span(&photo, 1)).sigma(0.5) * 255;
  // Most pixels round to the same number as their neighbours: less than the noise and the rounding on their own.
  EXPECT_GT(steps, 0.15);
  EXPECT_LT(steps, std::sqrt(0.15 * 0.15 + 1.0 / 12));
}

TEST(EstimateNoise, LeavesOutInvalidPixels) {
  Random random = seeded();
  Photo photo = photo_of({}, kTruth, random);
  for (int y = 0; y < photo.value.height(); ++y)
    for (int x = 0; x < photo.value.width(); ++x)
      if (x % 5 < 2) {
        photo.valid.at(x, y) = 0;
        if (x % 7 == 0)
          photo.value.at(x, y) = std::nanf("");
        else
          photo.value.at(x, y) += static_cast<float>(0.03 * random.normal());
      }
  expect_noise(estimate_noise(std::span(&photo, 1)), kTruth, kPromised, {0.3, 0.5, 0.8});
}

TEST(EstimateNoise, OfADarkPhotoIsReadNoise) {
  Random random = seeded();
  const Photo photo = photo_of({0, 0}, kTruth, random);
  expect_noise(estimate_noise(std::span(&photo, 1)), kTruth, kPromised, {0});
}

TEST(EstimateNoise, OfANoiselessRampIsNearlyNone) {
  Random random = seeded();
  const Photo photo = photo_of({0, 0.8, 0}, {0, 0}, random);
  EXPECT_LT(estimate_noise(std::span(&photo, 1)).sigma(0.5), 1e-7);  // rounding of floats near 1
}

TEST(RoundingSigma, IsThatOfTheConvertersStep) {
  Random random = seeded();
  Image image(200, 100, 1);
  for (float& v : image.data()) v = std::round(63 * static_cast<float>(random.uniform(.1, .9))) / 63;
  const Photo photo{image, Mask(200, 100, 1, 1), 1};
  EXPECT_NEAR(rounding_sigma(std::span(&photo, 1)), 1 / (63 * std::sqrt(12.)), 1e-7);
  EXPECT_EQ(rounding_sigma({}), 0);
}

TEST(EstimateNoise, HasADefaultWhereThereIsTooLittleToSee) {
  const Photo photo{Image(20, 5, 1, 0.5f), Mask(20, 5, 1, 1), 1};
  const NoiseModel found = estimate_noise(std::span(&photo, 1));
  EXPECT_EQ(found.read, 1e-3);
  EXPECT_EQ(found.photon, 0);
  EXPECT_EQ(estimate_noise({}).read, 1e-3);
}

// Product of lines: bilinear interpolation is exact on it within a cell.
Image saddle() {
  Image image(4, 3, 2);
  for (int y = 0; y < 3; ++y)
    for (int x = 0; x < 4; ++x) {
      image.at(x, y, 0) = static_cast<float>(1 + 2 * x - 3 * y + 0.5 * x * y);
      image.at(x, y, 1) = static_cast<float>(-x + 7 * y);
    }
  return image;
}

TEST(SampleBilinear, IsExactOnASaddle) {
  const Image image = saddle();
  for (const auto& [x, y] : {std::pair(0.0, 0.0), {3.0, 2.0}, {1.25, 0.5}, {2.75, 1.125}}) {
    EXPECT_NEAR(sample_bilinear(image, x, y, 0), 1 + 2 * x - 3 * y + 0.5 * x * y, 1e-6);  // floats near 5
    EXPECT_NEAR(sample_bilinear(image, x, y, 1), -x + 7 * y, 2e-6);                       // floats near 14
  }
}

TEST(SampleBilinear, IsClampedAtTheBorder) {
  const Image image = saddle();
  EXPECT_EQ(sample_bilinear(image, -5, -1, 0), image.at(0, 0, 0));
  EXPECT_EQ(sample_bilinear(image, 1e9, 1, 0), image.at(3, 1, 0));
  EXPECT_EQ(sample_bilinear(image, 2, 99, 1), image.at(2, 2, 1));
  EXPECT_TRUE(std::isnan(sample_bilinear(image, std::nan(""), 1, 0)));
  EXPECT_TRUE(std::isnan(sample_bilinear(image, 1, std::nan(""), 0)));
}

TEST(BoxReduce, MeansSquaresAndDropsTheRest) {
  Image image(5, 4, 2);
  for (int y = 0; y < 4; ++y)
    for (int x = 0; x < 5; ++x) image.at(x, y, 0) = static_cast<float>(x + 10 * y), image.at(x, y, 1) = 3;
  const Image half = box_reduce(image, 2);
  ASSERT_TRUE(half.same_size(2, 2));
  EXPECT_EQ(half.channels(), 2);
  EXPECT_EQ(half.at(0, 0, 0), 5.5f);   // (0 + 1 + 10 + 11) / 4
  EXPECT_EQ(half.at(1, 0, 0), 7.5f);   // (2 + 3 + 12 + 13) / 4
  EXPECT_EQ(half.at(0, 1, 0), 25.5f);  // (20 + 21 + 30 + 31) / 4
  EXPECT_EQ(half.at(1, 1, 1), 3);
  EXPECT_EQ(box_reduce(image, 1).data(), image.data());
  EXPECT_TRUE(box_reduce(image, 5).empty());
  EXPECT_THROW(box_reduce(image, 0), Bug);
}

TEST(Veil, OfAPhotosOwnMeanIsTakenOutPerChannel) {
  Image light(7, 5, 3);
  Random random(hash_name("veil"));
  for (float& v : light.data()) v = static_cast<float>(random.uniform(0, 1));
  double mean[3] = {0, 0, 0};
  for (std::size_t i = 0; i < light.data().size(); ++i) mean[i % 3] += light.data()[i] / 35;
  Image photo = light;
  for (std::size_t i = 0; i < photo.data().size(); ++i) photo.data()[i] += static_cast<float>(0.08 * mean[i % 3]);
  take_out_veil(photo, 0.08 / 1.08);
  for (std::size_t i = 0; i < photo.data().size(); ++i) EXPECT_NEAR(photo.data()[i], light.data()[i], 1e-6) << i;
}

TEST(LuminanceMean, IsTheMeanOverChannels) {
  Image image(2, 1, 3);
  image.data() = {1, 2, 6, -1, 0.5f, 2};
  const Image mean = luminance_mean(image);
  EXPECT_EQ(mean.channels(), 1);
  EXPECT_EQ(mean.data(), (std::vector<float>{3, 0.5f}));
}

}  // namespace
}  // namespace countershade
