#include "capture/pattern/read/refine.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>

#include "calib/base/random.h"
#include "capture/pattern/pattern.h"

namespace countershade::capture {
namespace {

constexpr int kWidth = 40, kHeight = 30;

double truth(int x, int y) {
  return 50.2 + 1.21 * x - 0.37 * y;
}

// A plane as an axis of 200 pixels with 8 bits is read of it, without error.
AxisReading plane(int width = kWidth) {
  AxisReading reading;
  reading.bits = 8, reading.length_px = 200;
  reading.q = Image(width, kHeight, 1);
  reading.contrast = Image(width, kHeight, 1, 0.5f);
  reading.sigma = Image(width, kHeight, 1);
  reading.reason = Mask(width, kHeight, 1);
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < width; ++x) {
      reading.q.at(x, y) = static_cast<float>(std::round(truth(x, y)));
      reading.code.push_back(gray_from_binary(static_cast<unsigned>(std::lround(truth(x, y)))));
    }
  reading.uncertain.assign(reading.code.size(), 0);
  return reading;
}

// Leaves bits of a pixel in doubt.
void doubt(AxisReading& reading, int x, int y, std::uint32_t bits) {
  reading.q.at(x, y) = NAN;
  reading.uncertain[y * kWidth + x] = bits;
  reading.reason.at(x, y) = static_cast<std::uint8_t>(Reason::kUncertainBit);
}

Reason reason_at(const AxisReading& reading, int x, int y) {
  return static_cast<Reason>(reading.reason.at(x, y));
}

TEST(RefineByNeighbours, AveragesRoundingAwayUpToTheBorder) {
  AxisReading reading = plane();
  refine_by_neighbours(reading);
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x) {
      ASSERT_EQ(reason_at(reading, x, y), Reason::kAccepted) << x << " " << y;
      // Sixteen readings at least share the rounding of .29; a corner's plane is extrapolated from one side.
      EXPECT_NEAR(reading.q.at(x, y), truth(x, y), 0.35);
      EXPECT_GT(reading.sigma.at(x, y), 0.019);
    }
}

// Least squares over what a window holds, at its centre.
double plane_at(const AxisReading& reading, const Image& q, int x, int y) {
  Eigen::Matrix3d A = Eigen::Matrix3d::Zero();
  Eigen::Vector3d b = Eigen::Vector3d::Zero();
  for (int ny = std::max(0, y - 3); ny <= std::min(q.height() - 1, y + 3); ++ny)
    for (int nx = std::max(0, x - 3); nx <= std::min(q.width() - 1, x + 3); ++nx) {
      if (std::isnan(q.at(nx, ny))) continue;
      const Eigen::Vector3d at(1, nx - x, ny - y);
      A += at * at.transpose(), b += at * (q.at(nx, ny) - 50.0);
    }
  EXPECT_EQ(reading.cell_px, 1);
  return 50 + A.ldlt().solve(b)[0];
}

// Whole windows, windows at the border and windows with holes; widths that vectors of eight and blocks of four divide
// and do not divide.
TEST(RefineByNeighbours, IsTheLeastSquaresPlaneOfTheReadingsThatAreThere) {
  for (const int width : {40, 37, 22, 7})
    for (const double missing : {0.0, 0.02, 0.3}) {
      AxisReading reading = plane(width);
      Random random(hash_name("holes") + static_cast<std::uint64_t>(width));
      for (std::size_t i = 0; i < reading.q.data().size(); ++i)
        if (random.uniform() < missing)
          reading.q.data()[i] = NAN, reading.reason.data()[i] = static_cast<std::uint8_t>(Reason::kDark);
      const Image raw = reading.q;
      refine_by_neighbours(reading);
      for (int y = 0; y < kHeight; ++y)
        for (int x = 0; x < width; ++x) {
          ASSERT_EQ(std::isnan(reading.q.at(x, y)), std::isnan(raw.at(x, y))) << width << " " << x << " " << y;
          // Single precision.
          if (!std::isnan(raw.at(x, y))) {
            ASSERT_NEAR(reading.q.at(x, y), plane_at(reading, raw, x, y), 1e-3);
          }
        }
    }
}

