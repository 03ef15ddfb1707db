#include "tools/report/metrics.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "calib/base/random.h"

namespace countershade::tools {
namespace {

using ::testing::HasSubstr;
using ::testing::IsEmpty;

// 88 x 64 pixels, asymmetric: target falls to the right, veil grows downward, a dark margin on the left.
struct Scene {
  Image u{88, 64, 3}, c{88, 64, 3}, t{88, 64, 3};
  Mask lit{88, 64, 1}, edge{88, 64, 1}, modelled{88, 64, 1, 1};
  double white = 0.8;

  // C = T + share * (U - T).
  explicit Scene(double share) {
    for (int y = 0; y < 64; ++y)
      for (int x = 0; x < 88; ++x) {
        lit.at(x, y) = x >= 16;
        edge.at(x, y) = x >= 40 && x < 56;
        for (int k = 0; k < 3; ++k) {
          const double target = (0.55 - 0.002 * x) * (1 - 0.1 * k), veil = (0.02 + 0.001 * y) * (1 + 0.2 * k);
          t.at(x, y, k) = static_cast<float>(target);
          u.at(x, y, k) = static_cast<float>(target + veil);
          c.at(x, y, k) = static_cast<float>(target + share * veil);
        }
      }
  }
  VerifyInput input() const {
    VerifyInput in;
    in.uncompensated = &u, in.compensated = &c, in.target = &t;
    in.lit = &lit, in.edge = &edge, in.modelled = &modelled;
    in.edge_text = "16 columns";
    in.white = white;
    return in;
  }
};

void fill(Image& image, double r, double g, double b) {
  for (std::size_t i = 0; i < image.pixels(); ++i) {
    image.data()[3 * i] = static_cast<float>(r);
    image.data()[3 * i + 1] = static_cast<float>(g);
    image.data()[3 * i + 2] = static_cast<float>(b);
  }
}

TEST(Metrics, SuppressionIsTenWhenATenthOfTheVeilIsLeft) {
  const VerifyNumbers n = measure(Scene(0.1).input());
  // Photos are floats: differences of values near .5 keep five digits.
  for (const ZoneNumbers* zone : {&n.all, &n.unclipped, &n.edge, &n.per_pixel})
    EXPECT_NEAR(zone->suppression, 10, 1e-3);
}

TEST(Metrics, SuppressionIsTheInverseOfWhatIsLeft) {
  for (double share : {-0.25, 0.04, 0.2, 0.7, 1.0})
    EXPECT_NEAR(measure(Scene(share).input()).all.suppression, 1 / std::abs(share), 2e-3 / std::abs(share)) << share;
}

TEST(Metrics, APerfectShowIsInfinitelySuppressedAndPasses) {
  const VerifyNumbers n = measure(Scene(0).input());
  EXPECT_TRUE(std::isinf(n.all.suppression));
  EXPECT_EQ(n.all.compensated.mean_delta_e, 0);
  EXPECT_TRUE(judge(n, {}).pass);
  EXPECT_TRUE(nlohmann::json::parse(numbers_json(n, judge(n, {})))["suppression"].is_null());
}

TEST(Metrics, GreyLevelsAreThoseOfTheDefinition) {
  Scene s(0);
  // By hand: 255 sRGB(.5) = 187.516, 255 sRGB(.4) = 169.622 (v = 1.055 l^(1/2.4) - .055), black stays 0.
  fill(s.t, 0.4 * s.white, 0, 0);
  fill(s.u, 0.5 * s.white, 0, 0);
  fill(s.c, 0.4 * s.white, 0, 0);
  const VerifyNumbers n = measure(s.input());
  EXPECT_NEAR(n.all.uncompensated.mean_grey, (187.516 - 169.622) / 3, 0.002);  // one of three channels differs
  EXPECT_NEAR(n.all.uncompensated.p99_grey, 187.516 - 169.622, 0.002);
  EXPECT_NEAR(n.all.uncompensated.mean_percent, 10.0 / 3, 1e-4);
  EXPECT_NEAR(n.all.uncompensated.p99_percent, 10, 1e-4);
}

TEST(Metrics, GreyLevelsAreClippedButLinearNumbersAreNot) {
  Scene s(0);
  fill(s.t, 1.2 * s.white, 1.2 * s.white, 1.2 * s.white);
  fill(s.u, 1.5 * s.white, 1.5 * s.white, 1.5 * s.white);
  const VerifyNumbers n = measure(s.input());
  EXPECT_EQ(n.all.uncompensated.mean_grey, 0);
  EXPECT_EQ(n.all.uncompensated.mean_delta_e, 0);
  EXPECT_NEAR(n.all.uncompensated.mean_percent, 30, 1e-3);
}

// In a lit room the target may be above white, and grey levels clip: how much of the edge zone that is.
TEST(Metrics, EdgesAboveWhiteAreCounted) {
  Scene scene(0.1);
  EXPECT_EQ(measure(scene.input()).above_white_share, 0);
  for (int y = 0; y < 64; ++y)  // green in half of the edge zone; beside it all of them, which does not count
    for (int x = 48; x < 88; ++x) {
      scene.t.at(x, y, 1) += 0.6f;
      if (x >= 56) scene.t.at(x, y, 0) += 0.6f, scene.t.at(x, y, 2) += 0.6f;
    }
  EXPECT_NEAR(measure(scene.input()).above_white_share, 1 / 6., 1e-9);
}

TEST(Metrics, PaperMeasureIsTheShareOfLightTakenAway) {
  Scene s(0);
  fill(s.u, 0.5, 0.4, 0.3);
  fill(s.c, 0.4, 0.4, 0.1);
  fill(s.t, 0.4, 0.4, 0.1);
  EXPECT_NEAR(measure(s.input()).paper_measure, 0.3 / 1.2, 1e-6);
}

TEST(Metrics, PercentileIsExceededByOnePercent) {
  Scene s(0);
  s.u = s.t;
  // 72 blocks are lit: one block of them (1.4 %) that is off by half of white is seen by the 99th percentile, ...
  for (int y = 8; y < 16; ++y)
    for (int x = 24; x < 32; ++x)
      for (int k = 0; k < 3; ++k) s.u.at(x, y, k) += static_cast<float>(0.5 * s.white);
  EXPECT_NEAR(measure(s.input()).all.uncompensated.p99_percent, 50, 1e-3);
  // ... one of its channels (.46 %) is not.
  for (int y = 8; y < 16; ++y)
    for (int x = 24; x < 32; ++x)
      for (int k = 1; k < 3; ++k) s.u.at(x, y, k) = s.t.at(x, y, k);
  EXPECT_NEAR(measure(s.input()).all.uncompensated.p99_percent, 0, 1e-3);
}

TEST(Metrics, PixelsThatAreNotFiniteNeverEnter) {
  const Scene clean(0.1);
  Scene s(0.1);
  s.u.at(30, 20, 1) = NAN;
  s.c.at(71, 5, 2) = INFINITY;
  s.t.at(50, 40, 0) = NAN;
  for (int y = 32; y < 40; ++y)
    for (int x = 64; x < 72; ++x) s.t.at(x, y, 1) = NAN;  // a whole block
  const VerifyNumbers n = measure(s.input()), reference = measure(clean.input());
  EXPECT_EQ(n.all.compensated.blocks, reference.all.compensated.blocks - 1);
  EXPECT_EQ(n.per_pixel.compensated.blocks, reference.per_pixel.compensated.blocks - 64 - 3);
  EXPECT_NEAR(n.all.suppression, 10, 1e-3);
  EXPECT_NEAR(n.paper_measure, reference.paper_measure, 1e-3);  // 67 of 4608 pixels are missing
  EXPECT_NEAR(n.unused_share, 67.0 / 4608, 1e-9);
  EXPECT_NEAR(reference.unused_share, 0, 1e-12);
}

TEST(Metrics, UnlitPixelsNeverEnter) {
  Scene s(0.1);
  const VerifyNumbers before = measure(s.input());
  for (int y = 0; y < 64; ++y)
    for (int x = 0; x < 16; ++x) s.c.at(x, y, 0) = 77;
  const VerifyNumbers after = measure(s.input());
  EXPECT_EQ(before.all.compensated.mean_percent, after.all.compensated.mean_percent);
  EXPECT_EQ(before.paper_measure, after.paper_measure);
}

TEST(Metrics, ZonesHoldTheirMasksOnly) {
  Scene s(0.1);
  for (int y = 0; y < 64; ++y)
    for (int x = 40; x < 56; ++x)
      for (int k = 0; k < 3; ++k) s.c.at(x, y, k) = s.t.at(x, y, k) + 0.5f * (s.u.at(x, y, k) - s.t.at(x, y, k));
  Mask clipped(88, 64, 1);
  for (int y = 0; y < 64; ++y) clipped.at(47, y) = clipped.at(50, y) = 1;
  VerifyInput in = s.input();
  in.clipped = &clipped;
  const VerifyNumbers n = measure(in);
  EXPECT_EQ(n.edge.compensated.blocks, 2 * 8);
  EXPECT_NEAR(n.edge.suppression, 2, 1e-3);
  EXPECT_NEAR(n.unclipped.suppression, 10, 1e-3);  // the clipped columns are exactly the two block columns of the zone
  EXPECT_NEAR(n.clipped_share, 2.0 / 9, 1e-12);
  EXPECT_LT(n.all.suppression, 9);
}

TEST(Metrics, AveragingLowersTheNoiseFloorByTheBlock) {
  Scene s(0);
  Random random(hash_name("AveragingLowersTheNoiseFloorByTheBlock"));
  const double sigma = 0.01;
  for (float& v : s.c.data()) v += static_cast<float>(sigma * random.normal());
  for (float& v : s.t.data()) v += static_cast<float>(2 * sigma * random.normal());
  VerifyInput in = s.input();
  in.pixel_noise = sigma;
  const VerifyNumbers n = measure(in);
  // 72 blocks, 3 channels: 216 values of relative spread .756 give 5 % (1 sigma); three of them.
  EXPECT_NEAR(n.all.compensated.mean_percent / n.noise_floor_percent, 1, 0.15);
  // 13824 values: .64 %, three of them.
  EXPECT_NEAR(n.per_pixel.compensated.mean_percent / n.pixel_noise_floor_percent, 1, 0.02);
}

TEST(Metrics, NoiseAloneIsNotCalledWorse) {
  Scene s(0);
  s.u = s.c = s.t;
  Random random(hash_name("NoiseAloneIsNotCalledWorse"));
  for (Image* image : {&s.u, &s.c})
    for (float& v : image->data()) v += static_cast<float>(0.01 * random.normal());
  VerifyInput in = s.input();
  in.pixel_noise = 0.01;
  EXPECT_EQ(measure(in).worse_share, 0);
  for (int y = 0; y < 8; ++y)
    for (int x = 16; x < 24; ++x) s.c.at(x, y, 1) += 0.02f;  // 16 sigma of a block's mean
  EXPECT_NEAR(measure(in).worse_share, 1.0 / (3 * 72), 1e-12);
}

TEST(Metrics, HistogramHoldsEveryBlockOnceAndKnowsTheSign) {
  const VerifyNumbers n = measure(Scene(-0.2).input());
  double u = 0, c = 0, too_bright = 0, too_dark = 0;
  const std::size_t middle = n.histogram_u.size() / 2;
  for (std::size_t i = 0; i < n.histogram_u.size(); ++i) {
    u += n.histogram_u[i], c += n.histogram_c[i];
    if (i > middle) too_bright += n.histogram_u[i];
    if (i < middle) too_dark += n.histogram_c[i];
  }
  EXPECT_NEAR(u, 1, 1e-9);
  EXPECT_NEAR(c, 1, 1e-9);
  EXPECT_NEAR(too_bright, 1, 1e-9);  // the veil is above .02
  EXPECT_GT(too_dark, 0.9);          // a fifth of it below the target, some of it within the middle bin
}

TEST(Metrics, UncoveredPixelsAreCountedAndStillMeasured) {
  Scene s(0.1);
  for (int y = 0; y < 64; ++y) s.modelled.at(80, y) = 0;
  s.modelled.at(3, 3) = 0;  // not lit: does not matter
  const VerifyNumbers n = measure(s.input());
  EXPECT_NEAR(n.uncovered_share, 1.0 / 72, 1e-12);
  EXPECT_EQ(n.all.compensated.blocks, 72);
}

TEST(Metrics, OneChannelEqualsThreeEqualChannels) {
  const Scene s(0.3);
  Image u1(88, 64, 1), c1(88, 64, 1), t1(88, 64, 1), u3(88, 64, 3), c3(88, 64, 3), t3(88, 64, 3);
  for (int y = 0; y < 64; ++y)
    for (int x = 0; x < 88; ++x) {
      u1.at(x, y) = s.u.at(x, y, 1), c1.at(x, y) = s.c.at(x, y, 1), t1.at(x, y) = s.t.at(x, y, 1);
      for (int k = 0; k < 3; ++k)
        u3.at(x, y, k) = u1.at(x, y), c3.at(x, y, k) = c1.at(x, y), t3.at(x, y, k) = t1.at(x, y);
    }
  VerifyInput one = s.input(), three = s.input();
  one.uncompensated = &u1, one.compensated = &c1, one.target = &t1;
  three.uncompensated = &u3, three.compensated = &c3, three.target = &t3;
  EXPECT_EQ(numbers_json(measure(one), {}), numbers_json(measure(three), {}));
}

TEST(Metrics, PhotosOfDifferentSizesAreABug) {
  const Scene s(0.1);
  const Image small(80, 64, 3);
  VerifyInput in = s.input();
  in.compensated = &small;
  EXPECT_THROW(measure(in), Bug);
}

TEST(MaskedBoxReduce, AveragesValidPixelsOnly) {
  Image image(5, 4, 1);
  for (int y = 0; y < 4; ++y)
    for (int x = 0; x < 5; ++x) image.at(x, y) = static_cast<float>(10 * y + x);
  Mask valid(5, 4, 1, 1);
  valid.at(0, 0) = 0;
  valid.at(2, 2) = valid.at(3, 2) = valid.at(2, 3) = 0;
  image.at(3, 0) = NAN;
  const Reduced r = masked_box_reduce(image, valid, 2);
  ASSERT_TRUE(r.value.same_size(2, 2));  // the fifth column is dropped
  EXPECT_FLOAT_EQ(r.value.at(0, 0), (1 + 10 + 11) / 3.0f);
  EXPECT_FLOAT_EQ(r.value.at(1, 0), (2 + 12 + 13) / 3.0f);
  EXPECT_FLOAT_EQ(r.value.at(0, 1), (20 + 21 + 30 + 31) / 4.0f);
  EXPECT_TRUE(std::isnan(r.value.at(1, 1)));  // one of four
  EXPECT_EQ(r.pixels.at(1, 1), 1);
}

TEST(Verdict, PassesAGoodShow) {
  const Verdict v = judge(measure(Scene(0.05).input()), {});
  EXPECT_TRUE(v.pass);
  EXPECT_THAT(v.failures, IsEmpty());
}

TEST(Verdict, FailsAModelThatIsAFifthOff) {
  const Verdict v = judge(measure(Scene(0.2).input()), {});
  EXPECT_FALSE(v.pass);
  ASSERT_FALSE(v.failures.empty());
  EXPECT_THAT(v.failures[0], HasSubstr("5.0x"));
}

TEST(Verdict, EachBoundFailsAlone) {
  const VerifyNumbers good = measure(Scene(0.02).input());
  ASSERT_TRUE(judge(good, {}).pass);
  const auto failures = [&](auto&& spoil) {
    VerifyNumbers n = good;
    spoil(n);
    return judge(n, {}).failures.size();
  };
  EXPECT_EQ(failures([](VerifyNumbers& n) { n.unclipped.suppression = 9.9; }), 1u);
  EXPECT_EQ(failures([](VerifyNumbers& n) { n.edge.compensated.mean_grey = 2.1; }), 1u);
  EXPECT_EQ(failures([](VerifyNumbers& n) { n.worse_share = 0.011; }), 1u);
  EXPECT_EQ(failures([](VerifyNumbers& n) { n.uncovered_share = 0.021; }), 1u);
  EXPECT_EQ(failures([](VerifyNumbers& n) { n.unclipped.suppression = NAN; }), 1u);
}

TEST(Verdict, SaysWhenThereIsNothingToJudge) {
  Scene dark(0.1);
  dark.lit = Mask(88, 64, 1);
  const Verdict v = judge(measure(dark.input()), {});
  ASSERT_EQ(v.failures.size(), 1u);
  EXPECT_THAT(v.failures[0], HasSubstr("nothing in the photos is lit"));
  Scene same(0);
  same.u = same.t;
  EXPECT_FALSE(judge(measure(same.input()), {}).pass);
}

TEST(Verdict, BlamesTheNoiseWhenItHidesTheVeil) {
  VerifyNumbers n = measure(Scene(0.2).input());
  n.noise_floor_percent = 2;
  EXPECT_THAT(judge(n, {}).failures[0], HasSubstr("average more exposures"));
}

TEST(NumbersJson, HoldsWhatTheContractAsksFor) {
  VerifyNumbers n = measure(Scene(0.1).input());
  n.background.frames = 7;
  n.background.held_out_percent = 0.12;
  const auto j = nlohmann::json::parse(numbers_json(n, judge(n, {})));
  for (const char* zone : {"all", "unclipped", "edge_zone", "per_pixel"})
    for (const char* show : {"uncompensated", "compensated"})
      for (const char* key : {"mean_percent_of_white", "p99_percent_of_white", "mean_grey_levels", "p99_grey_levels",
                              "mean_delta_e_2000", "p95_delta_e_2000"})
        EXPECT_TRUE(j[zone][show][key].is_number()) << zone << show << key;
  EXPECT_EQ(j["background"]["frames"], 7);
  EXPECT_TRUE(j["background"]["certificate_percent_of_white"].is_null());
  EXPECT_EQ(j["edge_zone_is"], "16 columns");
}

}  // namespace
}  // namespace countershade::tools
