// Which camera pixels see a projector at the end of its range.
#include "tools/job/verification.h"

#include <gtest/gtest.h>

namespace countershade::tools {
namespace {

TEST(ClippedPixels, AreThoseThatEveryProjectorLeavesDarkInSomeChannel) {
  const Eigen::Vector2f none(std::nanf(""), std::nanf(""));
  solver::PixelGeometry pixels;
  pixels.width = 5, pixels.height = 1;
  // Lit by the first; by the first, dark in green; by both, dark in one; by both, dark in green; by none.
  pixels.beam = {{{0, 0}, {1, 0}, {1, 0}, {1.4f, 0}, none}, {none, none, {0, 0}, {1, 0}, none}};
  Show show;
  show.compensated.pictures = {Picture(2, 1, 3, 900), Picture(2, 1, 3, 900)};
  show.compensated.pictures[0].at(1, 0, 1) = 0;
  show.compensated.pictures[1].at(1, 0, 1) = 0;
  const Mask clipped = clipped_pixels(pixels, show);
  EXPECT_EQ(clipped.data(), (std::vector<std::uint8_t>{0, 1, 0, 1, 0}));
}

TEST(ClippedPixels, DarkChannelsOfDifferentProjectorsDoNotClip) {
  solver::PixelGeometry pixels;
  pixels.width = pixels.height = 1;
  pixels.beam = {{{0, 0}}, {{0, 0}}};
  Show show;
  show.compensated.pictures = {Picture(1, 1, 3, 900), Picture(1, 1, 3, 900)};
  show.compensated.pictures[0].at(0, 0, 0) = 0;
  show.compensated.pictures[1].at(0, 0, 2) = 0;
  EXPECT_EQ(clipped_pixels(pixels, show).data()[0], 0);
}

}  // namespace
}  // namespace countershade::tools
