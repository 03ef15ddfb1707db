#include "tools/report/colour.h"

#include <gtest/gtest.h>

#include <cmath>

#include "calib/base/random.h"

namespace countershade::tools {
namespace {

// Pairs of the test data of Sharma, Wu & Dalal 2005, table 1 (numbered as there), dE2000 printed to four decimals. They
// cover the places where implementations go wrong: mean hue across 0 degrees (1-16), one grey colour (7-10), and the
// rotation term for blues.
struct Pair {
  int number;
  Lab a, b;
  double expected;
};
constexpr Pair kSharma[] = {
    {1, {50.0, 2.6772, -79.7751}, {50.0, 0.0, -82.7485}, 2.0425},
    {2, {50.0, 3.1571, -77.2803}, {50.0, 0.0, -82.7485}, 2.8615},
    {3, {50.0, 2.8361, -74.0200}, {50.0, 0.0, -82.7485}, 3.4412},
    {4, {50.0, -1.3802, -84.2814}, {50.0, 0.0, -82.7485}, 1.0000},
    {5, {50.0, -1.1848, -84.8006}, {50.0, 0.0, -82.7485}, 1.0000},
    {6, {50.0, -0.9009, -85.5211}, {50.0, 0.0, -82.7485}, 1.0000},
    {7, {50.0, 0.0, 0.0}, {50.0, -1.0, 2.0}, 2.3669},
    {8, {50.0, -1.0, 2.0}, {50.0, 0.0, 0.0}, 2.3669},
    {9, {50.0, 2.4900, -0.0010}, {50.0, -2.4900, 0.0009}, 7.1792},
    {10, {50.0, 2.4900, -0.0010}, {50.0, -2.4900, 0.0010}, 7.1792},
    {11, {50.0, 2.4900, -0.0010}, {50.0, -2.4900, 0.0011}, 7.2195},
    {12, {50.0, 2.4900, -0.0010}, {50.0, -2.4900, 0.0012}, 7.2195},
    {13, {50.0, -0.0010, 2.4900}, {50.0, 0.0009, -2.4900}, 4.8045},
    {14, {50.0, -0.0010, 2.4900}, {50.0, 0.0010, -2.4900}, 4.8045},
    {15, {50.0, -0.0010, 2.4900}, {50.0, 0.0011, -2.4900}, 4.7461},
    {16, {50.0, 2.5, 0.0}, {50.0, 0.0, -2.5}, 4.3065},
    {17, {50.0, 2.5, 0.0}, {73.0, 25.0, -18.0}, 27.1492},
    {18, {50.0, 2.5, 0.0}, {61.0, -5.0, 29.0}, 22.8977},
    {19, {50.0, 2.5, 0.0}, {56.0, -27.0, -3.0}, 31.9030},
    {20, {50.0, 2.5, 0.0}, {58.0, 24.0, 15.0}, 19.4535},
    {21, {50.0, 2.5, 0.0}, {50.0, 3.1736, 0.5854}, 1.0000},
    {22, {50.0, 2.5, 0.0}, {50.0, 3.2972, 0.0}, 1.0000},
    {23, {50.0, 2.5, 0.0}, {50.0, 1.8634, 0.5757}, 1.0000},
    {24, {50.0, 2.5, 0.0}, {50.0, 3.2592, 0.3350}, 1.0000},
    {25, {60.2574, -34.0099, 36.2677}, {60.4626, -34.1751, 39.4387}, 1.2644},
    {26, {63.0109, -31.0961, -5.8663}, {62.8187, -29.7946, -4.0864}, 1.2630},
    {27, {61.2901, 3.7196, -5.3901}, {61.4292, 2.2480, -4.9620}, 1.8731},
    {28, {35.0831, -44.1164, 3.7933}, {35.0232, -40.0716, 1.5901}, 1.8645},
    {29, {22.7233, 20.0904, -46.6940}, {23.0331, 14.9730, -42.5619}, 2.0373},
    {30, {36.4612, 47.8580, 18.3852}, {36.2715, 50.5065, 21.2231}, 1.4146},
    {31, {90.8027, -2.0831, 1.4410}, {91.1528, -1.6435, 0.0447}, 1.4441},
    {32, {90.9257, -0.5406, -0.9208}, {88.6381, -0.8985, -0.7239}, 1.5381},
    {33, {6.7747, -0.2908, -2.4247}, {5.8714, -0.0985, -2.2286}, 0.6377},
    {34, {2.0776, 0.0795, -1.1350}, {0.9033, -0.0636, -0.5514}, 0.9082},
};

TEST(DeltaE2000, AgreesWithThePublishedPairs) {
  for (const Pair& p : kSharma) {
    // Half a unit of the last printed digit, and as much for the printed inputs.
    EXPECT_NEAR(delta_e_2000(p.a, p.b), p.expected, 1e-4) << "pair " << p.number;
  }
}

Lab random_lab(Random& random) {
  return {random.uniform(0, 100), random.uniform(-90, 90), random.uniform(-90, 90)};
}

TEST(DeltaE2000, IsSymmetricAndZeroOnlyForEqualColours) {
  Random random(hash_name("IsSymmetricAndZeroOnlyForEqualColours"));
  for (int i = 0; i < 2000; ++i) {
    const Lab a = random_lab(random), b = random_lab(random);
    // Only rounding differs between the two orders.
    EXPECT_NEAR(delta_e_2000(a, b), delta_e_2000(b, a), 1e-9);
    EXPECT_EQ(delta_e_2000(a, a), 0);
    EXPECT_GT(delta_e_2000(a, b), 0);
  }
}

TEST(Lab, PrimariesLieWhereTheStandardPutsThem) {
  const Lab white = lab_of_linear({1, 1, 1}), red = lab_of_linear({1, 0, 0}), blue = lab_of_linear({0, 0, 1});
  // The sRGB matrix has seven digits and the white point five: a few hundredths of a unit remain.
  EXPECT_NEAR(white[0], 100, 0.01);
  EXPECT_NEAR(white[1], 0, 0.02);
  EXPECT_NEAR(white[2], 0, 0.02);
  EXPECT_NEAR(red[0], 53.24, 0.02);
  EXPECT_NEAR(red[1], 80.09, 0.03);
  EXPECT_NEAR(red[2], 67.20, 0.03);
  EXPECT_NEAR(blue[0], 32.30, 0.02);
  EXPECT_NEAR(blue[1], 79.19, 0.03);
  EXPECT_NEAR(blue[2], -107.86, 0.03);
}

TEST(Lab, ComesBackToTheSameLight) {
  Random random(hash_name("ComesBackToTheSameLight"));
  for (int i = 0; i < 1000; ++i) {
    const Rgb light = {random.uniform() * random.uniform(), random.uniform(), random.uniform()};
    const Rgb back = linear_of_lab(lab_of_linear(light));
    // The two published matrices are inverse to each other to seven digits.
    for (int c = 0; c < 3; ++c) EXPECT_NEAR(back[c], light[c], 2e-6);
  }
}

TEST(Srgb, ComesBackToTheSameLight) {
  for (int i = 0; i <= 1000; ++i) EXPECT_NEAR(srgb_decode(srgb_encode(i / 1000.0)), i / 1000.0, 1e-6);
  EXPECT_NEAR(255 * srgb_encode(0.2140411), 127.5, 0.001);  // the middle of the scale is 21.4 % of the light
  EXPECT_EQ(srgb_encode(-0.3), 0);
  EXPECT_DOUBLE_EQ(srgb_encode(1.7), 1);
}

// L* of an sRGB colour.
double lightness(const Rgb& rgb) {
  return lab_of_linear({srgb_decode(rgb[0]), srgb_decode(rgb[1]), srgb_decode(rgb[2])})[0];
}

TEST(DivergingScale, DarkensEquallyOnBothSides) {
  double before = lightness(diverging(0)) + 1e-6;
  for (int i = 0; i <= 20; ++i) {
    const double t = i / 20.0, blue = lightness(diverging(-t)), red = lightness(diverging(t));
    // Both are 97 - 60 t but for colours at the very ends that a display cannot show and that are clamped.
    EXPECT_NEAR(blue, red, 0.7) << t;
    EXPECT_LT(red, before) << t;
    before = red;
  }
}

TEST(DivergingScale, IsBlueBelowAndRedAboveZero) {
  for (double t : {0.1, 0.4, 0.8, 1.0, 7.0}) {
    EXPECT_GT(diverging(t)[0], diverging(t)[2] + 0.05 * std::min(1.0, t));
    EXPECT_GT(diverging(-t)[2], diverging(-t)[0] + 0.05 * std::min(1.0, t));
  }
  const Rgb zero = diverging(0), unknown = diverging(NAN);
  EXPECT_NEAR(zero[0], zero[2], 0.01);
  EXPECT_EQ(unknown, (Rgb{0.5, 0.5, 0.5}));
}

}  // namespace
}  // namespace countershade::tools
