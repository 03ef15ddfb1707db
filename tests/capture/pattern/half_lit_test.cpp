#include "capture/pattern/read/half_lit.h"

#include <gtest/gtest.h>

#include <cmath>

#include "calib/base/random.h"

namespace countershade::capture {
namespace {

double truth(int x, int y) {
  return 100 + 2.2 * x - 0.3 * y;
}

// A wall seen by 40 x 30 pixels with noise of .03 px; column 20 receives half its light, from its brighter side.
AxisReading wall() {
  AxisReading reading;
  reading.length_px = 600;
  reading.q = reading.sigma = Image(40, 30, 1);
  reading.contrast = Image(40, 30, 1, 0.4f);
  reading.reason = Mask(40, 30, 1);
  Random random(7);
  for (int y = 0; y < 30; ++y)
    for (int x = 0; x < 40; ++x) {
      reading.q.at(x, y) = static_cast<float>(truth(x, y) + 0.03 * random.normal());
      reading.sigma.at(x, y) = 0.03f;
    }
  for (int y = 0; y < 30; ++y) {
    reading.q.at(20, y) -= 0.8f, reading.sigma.at(20, y) = 0.8f, reading.contrast.at(20, y) = 0.2f;
    for (int x = 21; x < 40; ++x) reading.reason.at(x, y) = static_cast<std::uint8_t>(Reason::kDark);
  }
  return reading;
}

TEST(HalfLit, AReadingIsJoinedWithItsNeighboursByTheirWeights) {
  AxisReading reading = wall();
  join_half_lit(reading);
  double squares = 0, z2 = 0;
  for (int y = 0; y < 30; ++y) {
    const double off = reading.q.at(20, y) - truth(20, y);
    squares += off * off / 30, z2 += std::pow(off / reading.sigma.at(20, y), 2) / 30;
    // Inverse variances add, the plane's has a floor of .1 px.
    EXPECT_GT(reading.sigma.at(20, y), 0.09f);
    EXPECT_LT(reading.sigma.at(20, y), 0.15f);
  }
  EXPECT_LT(std::sqrt(squares), 0.08);
  EXPECT_LT(z2, 1.5);
}

TEST(HalfLit, WhatReceivesAllItsLightStays) {
  const AxisReading before = wall();
  AxisReading after = before;
  join_half_lit(after);
  for (int y = 0; y < 30; ++y)
    for (int x = 0; x < 40; ++x)
      if (x != 20) {
        EXPECT_EQ(after.q.at(x, y), before.q.at(x, y)) << x << " " << y;
      }
}

TEST(HalfLit, AReadingThatThePlaneContradictsStays) {
  AxisReading reading = wall();
  reading.q.at(20, 14) -= 12;  // outward, but by fifteen sigma
  join_half_lit(reading);
  EXPECT_FLOAT_EQ(reading.sigma.at(20, 14), 0.8f);
  EXPECT_NEAR(reading.q.at(20, 14), truth(20, 14) - 12 - 0.8, 0.2);
}

// Neighbours that see something else do not bend the plane.
TEST(HalfLit, NeighboursFarOffAreLeftOut) {
  AxisReading reading = wall();
  for (int y = 10; y < 13; ++y) reading.q.at(18, y) += 9, reading.q.at(17, y) += 9;
  join_half_lit(reading);
  EXPECT_NEAR(reading.q.at(20, 11), truth(20, 11), 0.25);
  EXPECT_LT(reading.sigma.at(20, 11), 0.15f);
}

TEST(HalfLit, ThePlaneIsWorthWhatItsReadingsScatter) {
  AxisReading reading = wall();
  Random random(11);
  for (int y = 0; y < 30; ++y)
    for (int x = 0; x < 20; ++x) reading.q.at(x, y) += static_cast<float>(0.4 * random.normal());  // sigma says .03
  join_half_lit(reading);
  for (int y = 5; y < 25; ++y) EXPECT_GT(reading.sigma.at(20, y), 0.14f) << y;
}

// Beyond a crease a darker surface goes on, lit as well: it reads what it reads.
TEST(HalfLit, ADarkerSurfaceBesideABrightOneStays) {
  AxisReading reading = wall();
  const auto bent = [](int x, int y) { return truth(x, y) - 1.8 * std::max(0.0, x - 19.5); };
  for (int y = 0; y < 30; ++y)
    for (int x = 20; x < 40; ++x) {  // farther in, nothing could be read of it
      reading.reason.at(x, y) = static_cast<std::uint8_t>(x < 22 ? Reason::kAccepted : Reason::kUncertainBit);
      reading.contrast.at(x, y) = 0.2f, reading.sigma.at(x, y) = 0.8f;
      reading.q.at(x, y) = static_cast<float>(bent(x, y));
    }
  join_half_lit(reading);
  for (int y = 0; y < 30; ++y) EXPECT_FLOAT_EQ(reading.q.at(20, y), static_cast<float>(bent(20, y))) << y;
}

// Half the light is missing on the dark side, so a pixel is pulled to the other one: when the plane would push it
// farther there, a seam lies between.
TEST(HalfLit, APlaneThatPushesInwardIsAnotherSurfaces) {
  AxisReading reading = wall();
  for (int y = 0; y < 30; ++y) reading.q.at(20, y) += 1.8f;
  join_half_lit(reading);
  for (int y = 0; y < 30; ++y) EXPECT_FLOAT_EQ(reading.sigma.at(20, y), 0.8f) << y;
}

// The centre of such a pixel is not lit: what light it has comes from within the picture.
TEST(HalfLit, NoReadingLeavesThePicture) {
  AxisReading reading = wall();
  reading.length_px = static_cast<int>(truth(20, 15) - 0.6);  // the plane ends beyond it
  for (int y = 0; y < 30; ++y) reading.q.at(20, y) = static_cast<float>(reading.length_px) - 0.6f;
  join_half_lit(reading);
  for (int y = 0; y < 30; ++y) EXPECT_LE(reading.q.at(20, y), static_cast<float>(reading.length_px) - 0.5f) << y;
  EXPECT_FLOAT_EQ(reading.sigma.at(20, 4), 0.8f);  // where the plane is beyond the picture
}

// Neighbours on two surfaces span no plane that could speak for the pixel.
TEST(HalfLit, ASeamBetweenSurfacesStays) {
  AxisReading reading = wall();
  for (int y = 0; y < 30; ++y)
    for (int x = 21; x < 40; ++x)
      reading.reason.at(x, y) = 0, reading.q.at(x, y) = static_cast<float>(truth(x, y) + 60);
  join_half_lit(reading);
  for (int y = 5; y < 25; ++y) EXPECT_FLOAT_EQ(reading.sigma.at(20, y), 0.8f) << y;
}

// A picture that ends at column 20.3, blurred: what a pixel gets is Phi, and the middle of it is known in closed form.
TEST(PullBesideDarkness, IsHowFarTheMiddleOfBlurredLightLies) {
  for (const double blur : {0.6, 1.2, 2.5}) {
    Image contrast(40, 5, 1);
    const auto share = [&](double x) { return 0.5 * std::erfc((x - 20.3) / blur / std::sqrt(2.0)); };
    for (int y = 0; y < 5; ++y)
      for (int x = 0; x < 40; ++x) contrast.at(x, y) = static_cast<float>(0.4 * share(x));
    for (int x = static_cast<int>(20.3 - 1.5 * blur); x < 20.3 + blur; ++x) {
      const double z = (20.3 - x) / blur;
      const double off = blur * std::exp(-0.5 * z * z) / std::sqrt(2 * M_PI) / share(x);
      // Differences over two pixels find the fall of a narrow blur too slow; of a wide one, four pixels do not reach
      // full light.
      EXPECT_GT(pull_beside_darkness(contrast, x, 2), 0.8 * off - 0.02) << blur << " " << x;
      EXPECT_LT(pull_beside_darkness(contrast, x, 2), (blur < 1 ? 2.2 : 1.35) * off) << blur << " " << x;
    }
  }
}

TEST(PullBesideDarkness, ShadingIsNoBlur) {
  Image contrast(40, 5, 1);
  for (int y = 0; y < 5; ++y)
    for (int x = 0; x < 40; ++x) contrast.at(x, y) = 0.4f - 0.008f * static_cast<float>(x);
  for (int x = 5; x < 35; ++x)
    EXPECT_EQ(pull_beside_darkness(contrast, x, 2), pull_of_surroundings(contrast, x, 2)) << x;
}

TEST(BesideDarkness, ReachesFourPixelsFromWhatIsNotLit) {
  Mask reason(20, 20, 1);
  reason.at(9, 10) = static_cast<std::uint8_t>(Reason::kDark);
  reason.at(3, 3) = static_cast<std::uint8_t>(Reason::kPhase);  // lit
  const Mask beside = beside_darkness(reason);
  for (int y = 0; y < 20; ++y)
    for (int x = 0; x < 20; ++x)
      EXPECT_EQ(beside.at(x, y), std::max(std::abs(x - 9), std::abs(y - 10)) <= 4) << x << " " << y;
}

}  // namespace
}  // namespace countershade::capture