TEST(RefineByNeighbours, LeavesALineOfPixelsThatSpansNoPlane) {
  AxisReading reading = plane();
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x) {
      if (y == 4 || y == 10) reading.q.at(x, y) += 100;  // a window's first and last line: they do not agree
      if (y == 4 || y == 7 || y == 10) continue;
      reading.q.at(x, y) = NAN, reading.reason.at(x, y) = static_cast<std::uint8_t>(Reason::kDark);
    }
  const Image raw = reading.q;
  refine_by_neighbours(reading);
  for (int x = 3; x < kWidth - 3; ++x) {
    ASSERT_EQ(reason_at(reading, x, 7), Reason::kAccepted) << "seven of 21 agree";
    EXPECT_EQ(reading.q.at(x, 7), raw.at(x, 7));
    EXPECT_FLOAT_EQ(reading.sigma.at(x, 7), 0.29f);
  }
}

TEST(RefineByNeighbours, CompletesAPixelOnlyIfItsCertainBitsAgree) {
  AxisReading reading = plane();
  doubt(reading, 10, 12, 0b0111);
  doubt(reading, 20, 9, 0b0111);
  reading.code[9 * kWidth + 20] ^= 0b100000;  // a certain bit says another place
  doubt(reading, 30, 20, 0b0011'1111);        // more in doubt than certain
  refine_by_neighbours(reading);
  EXPECT_EQ(reason_at(reading, 10, 12), Reason::kAccepted);
  EXPECT_NEAR(reading.q.at(10, 12), truth(10, 12), 0.2);
  EXPECT_EQ(reason_at(reading, 20, 9), Reason::kUncertainBit);
  EXPECT_TRUE(std::isnan(reading.q.at(20, 9)));
  EXPECT_EQ(reason_at(reading, 30, 20), Reason::kUncertainBit);
}

TEST(RefineByNeighbours, RejectsOutliersAndSpecks) {
  AxisReading reading = plane();
  reading.q.at(15, 15) += 32;
  for (int y = 0; y < kHeight; ++y)
    for (int x = 28; x < kWidth; ++x)
      if (x > 34 || y > 18 || x < 33 || y < 17) doubt(reading, x, y, 0xff);  // leaves two by two pixels there
  refine_by_neighbours(reading);
  EXPECT_EQ(reason_at(reading, 15, 15), Reason::kInconsistent);
  EXPECT_NEAR(reading.q.at(16, 16), truth(16, 16), 0.3) << "its neighbours do not follow it";
  EXPECT_EQ(reason_at(reading, 33, 18), Reason::kIsolated);
}

// A reading that hardly says anything could be of any place: neighbours that it does not contradict do not support it.
TEST(CheckByNeighbours, AWideSigmaIsNoSupport) {
  AxisReading reading = plane();
  for (float& sigma : reading.sigma.data()) sigma = 0.05f;
  reading.q.at(20, 15) += 90, reading.sigma.at(20, 15) = 44;
  reading.q.at(25, 15) += 1, reading.sigma.at(25, 15) = 0.4f;  // this one is a poor reading of the place
  check_by_neighbours(reading, Image(kWidth, kHeight, 1, NAN));
  EXPECT_EQ(reason_at(reading, 20, 15), Reason::kInconsistent);
  EXPECT_EQ(reason_at(reading, 25, 15), Reason::kAccepted);
}

TEST(RefineByNeighbours, DoubtsDarkPixelsBesideBrightOnes) {
  AxisReading reading = plane();
  for (int y = 0; y < kHeight; ++y)
    for (int x = 20; x < kWidth; ++x) reading.contrast.at(x, y) = 0.05f;
  refine_by_neighbours(reading);
  EXPECT_LT(reading.sigma.at(19, 10), 0.2);  // the bright side loses nothing to the dark one
  EXPECT_GT(reading.sigma.at(20, 10), 0.5);  // up to 1 - 1/10 of its light may come from half a pixel off and more
  EXPECT_LT(reading.sigma.at(23, 10), 0.2);  // beyond the point spread's reach
}

}  // namespace
}  // namespace countershade::capture
