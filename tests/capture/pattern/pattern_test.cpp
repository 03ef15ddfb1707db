#include "capture/pattern/pattern.h"

#include <gtest/gtest.h>

#include <bit>
#include <numbers>
#include <set>

#include "calib/image/image_file.h"
#include "tests/capture/fake_room.h"

namespace countershade::capture {
namespace {

Role role(const std::string& kind) {
  Role r;
  r.kind = kind;
  return r;
}

Picture drawn(const Role& r, int width, int height, const std::string& projector = "left") {
  auto picture = render_role(r, projector, width, height);
  EXPECT_TRUE(picture) << picture.error().message;
  return *std::move(picture);
}

TEST(GrayCode, IsInvertedAndChangesOneBitFromCellToCell) {
  for (unsigned n = 0; n < 5000; ++n) {
    EXPECT_EQ(binary_from_gray(gray_from_binary(n)), n);
    EXPECT_EQ(std::popcount(gray_from_binary(n) ^ gray_from_binary(n + 1)), 1);
  }
  const unsigned large = 0x6d4c3b2au;
  EXPECT_EQ(binary_from_gray(gray_from_binary(large)), large);
}

TEST(GrayCode, HasAsManyBitsAsItsCellsNeed) {
  EXPECT_EQ(gray_bits(1), 1);
  EXPECT_EQ(gray_bits(2), 1);
  EXPECT_EQ(gray_bits(3), 2);
  EXPECT_EQ(gray_bits(1024), 10);
  EXPECT_EQ(gray_bits(1025), 11);
}

TEST(RenderRole, GrayPicturesSpellTheCellOfEachColumnAndRow) {
  constexpr int kWidth = 50, kHeight = 37;
  for (int cell : {1, 3})
    for (const std::string axis : {"x", "y"}) {
      std::vector<unsigned> spelled(axis == "x" ? kWidth : kHeight, 0);
      for (int bit = 0; bit < 6; ++bit) {
        Role r = role("gray");
        r.axis = axis, r.bit = bit, r.cell_px = cell;
        const Picture plain = drawn(r, kWidth, kHeight);
        r.inverse = true;
        const Picture inverse = drawn(r, kWidth, kHeight);
        for (int y = 0; y < kHeight; ++y)
          for (int x = 0; x < kWidth; ++x)
            for (int c = 0; c < 3; ++c) {
              ASSERT_EQ(plain.at(x, y, c) + inverse.at(x, y, c), 65535);
              if (c == 2 && plain.at(x, y, c) == 65535 && (axis == "x" ? y == 11 : x == 11))
                spelled[axis == "x" ? x : y] |= 1u << bit;
            }
      }
      for (std::size_t i = 0; i < spelled.size(); ++i) EXPECT_EQ(binary_from_gray(spelled[i]), i / cell);
    }
}

TEST(RenderRole, IsBlackOnOtherProjectorsAndLitOnAllWithoutAName) {
  Role r = role("white");
  EXPECT_EQ(drawn(r, 4, 3, "right").at(3, 2, 1), 65535);
  r.projector = "left";
  EXPECT_EQ(drawn(r, 4, 3, "left").at(3, 2, 1), 65535);
  EXPECT_EQ(drawn(r, 4, 3, "right").at(3, 2, 1), 0);
}

TEST(RenderRole, PhaseIsTheSinusoidOfTheContract) {
  Role r = role("phase");
  r.axis = "y", r.period_px = 13.5, r.step = 1, r.steps = 4;
  const auto expected = [&](int i, double shift, double exponent) {
    return std::pow(0.5 + 0.5 * std::cos(2 * std::numbers::pi * i / 13.5 + shift), exponent);
  };
  // Half a step of eight bits is what rounding may cost.
  constexpr double kStep = 0.5 / 255 + 1e-9;
  const Picture quarter = drawn(r, 5, 40);
  for (int y = 0; y < 40; ++y) EXPECT_NEAR(quarter.at(4, y, 1) / 65535.0, expected(y, std::numbers::pi / 2, 1), kStep);
  r.shift_rad = 0.3, r.shown_exponent = 2.2;
  const Picture given = drawn(r, 5, 40);
  for (int y = 0; y < 40; ++y) EXPECT_NEAR(given.at(0, y, 2) / 65535.0, expected(y, 0.3, 2.2), kStep);
}

TEST(RenderRole, MasksOfOnePeriodLightEveryPixelEquallyOften) {
  for (const std::string axis : {"x", "y"}) {
    std::vector<int> lit(48, 0);
    for (int step = 0; step < 4; ++step) {
      Role r = role("mask");
      r.axis = axis, r.cell_px = 6, r.step = step;
      const Picture picture = drawn(r, 48, 48);
      for (int i = 0; i < 48; ++i) lit[i] += picture.at(axis == "x" ? i : 7, axis == "x" ? 7 : i, 0) == 65535;
      // Step moves the stripe by half a cell.
      EXPECT_EQ(picture.at(axis == "x" ? 3 * step : 0, axis == "x" ? 0 : 3 * step, 0), 65535);
    }
    for (int count : lit) EXPECT_EQ(count, 2);
  }
}

TEST(RenderRole, BlocksAndTheirInverseAddToTheWholePrimary) {
  Role r = role("blocks");
  r.channel = "g", r.cell_px = 20, r.seed = 5;
  const Picture plain = drawn(r, 160, 100);
  r.inverse = true;
  const Picture inverse = drawn(r, 160, 100);
  double lit = 0;
  for (int y = 0; y < 100; ++y)
    for (int x = 0; x < 160; ++x) {
      EXPECT_EQ(plain.at(x, y, 0) + plain.at(x, y, 2) + inverse.at(x, y, 0) + inverse.at(x, y, 2), 0);
      ASSERT_EQ(plain.at(x, y, 1) + inverse.at(x, y, 1), 65535);
      EXPECT_EQ(plain.at(x, y, 1), plain.at(x - x % 20, y - y % 20, 1)) << "cells are of one value";
      lit += plain.at(x, y, 1) == 65535;
    }
  EXPECT_NEAR(lit / (160 * 100), 0.5, 0.1);  // every two by two cells hold two lit ones; a last odd row may not
}

TEST(RenderRole, SeedsAndProjectorsGiveOtherPictures) {
  Role blocks = role("blocks");
  blocks.cell_px = 10, blocks.seed = 1;
  const Picture first = drawn(blocks, 160, 90);
  blocks.seed = 2;
  EXPECT_NE(drawn(blocks, 160, 90).data(), first.data());
  Role held_out = role("held-out");
  held_out.seed = 11;
  const Picture left = drawn(held_out, 64, 40, "left");
  EXPECT_NE(drawn(held_out, 64, 40, "right").data(), left.data());
  held_out.seed = 12;
  EXPECT_NE(drawn(held_out, 64, 40, "left").data(), left.data());
}

TEST(RenderRole, HeldOutPicturesVaryAndStayOffTheEndsOfTheRange) {
  Role r = role("held-out");
  r.seed = 11;
  const Picture picture = drawn(r, 160, 100);
  for (int c = 0; c < 3; ++c) {
    double low = 1, high = 0, left = 0, right = 0, top = 0, bottom = 0, step = 0;
    for (int y = 0; y < 100; ++y)
      for (int x = 0; x < 160; ++x) {
        const double v = picture.at(x, y, c) / 65535.0;
        low = std::min(low, v), high = std::max(high, v);
        (x < 80 ? left : right) += v, (y < 50 ? top : bottom) += v;
        if (x) step = std::max(step, std::abs(v - picture.at(x - 1, y, c) / 65535.0));
      }
    EXPECT_GE(low, 0.3);  // so that a projector's darkest levels do not decide about a fit
    EXPECT_LE(high, 0.96);
    EXPECT_GT(high - low, 0.25);  // a photo has light and dark parts
    EXPECT_GT(std::abs(left - right) / 8000, 0.001);
    EXPECT_GT(std::abs(top - bottom) / 8000, 0.001);
    EXPECT_LT(step, 0.12);  // smooth: no seam of the noise's lattice
  }
}

TEST(RenderRole, RefusesKindsItDoesNotKnowByName) {
  const auto picture = render_role(role("moire"), "left", 8, 8);
  ASSERT_FALSE(picture);
  EXPECT_EQ(picture.error().code, ErrorCode::kUnsupported);
  EXPECT_NE(picture.error().message.find("'moire'"), std::string::npos);
}

Rig rig_of(int projectors) {
  Rig rig;
  for (int p = 0; p < projectors; ++p) {
    rig.projectors.emplace_back();
    rig.projectors.back().id = "p" + std::to_string(p);
    rig.projectors.back().resolution = {320 + 200 * p, 200};
  }
  return rig;
}

TEST(DefaultSequence, HasSevenPhotometricFramesAndThreeForEachFurtherProjector) {
  for (int n : {1, 2, 3}) {
    const Sequence sequence = default_sequence(rig_of(n));
    ASSERT_EQ(sequence.projectors.size(), static_cast<std::size_t>(n));
    int photometric = 0, held_out = 0, shared_black = 0;
    for (std::size_t i = 0; i < sequence.frames.size(); ++i) {
      const Role& r = sequence.frames[i].role;
      EXPECT_EQ(sequence.frames[i].index, static_cast<int>(i));
      shared_black += r.kind == "black" && r.projector.empty();
      photometric += r.kind == "blocks" || r.kind == "primary" || (r.kind == "black" && r.projector.empty());
      held_out += r.kind == "held-out";
    }
    EXPECT_EQ(photometric, 7 + 3 * (n - 1));
    EXPECT_EQ(held_out, 2);
    EXPECT_EQ(shared_black, 1);
  }
}

TEST(DefaultSequence, HasEveryBitOfBothAxesWithItsInverse) {
  const Rig rig = rig_of(2);
  const Sequence sequence = default_sequence(rig);
  for (const ProjectorSpec& p : rig.projectors) {
    std::set<std::string> names;
    for (const Frame& frame : sequence.frames)
      if (frame.role.projector == p.id && (frame.role.kind == "gray" || frame.role.kind == "white" ||
                                           (frame.role.kind == "black" && !frame.role.projector.empty())))
        names.insert(frame.role.name());
    EXPECT_EQ(names.size(), 2u + 2 * gray_bits(p.resolution[0]) + 2 * gray_bits(p.resolution[1]));
  }
}

TEST(WritePatterns, FilesHoldWhatIsShown) {
  fake::Scratch scratch("patterns");
  Sequence sequence;
  sequence.projectors = {{"left", {32, 20}}, {"right", {24, 16}}};
  Role r = role("blocks");
  r.cell_px = 4, r.channel = "b", r.projector = "left";
  sequence.frames = {{0, role("white")}, {7, r}};
  ASSERT_TRUE(write_patterns(sequence, scratch / "patterns"));
  const auto read = read_sequence(scratch / "patterns/sequence.json");
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_EQ(read->frames[1].role, r);
  const auto left = read_picture(scratch / "patterns/0007/left.png");
  const auto right = read_picture(scratch / "patterns/0007/right.png");
  ASSERT_TRUE(left && right);
  EXPECT_EQ(left->data(), drawn(r, 32, 20, "left").data());
  EXPECT_EQ(right->data(), Picture(24, 16, 3).data());
  const auto again = write_patterns(sequence, scratch / "patterns");
  ASSERT_FALSE(again);
  EXPECT_EQ(again.error().code, ErrorCode::kExists);
}

}  // namespace
}  // namespace countershade::capture
