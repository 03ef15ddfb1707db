#include "capture/pattern/decode.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <set>

#include "calib/file/file.h"
#include "calib/image/image_file.h"
#include "capture/pattern/read/levels.h"
#include "tests/capture/fake_room.h"
#include "tests/capture/fake_view.h"

namespace countershade::capture {
namespace {

using fake::code_of;
using fake::Score;
using fake::test_name;
using fake::View;
using testing::HasSubstr;

Result<Correspondence> decoded(const View& view, const Sequence& sequence, const DecodeOptions& options = {}) {
  SilentProgress silent;
  return decode_frames(sequence, view.photos(sequence, test_name()), "cam", "p", options, silent);
}

Correspondence good(const View& view, const Sequence& sequence) {
  auto c = decoded(view, sequence);
  EXPECT_TRUE(c) << c.error().message;
  return *std::move(c);
}

double share(const Correspondence& c, Reason reason) {
  return static_cast<double>(
             std::count(c.reason.data().begin(), c.reason.data().end(), static_cast<std::uint8_t>(reason))) /
         static_cast<double>(c.reason.pixels());
}

TEST(Decode, PicturesWithoutNoiseGiveTheTruth) {
  const View view;
  const Correspondence c = good(view, code_of(view));
  const Score s = fake::score(view, c);
  EXPECT_GT(s.coverage(), 0.995);  // the picture's own border is half lit
  EXPECT_EQ(s.wrong, 0);
  EXPECT_LT(s.rms, 0.12);  // rounding alone has .29; planes through 49 pixels leave a third of it at most
  EXPECT_EQ(c.accepted, static_cast<std::size_t>(s.accepted));
  EXPECT_EQ(c.projector_resolution, (std::array<int, 2>{300, 220}));
}

TEST(Decode, NoiseAndBlurCostFewPixelsAndMisleadAlmostNone) {
  View view;
  view.blur_px = 0.7, view.full_well = 10000;
  const Score s = fake::score(view, good(view, code_of(view)));
  EXPECT_GT(s.coverage(), 0.97);
  EXPECT_LT(s.wrong, 0.002);  // what real boards are held to
  EXPECT_LT(s.rms, 0.15);
}

TEST(Decode, SigmaPredictsTheErrorWhateverTheSlope) {
  // One camera pixel per projector pixel is the worst case: rounding is the same all over a window, and unseen.
  for (double slope : {0.37, 1.0, 1.004, 1.27, 2.3}) {
    View view;
    view.full_well = 10000, view.blur_px = 0.6;
    view.projector_width = 600, view.projector_height = 400;
    view.map = [slope](double u, double v) { return std::pair(20.3 + slope * u, 11.2 + (slope + 0.002) * v); };
    const Score s = fake::score(view, good(view, code_of(view)));
    EXPECT_GT(s.coverage(), 0.9) << slope;
    // Never half of the error; at most three times it: rounding errors hang together, so the plane counts four pixels
    // as one, which is too few where blur has already evened them out.
    EXPECT_GT(s.z2, 0.11) << slope;
    EXPECT_LT(s.z2, 4.0) << slope;
  }
}

TEST(Decode, EdgesOfTheSceneAreNotBridged) {
  View view;
  view.full_well = 10000, view.blur_px = 0.6;
  view.map = [](double u, double v) {
    const double jump = u + 0.2 * v > 140 ? 43 : 0;  // a nearer surface
    return std::pair(12 + 0.9 * u + 0.05 * v + jump, 8 + 1.2 * v + 0.04 * u - 0.2 * jump);
  };
  const Correspondence c = good(view, code_of(view));
  const Score s = fake::score(view, c);
  EXPECT_GT(s.coverage(), 0.97);
  EXPECT_LT(s.wrong, 0.002);
  for (int v = 0; v < view.height; ++v)
    for (int u = 0; u < view.width; ++u) {
      if (c.reason.at(u, v)) continue;
      // No value between the two surfaces: both within the code's own step of one of them.
      const double x = 12 + 0.9 * u + 0.05 * v;
      const double off = std::min(std::abs(c.x.at(u, v) - x), std::abs(c.x.at(u, v) - x - 43));
      EXPECT_LT(off, 2.5) << u << " " << v;
    }
}

TEST(Decode, DarkPixelsBesideBrightOnesAreHonestAboutThePull) {
  View view;
  view.full_well = 10000, view.blur_px = 0.7;
  view.albedo = [](double u, double v) {
    return (static_cast<int>(u / 20) + static_cast<int>(v / 20)) % 2 ? 0.9 : 0.06;  // a chessboard
  };
  const Score s = fake::score(view, good(view, code_of(view)));
  EXPECT_GT(s.coverage(), 0.9);
  EXPECT_LT(s.wrong, 0.002);
  EXPECT_LT(s.z2, 2.5);
}

// Bounced light as strong as the direct light, lit by the far half of the projector: the coarsest stripes are misread
// by whoever compares a bit with its inverse only (PHYSICS: direct < (1 - 2 a) indirect).
TEST(Decode, BouncedLightRejectsPixelsRatherThanMisleading) {
  for (double bounce : {0.3, 0.8, 1.4, 3.0}) {
    View view;
    view.full_well = 10000, view.blur_px = 0.5;
    view.gain = 0.9 / (1 + bounce);
    view.projector_width = 900;  // of which the camera sees the middle
    view.map = [](double u, double v) { return std::pair(320 + 1.13 * u - 0.11 * v, 9 + 0.07 * u + 1.21 * v); };
    view.bounce = [bounce](double u, double v) { return bounce * (1 + 0.1 * std::sin(u / 30 + v / 50)); };
    const auto c = decoded(view, code_of(view));
    if (!c) {  // an honest answer where three quarters of the light is not direct
      EXPECT_GT(bounce, 2);
      EXPECT_EQ(c.error().code, ErrorCode::kRefused);
      continue;
    }
    const Score s = fake::score(view, *c);
    EXPECT_LT(s.wrong, 0.002) << bounce;
    EXPECT_GT(s.coverage(), bounce < 0.9 ? 0.95 : 0) << bounce;
  }
}

TEST(Decode, LightThatOnlyBouncesIsCalledIndirect) {
  View view;
  view.full_well = 10000;
  view.map = [](double u, double v) {
    return u < 120 ? std::pair(14 + 1.1 * u, 9 + 1.2 * v) : std::pair(-1000.0, 0.0);
  };
  view.bounce = [](double u, double) { return u < 120 ? 0.05 : 0.4; };
  const Correspondence c = good(view, code_of(view));
  const double dark_side = 0.5;
  EXPECT_NEAR(share(c, Reason::kIndirect), dark_side, 0.01);
  EXPECT_LT(static_cast<double>(c.lit), 0.52 * static_cast<double>(c.reason.pixels())) << "they are not called lit";
  EXPECT_GT(static_cast<double>(c.accepted), 0.98 * static_cast<double>(c.lit));
}

TEST(Decode, TellsDarkFromSaturated) {
  View view;
  view.albedo = [](double u, double) { return u < 60 ? 1.4 : u < 120 ? 0.5 : 0.0005; };
  view.full_well = 10000;
  const Correspondence c = good(view, code_of(view));
  for (int v = 5; v < view.height - 5; v += 7) {
    EXPECT_EQ(c.reason.at(30, v), static_cast<int>(Reason::kSaturated));
    EXPECT_EQ(c.reason.at(90, v), static_cast<int>(Reason::kAccepted));
    EXPECT_EQ(c.reason.at(180, v), static_cast<int>(Reason::kDark));
    EXPECT_TRUE(std::isnan(c.x.at(180, v)) && std::isnan(c.y.at(180, v)) && std::isnan(c.sigma.at(180, v)));
  }
}

TEST(Decode, OneAxisLeavesTheOtherOpen) {
  const View view;
  const Correspondence c = good(view, code_of(view, {.axes = "y"}));
  const Score s = fake::score(view, c);
  EXPECT_GT(s.coverage(), 0.99);
  EXPECT_EQ(s.wrong, 0);
  for (float x : c.x.data()) EXPECT_TRUE(std::isnan(x));
}

TEST(Decode, CellsOfSeveralPixelsHaveTheirMiddleAsCoordinate) {
  View view;
  view.full_well = 10000;
  view.map = [](double u, double v) { return std::pair(30 + 0.9 * u - 0.3 * v, 9 + 0.31 * u + 0.8 * v); };
  const Correspondence c = good(view, code_of(view, {.cell_px = 4}));
  double bias = 0;
  for (int v = 0; v < view.height; ++v)
    for (int u = 0; u < view.width; ++u)
      if (!c.reason.at(u, v)) bias += c.x.at(u, v) - view.truth(u, v).first;
  EXPECT_GT(static_cast<double>(c.accepted), 0.9 * static_cast<double>(c.lit));
  EXPECT_LT(std::abs(bias) / static_cast<double>(c.accepted), 0.1);  // a middle off by half a pixel would show
  const Score s = fake::score(view, c);
  EXPECT_LT(s.rms, 0.6);  // a third of a pixel is the scatter of cells of one pixel: four times as wide
  EXPECT_LT(s.z2, 2.5);
}

TEST(Decode, APixelOnTheBorderOfTwoCellsIsReadAsTheBorder) {
  // Every camera pixel looks at the border of columns 99 and 100, which one bit tells apart, and at its own row.
  const Sequence sequence = code_of(View{});
  const auto photos = [&](int index) -> Result<Photo> {
    Photo photo{Image(24, 30, 1), Mask(24, 30, 1, 1), 0};
    CS_TRY(const Picture picture, render_role(sequence.frames[index - 3].role, "p", 300, 220));
    for (int v = 0; v < 30; ++v)
      for (int u = 0; u < 24; ++u)
        photo.value.at(u, v) = (picture.at(99, 50 + v) + picture.at(100, 50 + v)) / (4 * 65535.0f);
    return photo;
  };
  SilentProgress silent;
  const auto c = decode_frames(sequence, photos, "cam", "p", {}, silent);
  ASSERT_TRUE(c) << c.error().message;
  EXPECT_EQ(c->accepted, c->reason.pixels());
  for (float x : c->x.data()) EXPECT_NEAR(x, 99.5, 1e-4);
}

TEST(Decode, NeedsNeitherWhiteNorBlack) {
  View view;
  view.full_well = 10000;
  const Score s = fake::score(view, good(view, code_of(view, {.levels = false})));
  EXPECT_GT(s.coverage(), 0.97);
  EXPECT_LT(s.wrong, 0.002);
}

TEST(Decode, TakesTheMeanOfColourChannels) {
  View view;
  view.channels = 3, view.full_well = 4000, view.width = 160, view.height = 120;
  const Score s = fake::score(view, good(view, code_of(view)));
  EXPECT_GT(s.coverage(), 0.97);
  EXPECT_LT(s.wrong, 0.002);
}

TEST(Decode, PhotosInTheWrongOrderAreNotAccepted) {
  View view;
  view.full_well = 10000;
  const Sequence sequence = code_of(view);
  const PhotoSource right = view.photos(sequence, test_name());
  // Two pairs of bits 4 and 5 of x changed places.
  std::map<int, int> swapped;
  for (const Frame& a : sequence.frames)
    for (const Frame& b : sequence.frames)
      if (a.role.kind == "gray" && b.role.kind == "gray" && a.role.axis == "x" && b.role.axis == "x" &&
          a.role.inverse == b.role.inverse && a.role.bit == 2 && b.role.bit == 6)
        swapped[a.index] = b.index, swapped[b.index] = a.index;
  ASSERT_EQ(swapped.size(), 4u);
  SilentProgress silent;
  const auto c = decode_frames(
      sequence, [&](int i) { return right(swapped.count(i) ? swapped.at(i) : i); }, "cam", "p", {}, silent);
  // A swapped code jumps at every stripe: what is left must be little.
  EXPECT_LT(c ? static_cast<double>(c->accepted) / static_cast<double>(c->lit) : 0, 0.7);
}

TEST(Decode, SaysWhichFrameIsMissing) {
  const View view;
  Sequence sequence = code_of(view);
  std::erase_if(sequence.frames, [](const Frame& f) {
    return f.role.kind == "gray" && f.role.axis == "y" && f.role.bit == 3 && f.role.inverse;
  });
  const auto c = decoded(view, sequence);
  ASSERT_FALSE(c);
  EXPECT_EQ(c.error().code, ErrorCode::kRefused);
  EXPECT_THAT(c.error().message, HasSubstr("bit 3 of axis y lacks its inverse"));
}

TEST(Decode, RefusesAProjectorWithoutCode) {
  const View view;
  SilentProgress silent;
  const Sequence sequence = code_of(view);
  const auto c = decode_frames(sequence, view.photos(sequence, test_name()), "cam", "q", {}, silent);
  ASSERT_FALSE(c);
  EXPECT_EQ(c.error().code, ErrorCode::kRefused);
  EXPECT_THAT(c.error().message, HasSubstr("no code for projector 'q'"));
}

TEST(Decode, SaysWhyNothingIsLit) {
  View off;
  off.gain = 0, off.full_well = 10000;
  const auto dark = decoded(off, code_of(off));
  ASSERT_FALSE(dark);
  EXPECT_EQ(dark.error().code, ErrorCode::kRefused);
  EXPECT_THAT(dark.error().message, HasSubstr("none is lit by it"));
  View bright;
  bright.gain = 9;
  const auto saturated = decoded(bright, code_of(bright));
  ASSERT_FALSE(saturated);
  EXPECT_THAT(saturated.error().message, HasSubstr("saturated"));
  EXPECT_THAT(saturated.error().message, HasSubstr("exposures_ms"));
}

TEST(Decode, PassesOnWhatThePhotosSay) {
  const View view;
  const Sequence sequence = code_of(view);
  const PhotoSource whole = view.photos(sequence, test_name());
  SilentProgress silent;
  const auto torn = decode_frames(
      sequence,
      [&](int i) -> Result<Photo> {
        if (i == 9) return error(ErrorCode::kBadFile, "photo 9 is torn");
        return whole(i);
      },
      "cam", "p", {}, silent);
  ASSERT_FALSE(torn);
  EXPECT_EQ(torn.error().message, "photo 9 is torn");
  const auto small = decode_frames(
      sequence,
      [&](int i) -> Result<Photo> {
        if (i == 9) return Photo{Image(8, 8, 1), Mask(8, 8, 1, 1), 0};
        return whole(i);
      },
      "cam", "p", {}, silent);
  ASSERT_FALSE(small);
  EXPECT_THAT(small.error().message, HasSubstr("8 x 8"));
}

TEST(Noise, OfPairsIsWhatWasPlanted) {
  View view;
  view.full_well = 3000, view.read_e = 12, view.gain = 0.5;
  view.bounce = [](double u, double) { return 0.3 + u / 1000; };
  const Sequence sequence = code_of(view);
  const auto plan = plan_code(sequence, "p");
  ASSERT_TRUE(plan);
  StoredPhotos photos;
  for (const Frame& frame : sequence.frames)
    photos[frame.index] = std::make_shared<const StoredPhoto>(*view.photos(sequence, test_name())(frame.index));
  const Levels levels = measure_levels(LevelPhotos(*plan, photos));

  // 36,000 pixels know a variance to a hundredth; trimming and the pairs' own structure cost a few more.
  for (double value : {0.05, 0.2, 0.5})
    EXPECT_NEAR(levels.noise.sigma(value), std::sqrt(value * 3000 + 144) / 3000,
                0.06 * std::sqrt(value * 3000 + 144) / 3000);
}

TEST(WriteCorrespondence, IsReadBackEqual) {
  fake::Scratch scratch("correspondence");
  View view;
  view.width = 80, view.height = 60, view.full_well = 10000;
  const Correspondence c = good(view, code_of(view));
  ASSERT_TRUE(write_correspondence(scratch / ".", c));
  const auto read = read_exr(scratch / "cam-p.exr", {"x", "y", "sigma", "reason"});
  ASSERT_TRUE(read) << read.error().message;
  for (std::size_t i = 0; i < c.x.data().size(); ++i) {
    const float* stored[3] = {&(*read)[0].data()[i], &(*read)[1].data()[i], &(*read)[2].data()[i]};
    const float* meant[3] = {&c.x.data()[i], &c.y.data()[i], &c.sigma.data()[i]};
    for (int k = 0; k < 3; ++k)
      EXPECT_TRUE(*stored[k] == *meant[k] || (std::isnan(*stored[k]) && std::isnan(*meant[k])));
    EXPECT_EQ((*read)[3].data()[i], c.reason.data()[i]);
  }
  const auto text = read_text(scratch / "reasons.json");
  ASSERT_TRUE(text);
  const auto names = nlohmann::json::parse(*text);
  EXPECT_EQ(names.at("0"), "accepted");
  EXPECT_EQ(names.size(), reason_names().size());
}

TEST(ExpectedWrong, IsTheShareOfNormalErrorsBeyondAPixel) {
  Correspondence c;
  c.sigma = Image(4, 1, 1, 0.5f), c.reason = Mask(4, 1, 1);
  c.reason.at(3, 0) = static_cast<std::uint8_t>(Reason::kPhase), c.sigma.at(3, 0) = std::nanf("");
  c.accepted = 3;
  EXPECT_NEAR(c.expected_wrong(), 0.0455, 1e-4);  // two sigma
  c.sigma.at(0, 0) = 1, c.sigma.at(1, 0) = 0.1f;
  EXPECT_NEAR(c.expected_wrong(), (0.3173 + 0.0455) / 3, 1e-4);
}

TEST(WriteReasonPicture, GivesEachReasonItsColour) {
  fake::Scratch scratch("reasons");
  Correspondence c;
  c.projector_resolution = {100, 80};
  const int reasons = static_cast<int>(reason_names().size());
  c.x = Image(reasons, 1, 1, 50.0f), c.y = Image(reasons, 1, 1, 20.0f), c.sigma = Image(reasons, 1, 1, 0.1f);
  c.reason = Mask(reasons, 1, 1);
  for (int i = 0; i < reasons; ++i) c.reason.at(i, 0) = static_cast<std::uint8_t>(i);
  ASSERT_TRUE(write_reason_picture(scratch / "reasons.png", c));
  const auto picture = read_image(scratch / "reasons.png");
  ASSERT_TRUE(picture);
  std::set<std::array<float, 3>> colours;
  for (int i = 0; i < reasons; ++i)
    colours.insert({picture->values.at(i, 0, 0), picture->values.at(i, 0, 1), picture->values.at(i, 0, 2)});
  EXPECT_EQ(colours.size(), reason_names().size());
}

}  // namespace
}  // namespace countershade::capture
