#include <gmock/gmock.h>

#include <cmath>
#include <numbers>

#include "capture/pattern/plan.h"
#include "capture/pattern/read/phase.h"
#include "tests/capture/fake_view.h"

namespace countershade::capture {
namespace {

using fake::Score;
using fake::test_name;
using fake::View;
using testing::HasSubstr;

Correspondence good(const View& view, const std::string& code) {
  SilentProgress silent;
  const Sequence sequence = fake::sequence_of(view, code);
  auto c = decode_frames(sequence, view.photos(sequence, test_name() + code), "cam", "p", {}, silent);
  EXPECT_TRUE(c) << c.error().message;
  return *std::move(c);
}

View large() {
  View view;
  view.width = 300, view.height = 200, view.projector_width = 1920, view.projector_height = 400;
  view.map = [](double u, double v) {
    return std::pair(1180 + 1.33 * u - 0.11 * v + 0.0006 * u * v, 99 + 0.07 * u + 1.21 * v - 0.0004 * u * u);
  };
  view.full_well = 10000, view.blur_px = 0.6;
  return view;
}

class EveryCode : public testing::TestWithParam<std::string> {};
INSTANTIATE_TEST_SUITE_P(Codes, EveryCode,
                         testing::Values("gray", "xor-02", "xor-04", "micro-phase", "embedded", "phase"),
                         [](const auto& info) {
                           std::string name = info.param;
                           std::erase(name, '-');
                           return name;
                         });

TEST_P(EveryCode, GivesTheTruth) {
  const View view = large();
  const Correspondence c = good(view, GetParam());
  const Score s = fake::score(view, c);
  EXPECT_GT(s.coverage(), 0.98);
  EXPECT_LT(s.wrong, 1e-4);
  // Bits are rounded to pixels, those combined with the finest one hardest; sinusoids are not.
  EXPECT_LT(s.rms, GetParam() == "xor-02" ? 0.25 : GetParam() == "phase" ? 0.08 : 0.05);
  // sigma is at most three times the error where readings are rounded, 1.6 times where they are not, and never much
  // less.
  const bool is_wave = GetParam() == "micro-phase" || GetParam() == "embedded" || GetParam() == "phase";
  EXPECT_GT(s.z2, is_wave ? 0.4 : 0.11);
  EXPECT_LT(s.z2, 2);
}

// Light by way of the room that is stronger than the direct light, made of the far half of the picture: Gray code reads
// its coarse stripes from it, narrow stripes and short sinusoids average out there.
TEST_P(EveryCode, IsNeverWrongUnderIndirectLight) {
  for (const double bounce : {0.4, 1.5}) {
    View view = large();
    view.gain = 0.6 / (1 + bounce);
    view.bounce = [bounce](double, double) { return bounce; };
    SilentProgress silent;
    const Sequence sequence = fake::sequence_of(view, GetParam());
    const auto c = decode_frames(sequence, view.photos(sequence, test_name()), "cam", "p", {}, silent);
    if (!c) {
      EXPECT_TRUE(bounce > 1 && GetParam() == "gray") << c.error().message;
      continue;
    }
    const Score s = fake::score(view, *c);
    EXPECT_LT(s.wrong, 1e-4) << bounce;
    // 14 frames hold less light than 44.
    EXPECT_GT(s.coverage(), GetParam() == "xor-04" ? 0.96 : GetParam() == "micro-phase" ? 0.9 : 0) << bounce;
  }
}

TEST(MicroPhase, NeedsNoKnownResponse) {
  for (const double exponent : {1.6, 2.0, 2.5, 3.0}) {
    View view = large();
    view.exponent = exponent;
    const Score s = fake::score(view, good(view, "micro-phase"));
    EXPECT_GT(s.coverage(), 0.98) << exponent;
    EXPECT_LT(s.rms, 0.06) << exponent;
    EXPECT_LT(s.z2, 2) << exponent;  // harmonics left in would pull pixels by .1 px, unpredicted
  }
}

TEST(MicroPhase, ReadsItsNoiseFromItsOwnResiduals) {
  View view = large();
  view.blur_px = 1.2;  // across projector pixels, whose steps would be residuals, too
  const Sequence sequence = fake::sequence_of(view, "micro-phase");
  const auto plan = plan_code(sequence, "p");
  ASSERT_TRUE(plan);
  const PhotoSource photos = view.photos(sequence, test_name());
  WavePhotos waves;
  for (const WaveFrame& frame : plan->axis[1].waves) {
    const auto photo = photos(frame.index);
    waves.light.push_back(luminance_mean(photo->value));
  }
  waves.skip = Mask(view.width, view.height, 1);
  const WaveModel model = fit_wave_model(plan->axis[1], waves, nullptr, {});
  // The made-for exponent leaves no harmonics but those that 8 bits and the half-lit pixel make.
  EXPECT_NEAR(model.h2, 0, 0.01);
  EXPECT_NEAR(model.h3, 0, 0.01);
  // Three taps 1.5 sigma apart have .886 of the point spread's variance, rows are 1.21 px apart, and what lies between
  // two projector pixels is interpolated: .886 (1.2 * 1.21)^2 + 1/6.
  EXPECT_NEAR(model.blur, 2.03, 0.1);
  for (const double light : {0.1, 0.4}) {
    const double expected = std::sqrt(light * view.full_well + view.read_e * view.read_e) / view.full_well;
    EXPECT_NEAR(model.noise.sigma(light), expected, 0.1 * expected) << light;
  }
}

// What read_phase says of a view, before neighbours are asked.
struct PixelsAlone {
  double certain = 0, wrong = 0;  // of the lit pixels: accepted; of those: elsewhere by more than 4 px
  double doubtful = 0, held = 0;  // of the lit pixels: two ways as likely; of those: one of the two is right
  double z2 = 0;                  // of the certain and right ones: mean squared error over predicted variance
};
PixelsAlone read_alone(const View& view, const Sequence& sequence) {
  const auto plan = plan_code(sequence, "p");
  const PhotoSource photos = view.photos(sequence, test_name());
  const AxisCode& code = plan->axis[0];
  WavePhotos waves;
  for (const WaveFrame& frame : code.waves) waves.light.push_back(luminance_mean(photos(frame.index)->value));
  waves.skip = Mask(view.width, view.height, 1);
  const WaveModel model = fit_wave_model(code, waves, nullptr, {});
  const PhaseReading read = read_phase(code, waves, model, nullptr, {});
  PixelsAlone alone;
  double lit = 0, right = 0;
  for (int v = 0; v < view.height; ++v)
    for (int u = 0; u < view.width; ++u) {
      const auto [x, y] = view.truth(u, v);
      if (!view.lit(x, y)) continue;
      const double off = std::abs(read.reading.q.at(u, v) - x), other = std::abs(read.other.at(u, v) - x);
      const auto why = static_cast<Reason>(read.reading.reason.at(u, v));
      lit += 1;
      alone.certain += why == Reason::kAccepted, alone.doubtful += why == Reason::kUncertainBit;
      if (why == Reason::kUncertainBit) alone.held += off < 4 || other < 4;
      if (why != Reason::kAccepted) continue;
      alone.wrong += off > 4;
      if (off <= 4) right += 1, alone.z2 += std::pow(off / read.reading.sigma.at(u, v), 2);
    }
  alone.wrong /= std::max(1.0, alone.certain), alone.held /= std::max(1.0, alone.doubtful);
  alone.z2 /= std::max(1.0, right);
  alone.certain /= lit, alone.doubtful /= lit;
  return alone;
}

// Weak light: what is certain is right, as often as the odds say, and what is not is one of two.
TEST(MicroPhase, DoubtsWhereTwoWaysToUnwrapAreAsLikely) {
  View view = large();
  view.gain = 0.09;
  const PixelsAlone alone = read_alone(view, fake::sequence_of(view, "micro-phase"));
  EXPECT_GT(alone.doubtful, 0.05);
  EXPECT_GT(alone.certain, 0.2);
  EXPECT_LT(alone.wrong, 2e-3);
  EXPECT_GT(alone.held, 0.85);
}

// A response far from the patterns' is part of every step: of the phase, the ways to unwrap it and the fit. Blur takes
// more off its harmonics than off the sinusoid.
TEST(MicroPhase, KnowsHarmonicsInEveryStep) {
  View view = large();
  view.exponent = 5, view.blur_px = 1.6, view.gain = 0.5, view.full_well = 40000;
  view.albedo = [](double, double) { return 0.6; };  // a slope of it would pull blurred pixels to its brighter side
  const PixelsAlone alone = read_alone(view, fake::sequence_of(view, "micro-phase"));
  EXPECT_GT(alone.certain, 0.99);
  EXPECT_LT(alone.wrong, 1e-4);
  EXPECT_GT(alone.z2, 0.6);
  EXPECT_LT(alone.z2, 1.4);
}

// ... and in weak light, where the ways to unwrap are close.
TEST(MicroPhase, KnowsHarmonicsInWeakLight) {
  View view = large();
  view.exponent = 5, view.gain = 0.15;
  view.albedo = [](double, double) { return 0.6; };
  const PixelsAlone alone = read_alone(view, fake::sequence_of(view, "micro-phase"));
  EXPECT_GT(alone.certain, 0.84);
  EXPECT_LT(alone.wrong, 1e-3);
  EXPECT_GT(alone.held, 0.97);
}

// At the border of the picture a pixel receives the light of one side of it, and reads that side: sigma knows.
TEST(MicroPhase, SigmaKnowsTheBorderOfThePicture) {
  View view = large();
  view.map = [](double u, double v) { return std::pair(-40.4 + 2.7 * u + 0.3 * v, -30.3 + 0.2 * u + 2.9 * v); };
  view.projector_width = 600;
  const Correspondence c = good(view, "micro-phase");
  double z2[2] = {0, 0}, n[2] = {0, 0};  // inside, at the border
  for (int v = 1; v + 1 < view.height; ++v)
    for (int u = 1; u + 1 < view.width; ++u) {
      const auto [x, y] = view.truth(u, v);
      if (c.reason.at(u, v) || !view.lit(x, y)) continue;
      bool border = false;
      for (const auto& [du, dv] : {std::pair(1, 0), {-1, 0}, {0, 1}, {0, -1}}) {
        const auto [nx, ny] = view.truth(u + du, v + dv);
        border = border || !view.lit(nx, ny);
      }
      const double squares = std::pow(c.x.at(u, v) - x, 2) + std::pow(c.y.at(u, v) - y, 2);
      z2[border] += squares / 2 / std::pow(c.sigma.at(u, v), 2), n[border] += 1;
    }
  ASSERT_GT(n[1], 150);
  EXPECT_GT(z2[0] / n[0], 0.4);
  EXPECT_LT(z2[0] / n[0], 1.5);
  EXPECT_GT(z2[1] / n[1], 0.2);  // joined with a plane that is trusted to .1 px only
  EXPECT_LT(z2[1] / n[1], 2.5);  // what is a tenth darker than its neighbours may be shading, and counts as inside
}

// A wall that is seen steeply beside one that is not.
TEST(MicroPhase, CreasesKeepTheirPixels) {
  View view = large();
  view.map = [](double u, double v) {
    const double below = std::max(0.0, v - 90.3 - 0.11 * u);
    return std::pair(900 + 0.8 * u + 0.1 * v + 2.7 * below, 20 + 0.1 * u + 0.6 * v + 5.6 * below);
  };
  const Correspondence c = good(view, "micro-phase");
  double lit = 0, accepted = 0;
  for (int u = 0; u < view.width; ++u)
    for (int k = -3; k <= 3; ++k) {
      const int v = static_cast<int>(std::lround(90.3 + 0.11 * u)) + k;
      const auto [x, y] = view.truth(u, v);
      if (view.lit(x, y)) lit += 1, accepted += c.reason.at(u, v) == 0;
    }
  EXPECT_GT(accepted / lit, 0.97);
}

TEST(MicroPhase, TwoPlacesInOnePixelContradictEachOther) {
  View view = large();
  // A line of pixels sees two places of the projector at once.
  View other = view;
  other.map = [map = view.map](double u, double v) {
    const auto [x, y] = map(u, v);
    return std::pair(x - 317.0, y);
  };
  const Sequence sequence = fake::sequence_of(view, "micro-phase");
  const PhotoSource one = view.photos(sequence, "one"), two = other.photos(sequence, "two");
  const PhotoSource mixed = [&](int index) -> Result<Photo> {
    auto a = one(index), b = two(index);
    for (int y = 0; y < view.height; ++y)
      for (int x = 200; x < 203; ++x) a->value.at(x, y) = 0.5f * (a->value.at(x, y) + b->value.at(x, y));
    return a;
  };
  SilentProgress silent;
  const auto c = decode_frames(sequence, mixed, "cam", "p", {}, silent);
  ASSERT_TRUE(c);
  int accepted = 0, named = 0;
  for (int y = 0; y < view.height; ++y) {
    accepted += c->reason.at(201, y) == 0;
    named += c->reason.at(201, y) == static_cast<std::uint8_t>(Reason::kPhase);
  }
  EXPECT_LT(accepted, 0.05 * view.height);
  EXPECT_GT(named, 0.7 * view.height);
}

// The closest that the light of two columns, a turn or more apart, comes in the space of the frames: noise of half of
// it would be read wrongly. The constants of codes.cpp were searched for this.
TEST(Codes, MicroPhaseTellsColumnsApart) {
  for (const auto& [length, least] : {std::pair(1280, 0.47), {1920, 0.47}, {2048, 0.47}, {3840, 0.8}, {4096, 0.8}}) {
    ProjectorSpec spec;
    spec.id = "p", spec.resolution = {length, 32};
    const auto roles = code_roles("micro-phase", spec);
    ASSERT_TRUE(roles);
    std::vector<const Role*> waves;
    for (const Role& r : *roles)
      if (r.axis == "x") waves.push_back(&r);
    EXPECT_EQ(waves.size(), length > 2048 ? 9u : 7u);
    double closest = 1e9;
    for (int lag = 8; lag < length; ++lag) {
      double sum = 0;  // mean over columns of the squared distance, in amplitudes
      for (const Role* r : waves) sum += 2 * std::pow(std::sin(std::numbers::pi * lag / r->period_px), 2);
      closest = std::min(closest, std::sqrt(sum));
    }
    EXPECT_GT(closest, least) << length;
  }
}

TEST(Codes, StripesOfXorCodesAreNarrow) {
  ProjectorSpec spec;
  spec.id = "p", spec.resolution = {1280, 800};
  for (const auto& [code, widest] : {std::pair("xor-02", 2), {"xor-04", 4}}) {
    const auto roles = code_roles(code, spec);
    ASSERT_TRUE(roles);
    for (const Role& r : *roles) {
      const auto picture = render_role(r, "p", 1280, 800);
      ASSERT_TRUE(picture);
      const bool along_x = r.axis == "x";
      int run = 0, longest = 0;
      for (int i = 1; i < (along_x ? 1280 : 800); ++i) {
        const bool same =
            along_x ? picture->at(i, 0) == picture->at(i - 1, 0) : picture->at(0, i) == picture->at(0, i - 1);
        run = same ? run + 1 : 0;
        longest = std::max(longest, run + 1);
      }
      EXPECT_LE(longest, widest) << r.name();
    }
  }
}

TEST(Codes, UnknownNameGivesTheNearest) {
  ProjectorSpec spec;
  spec.resolution = {100, 80};
  const auto roles = code_roles("xor-4", spec);
  ASSERT_FALSE(roles);
  EXPECT_THAT(roles.error().message, HasSubstr("nearest valid name is 'xor-04'"));
}

Sequence waves_of(const std::vector<std::pair<double, double>>& period_and_shift) {
  Sequence s;
  s.projectors = {{"p", {1920, 1080}}};
  Role r;
  r.kind = "phase", r.projector = "p", r.steps = 1;
  for (const auto& [period, shift] : period_and_shift)
    r.period_px = period, r.shift_rad = shift, s.frames.push_back({static_cast<int>(s.frames.size()), r});
  return s;
}

TEST(PlanCode, SinusoidsThatCannotBeUnwrappedAreRefused) {
  const auto two = plan_code(waves_of({{16, 0}, {16, 1}, {20, 0}, {20, 1}}), "p");
  ASSERT_FALSE(two);
  EXPECT_THAT(two.error().message, HasSubstr("three different shifts"));
  const auto again = plan_code(waves_of({{16, 0}, {16, 2}, {16, 4}, {20, 0}, {20, 1}}), "p");
  ASSERT_FALSE(again);
  EXPECT_THAT(again.error().message, HasSubstr("repeat together within 1920 px"));
  const auto lonely = plan_code(waves_of({{16, 0}, {16, 2}, {16, 4}, {100, 0}}), "p");
  ASSERT_FALSE(lonely);
  EXPECT_THAT(lonely.error().message, HasSubstr("period 100 px need three"));
  EXPECT_TRUE(plan_code(waves_of({{16, 0}, {16, 2}, {16, 4}, {22.1, 0}, {22.1, 1.5}, {23.3, 0}, {23.3, 1.5}}), "p"));
}

TEST(PlanCode, ABitWithoutItsBaseIsNamed) {
  View view;
  Sequence sequence = fake::sequence_of(view, "xor-04");
  std::erase_if(sequence.frames,
                [](const Frame& f) { return f.role.kind == "gray" && f.role.axis == "y" && f.role.bit == 1; });
  const auto plan = plan_code(sequence, "p");
  ASSERT_FALSE(plan);
  EXPECT_THAT(plan.error().message, HasSubstr("bit 1 of axis y lacks its plain frame"));
}

// Somebody's scanner: Gray code of coarse cells, and four steps of one sinusoid that refine it.
TEST(Phase, RefinesAGrayCode) {
  View view;
  view.full_well = 10000, view.blur_px = 0.6;
  Sequence sequence = fake::code_of(view, {.cell_px = 8});
  const double gray = fake::score(
                          view,
                          *[&] {
                            SilentProgress silent;
                            return decode_frames(sequence, view.photos(sequence, test_name()), "cam", "p", {}, silent);
                          }())
                          .rms;
  Role r;
  r.kind = "phase", r.projector = "p", r.steps = 4, r.period_px = 32;
  for (const char* axis : {"x", "y"})
    for (r.step = 0; r.step < 4; ++r.step)
      r.axis = axis, sequence.frames.push_back({static_cast<int>(sequence.frames.size()) + 3, r});
  SilentProgress silent;
  const auto c = decode_frames(sequence, view.photos(sequence, test_name()), "cam", "p", {}, silent);
  ASSERT_TRUE(c) << c.error().message;
  const Score s = fake::score(view, *c);
  EXPECT_LT(s.rms, 0.4 * gray);
  EXPECT_LT(s.wrong, 1e-3);
}

}  // namespace
}  // namespace countershade::capture
