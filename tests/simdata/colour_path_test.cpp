// Each step from encoded values to light, by its formula; white stays white through all of them.
#include "simdata/device/colour_path.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/simdata/small_room.h"

namespace countershade::simdata {
namespace {

constexpr int kWidth = 60, kHeight = 40;

std::vector<Light4> light(const SimulatedProjector& spec, const Picture& picture,
                          const Light4& share = Light4::Ones()) {
  return ColourPath(spec, kWidth, kHeight).light(picture, share);
}
template <class Value>
Picture small(Value value) {
  return test::picture(value, kWidth, kHeight);
}
Picture colour(double r, double g, double b) {
  return small([=](int, int, int c) { return c == 0 ? r : c == 1 ? g : b; });
}
SimulatedProjector linear() {
  SimulatedProjector p;
  p.gamma = {1, 1, 1};
  p.black_level = 0;
  return p;
}
void expect_colour(const Light4& v, double r, double g, double b) {  // single precision, 16 bits encoded
  EXPECT_NEAR(v[0], r, 1e-5);
  EXPECT_NEAR(v[1], g, 1e-5);
  EXPECT_NEAR(v[2], b, 1e-5);
}

TEST(ColourPath, WhiteStaysWhiteThroughEveryStep) {
  SimulatedProjector p;
  p.response_r = {0, .1, 1}, p.response_b = {.2, .3, .5, 1};
  p.colour_mixing = {.8, .15, .05, .1, .7, .2, .04, .06, .9};
  p.white_segment = .6, p.flare = .1, p.native_resolution = {77, 31};
  for (const Light4& v : light(p, colour(1, 1, 1))) expect_colour(v, 1, 1, 1);
}

TEST(ColourPath, CurvesAreLinearBetweenTheirValuesAndReplaceGamma) {
  SimulatedProjector p = linear();
  p.flare = 1e-9;  // makes it take the long way
  p.gamma = {3, 2, 3};
  p.response_r = {0, .1, .5, 1}, p.response_b = {.25, .75};
  expect_colour(light(p, colour(.5, .5, .5))[7], .3, .25, .5);  // red in the middle of its second piece
  expect_colour(light(p, colour(0, 0, 0))[7], 0, 0, .25);
  p.flare = 0;
  p.black_level = .1;
  const ColourPath plain(p, kWidth, kHeight);
  ASSERT_TRUE(plain.table());
  EXPECT_NEAR((*plain.table())[2][65535 / 3], .1 + .9 * (.25 + .5 / 3), 1e-5);
}

TEST(ColourPath, WhiteSegmentBrightensTheGreyOfAColour) {
  SimulatedProjector p = linear();
  p.white_segment = .5;
  expect_colour(light(p, colour(1, 0, 0))[3], 1 / 1.5, 0, 0);
  expect_colour(light(p, colour(.8, .4, .6))[3], 1 / 1.5, .6 / 1.5, .8 / 1.5);
}

TEST(ColourPath, MixingActsOnLightAndColoursBlackAsWhite) {
  SimulatedProjector p;
  p.gamma = {2, 2, 2}, p.black_level = .01;
  p.colour_mixing = {.9, .06, .04, .02, .8, .1, .03, .2, .6};
  const auto mixed = [](double r, double g, double b, int row) {
    const double m[9] = {.9, .06, .04, .02, .8, .1, .03, .2, .6};
    return m[3 * row] * r + m[3 * row + 1] * g + m[3 * row + 2] * b;
  };
  const double r = .01 + .99 * .25, g = .01 + .99 * .09, b = .01;
  expect_colour(light(p, colour(.5, .3, 0))[11], mixed(r, g, b, 0), mixed(r, g, b, 1), mixed(r, g, b, 2));
  const Light4 white = light(p, colour(1, 1, 1))[0], black = light(p, {})[0];
  expect_colour(black, .01 * white[0], .01 * white[1], .01 * white[2]);
  // Primaries that are on for a share of the time mix after that.
  expect_colour(light(p, colour(.5, .3, 0), {0, .5, 3, 0})[0], mixed(0, .5 * g, 3 * b, 0), mixed(0, .5 * g, 3 * b, 1),
                mixed(0, .5 * g, 3 * b, 2));
}

TEST(ColourPath, FlareKeepsTheMeanAndLiesEvenlyOverThePicture) {
  SimulatedProjector p = linear();
  const Picture picture = small([](int x, int y, int c) { return x > 40 && y > 10 + 5 * c ? .9 : .02; });
  const std::vector<Light4> without = light(p, picture);
  p.flare = .3;
  const std::vector<Light4> with = light(p, picture);
  Eigen::Array4d mean = Eigen::Array4d::Zero(), after = mean;
  for (std::size_t i = 0; i < with.size(); ++i) mean += without[i].cast<double>(), after += with[i].cast<double>();
  mean /= with.size(), after /= with.size();
  for (int c = 0; c < 3; ++c) {
    EXPECT_NEAR(after[c], mean[c], 1e-6);
    for (std::size_t i : {0, 55, 59, 2000}) EXPECT_NEAR(with[i][c], .7 * without[i][c] + .3 * mean[c], 1e-6);
  }
}

TEST(ColourPath, ScalerKeepsRampsAndLosesWhatIsFinerThanItsPixels) {
  SimulatedProjector p = linear();
  const Picture ramp = small([](int x, int y, int c) { return .1 + .01 * x + .003 * y + .02 * c; });
  for (const std::array<int, 2> native : {std::array{90, 70}, std::array{30, 20}}) {
    p.native_resolution = native;
    const std::vector<Light4> shown = light(p, ramp);
    for (int y = 2; y < kHeight - 2; ++y)
      for (int x = 2; x < kWidth - 2; ++x)
        EXPECT_NEAR(shown[y * kWidth + x][1], .12 + .01 * x + .003 * y, 2e-5) << x << " " << y;  // 16 bits, twice
  }
  const Picture stripes = small([](int x, int, int) { return x % 2; });
  p.native_resolution = {30, 20};  // each native pixel lies between a bright and a dark one
  for (const Light4& v : light(p, stripes)) EXPECT_NEAR(v[0], .5, 2e-5);
}

TEST(ColourPath, LongWayWithNothingToDoIsTheTable) {
  SimulatedProjector p;
  const ColourPath plain(p, kWidth, kHeight);
  ASSERT_TRUE(plain.table());
  p.flare = 1e-9;
  ASSERT_FALSE(ColourPath(p, kWidth, kHeight).table());
  const Picture picture =
      test::picture([](int x, int y, int c) { return .01 * x + .005 * y + .02 * c; }, kWidth, kHeight);
  const std::vector<Light4> shown = light(p, picture);
  for (std::size_t i = 0; i < shown.size(); ++i)
    for (int c = 0; c < 3; ++c) EXPECT_NEAR(shown[i][c], (*plain.table())[c][picture.data()[3 * i + c]], 1e-6);
}

}  // namespace
}  // namespace countershade::simdata
