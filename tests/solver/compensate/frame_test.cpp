// Laws of a whole frame on the CPU: from pictures to pictures.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "solver/compensate/compensate.h"
#include "solver/compensate/frame_plan.h"
#include "tests/support/test_model.h"

namespace countershade::solver {
namespace {

float largest(const Radiosity& r) {
  return r.cwiseAbs().maxCoeff();
}

CompensateOptions exact_options(SolverChoice solver) {
  return {.solver = solver, .dither = false, .bits = 16};
}

TEST(Frame, CopiesBitForBitWhenNothingIsReflected) {
  Model model = test::room({.k = 0});
  std::vector<Picture> pictures = test::pictures(model, 20, 200);
  pictures[0].at(3, 4, 1) = 12345;  // not an 8-bit value
  const Compensated shown = compensate_frame(model, pictures, {});
  EXPECT_EQ(shown.report.used, SolverChoice::kCopy);
  for (int q = 0; q < 2; ++q) EXPECT_EQ(shown.pictures[q].data(), pictures[q].data());
}

TEST(Frame, CopyIsAChoice) {
  const Model model = test::room();
  const std::vector<Picture> pictures = test::pictures(model, 20, 200);
  const Compensated shown = compensate_frame(model, pictures, {.solver = SolverChoice::kCopy});
  for (int q = 0; q < 2; ++q) EXPECT_EQ(shown.pictures[q].data(), pictures[q].data());
}

TEST(Frame, DitherNeverMovesAPixelThatNeedsNoCorrection) {
  Model model = test::room({.k = 1e-9});
  const std::vector<Picture> pictures = test::pictures(model, 1, 255);
  const Compensated shown = compensate_frame(model, pictures, {.solver = SolverChoice::kClosedForm});
  for (int q = 0; q < 2; ++q) EXPECT_EQ(shown.pictures[q].data(), pictures[q].data());
}

// Whether all four pixels around p light the surface and are shared with the only overlap's other projector.
bool shared_around(const ProjectorPlan& plan, const PixelMap& map, int surface, const Eigen::Vector2f& p) {
  const Overlap& o = plan.overlaps[0];
  const Taps t = taps(p.x(), p.y(), plan.width, plan.height);
  for (const int i : t.index) {
    if (map.surface[i] != surface) return false;
    const int x = i % plan.width - o.x0, y = i / plan.width - o.y0;
    if (x < 0 || y < 0 || x >= o.width || y >= o.height) return false;
    if (o.pixel[static_cast<std::size_t>(y) * o.width + x][0] == kNowhere) return false;
  }
  return true;
}

TEST(Frame, TakesExactlyTheIndirectLightOutOfEveryPixel) {
  const Model model = test::room();
  const Compensator compensator(model);
  const std::vector<Picture> pictures = test::pictures(model, 120, 230);
  const CompensateOptions options = exact_options(SolverChoice::kClosedForm);
  FrameReport report;
  const Radiosity S = compensator.receiver_indirect(compensator.patch_target(pictures), options, report);
  const std::vector<Picture> out = compensator.remove(pictures, S, options, report);
  EXPECT_EQ(report.clipped_pixels, 0);
  int alone = 0, shared = 0;
  for (int q = 0; q < 2; ++q) {
    const ProjectorModel& p = model.projectors[q];
    const Image before = light_of_picture(p.response, pictures[q]), after = light_of_picture(p.response, out[q]);
    const ProjectorPlan& plan = compensator.plan().projectors[q];
    const ProjectorModel& other = model.projectors[1 - q];
    const Image other_before = light_of_picture(other.response, pictures[1 - q]);
    const Image other_after = light_of_picture(other.response, out[1 - q]);
    for (int y = 0; y < p.map.height; ++y)
      for (int x = 0; x < p.map.width; ++x) {
        const std::size_t i = static_cast<std::size_t>(y) * p.map.width + x;
        const int s = p.map.surface[i];
        if (s < 0) continue;
        Image chart(model.receivers_u(s), model.receivers_v(s), 3);
        const ChartPoint at{s, p.map.u[i], p.map.v[i]};
        const Eigen::Vector2f there = lighting_pixel(other, other.device.position(), model.screen, at);
        const bool overlap = there.x() != kNowhere;
        // At the crease and at the border of an overlap the other's share jumps between two of its pixels.
        if (overlap && !shared_around(compensator.plan().projectors[1 - q], other.map, s, there)) continue;
        (overlap ? shared : alone) += 1;
        for (int c = 0; c < 3; ++c) {
          for (int n = 0; n < chart.width() * chart.height(); ++n)
            chart.data()[3 * n + c] = S(model.receiver_offset(s) + n, c);
          double removed = sample_chart(p.gain[s], at.u, at.v, c) * (before.at(x, y, c) - after.at(x, y, c));
          if (overlap)
            removed +=
                sample_chart(other.gain[s], at.u, at.v, c) * (sample_bilinear(other_before, there.x(), there.y(), c) -
                                                              sample_bilinear(other_after, there.x(), there.y(), c));
          // 16-bit codes: 1e-5 of light. In overlaps the other's share is curved between its pixels.
          EXPECT_NEAR(removed, sample_chart(chart, at.u, at.v, c), overlap ? 4e-3 : 2e-5) << q << ' ' << x << ' ' << y;
        }
      }
    EXPECT_EQ(plan.overlaps.size(), 1u);
  }
  EXPECT_GT(alone, 500);
  EXPECT_GT(shared, 500);
}

// What the screen shows at the patches, by the model, minus what it should.
double mean_error(const Compensator& compensator, const Model& model, std::span<const Picture> shown,
                  const Radiosity& target) {
  const Radiosity B = forward(model, compensator.patch_target(shown).target);
  return (B - target).cwiseAbs().mean();
}

TEST(Frame, ShowsTheTargetAtThePatches) {
  const Model model = test::room({.grid = {{14, 10}, {12, 8}}});
  const Compensator compensator(model);
  const std::vector<Picture> pictures = test::pictures(model, 150, 230);
  const Radiosity target = compensator.patch_target(pictures).target;
  const Compensated out = compensator.frame(pictures, exact_options(SolverChoice::kAuto));
  const double before = mean_error(compensator, model, pictures, target);
  EXPECT_GT(before, .02);
  // Corners of the walls that no projector reaches, and the steps of reduced light at the pictures' borders, stay.
  EXPECT_LT(mean_error(compensator, model, out.pictures, target), before / 8);
}

TEST(Frame, ClipsInTheDarkAndSaysHowMuch) {
  const Model model = test::room();
  const Compensator compensator(model);
  const std::vector<Picture> pictures = test::pictures(model, 40, 250, true);
  const Radiosity target = compensator.patch_target(pictures).target;
  const Compensated out = compensator.frame(pictures, {});
  EXPECT_EQ(out.report.used, SolverChoice::kClipped);
  EXPECT_GT(out.report.gathers, 1);
  EXPECT_GT(out.report.clipped_pixels, .05);
  EXPECT_LT(out.report.clipped_pixels, .9);
  for (int q = 0; q < 2; ++q)
    for (std::size_t i = 0; i < out.pictures[q].data().size(); ++i)
      EXPECT_LE(out.pictures[q].data()[i], pictures[q].data()[i] + 257) << "a correction only takes light away";
  EXPECT_LT(mean_error(compensator, model, out.pictures, target), mean_error(compensator, model, pictures, target) / 2);
}

TEST(Frame, EqualInputsGiveEqualOutputs) {
  const Model model = test::room({.projectors = 3});
  const std::vector<Picture> pictures = test::pictures(model, 30, 240);
  const Compensated a = compensate_frame(model, pictures, {}), b = compensate_frame(model, pictures, {});
  for (int q = 0; q < 3; ++q) EXPECT_EQ(a.pictures[q].data(), b.pictures[q].data());
}

TEST(Frame, EightBitValuesAreWholeCodes) {
  const Model model = test::room();
  const Compensated out = compensate_frame(model, test::pictures(model, 100, 240), {});
  for (const Picture& picture : out.pictures)
    for (const std::uint16_t v : picture.data()) ASSERT_EQ(v % 257, 0);
}

TEST(Frame, DitherKeepsTheMeanThatRoundingLoses) {
  const Model model = test::room();
  const Compensator compensator(model);
  std::vector<Picture> pictures = test::pictures(model, 180, 181);
  const Compensated exact = compensator.frame(pictures, exact_options(SolverChoice::kClosedForm));
  const Compensated dithered = compensator.frame(pictures, {.solver = SolverChoice::kClosedForm});
  double difference = 0;
  const auto& a = exact.pictures[0].data();
  for (std::size_t i = 0; i < a.size(); ++i) difference += (dithered.pictures[0].data()[i] - a[i]) / 257. / a.size();
  EXPECT_NEAR(difference, 0, .02);  // 7869 values of sigma .29 / sqrt(7869) = .003, times 6
}

TEST(Frame, TakesEmptyPicturesAsBlack) {
  const Model model = test::room({.projectors = 3});
  std::vector<Picture> pictures = test::pictures(model, 100, 240);
  std::vector<Picture> black = pictures;
  black[1] = Picture(model.projectors[1].map.width, model.projectors[1].map.height, 3);
  pictures[1] = Picture();
  const Compensated a = compensate_frame(model, pictures, {}), b = compensate_frame(model, black, {});
  for (int q = 0; q < 3; ++q) EXPECT_EQ(a.pictures[q].data(), b.pictures[q].data());
  EXPECT_EQ(a.report.clipped_pixels, b.report.clipped_pixels);
}

TEST(Frame, LeavesPixelsThatLightNothingAlone) {
  Model model = test::room();
  auto& surface = model.projectors[0].map.surface;
  for (std::size_t i = 0; i < surface.size(); i += 5) surface[i] = -1;
  const std::vector<Picture> pictures = test::pictures(model, 100, 240);
  const Compensated out = compensate_frame(model, pictures, {});
  for (std::size_t i = 0; i < surface.size(); i += 5)
    for (int c = 0; c < 3; ++c) EXPECT_EQ(out.pictures[0].data()[3 * i + c], pictures[0].data()[3 * i + c]);
}

TEST(Frame, SurvivesTinyPicturesSinglePatchesAndGainsThatAreMissing) {
  Model model = test::room({.projectors = 3, .grid = {{1, 1}, {2, 1}}, .pictures = {{1, 1}, {2, 3}, {5, 1}}});
  model.projectors[1].gain[0].data().assign(model.projectors[1].gain[0].data().size(),
                                            std::numeric_limits<float>::quiet_NaN());
  model.projectors[2].gain[1].data().assign(model.projectors[2].gain[1].data().size(), 0.f);
  const Compensator compensator(model);
  const std::vector<Picture> pictures = test::pictures(model, 100, 240);
  EXPECT_TRUE(compensator.patch_target(pictures).target.allFinite());
  for (const SolverChoice solver : {SolverChoice::kAuto, SolverChoice::kClosedForm, SolverChoice::kClipped}) {
    FrameReport report;
    const Compensated out = compensator.frame(pictures, {.solver = solver});
    EXPECT_TRUE(
        compensator.receiver_indirect(compensator.patch_target(pictures), {.solver = solver}, report).allFinite());
    EXPECT_EQ(out.pictures[2].width(), 5);
  }
}

TEST(Frame, RefusesAPictureOfAnotherSize) {
  const Model model = test::room();
  std::vector<Picture> pictures = test::pictures(model, 100, 240);
  pictures[1] = Picture(10, 10, 3);
  EXPECT_THROW(compensate_frame(model, pictures, {}), Bug);
}

TEST(PatchTarget, OfWhiteAndBlackPicturesAreTheRange) {
  const Model model = test::room({.projectors = 3});
  const Compensator compensator(model);
  std::vector<Picture> white, black(3);
  for (const ProjectorModel& p : model.projectors) white.emplace_back(p.map.width, p.map.height, 3, 65535);
  const PatchTarget at_white = compensator.patch_target(white), at_black = compensator.patch_target(black);
  EXPECT_LT(largest(at_white.target - at_white.high), 1e-6f);  // float sums
  EXPECT_LT(largest(at_black.target - at_black.low), 1e-6f);
  EXPECT_TRUE((at_white.low.array() >= model.e.array()).all());
}

TEST(PatchTarget, IsTheMeanGainTimesLightOfAUniformPicture) {
  const Model model = test::room({.projectors = 1});
  const Compensator compensator(model);
  const ProjectorModel& p = model.projectors[0];
  const std::vector<Picture> grey = {Picture(p.map.width, p.map.height, 3, 30000)};
  const PatchTarget target = compensator.patch_target(grey);
  const float light = static_cast<float>(p.response.light(30000 / 65535.));
  EXPECT_LT(largest(target.target - model.e - light * (target.high - model.e)), 1e-6f);
}

TEST(PatchTarget, FollowsThePictureToThePatchThatItLights) {
  const Model model = test::room({.pictures = {{160, 110}, {150, 90}}});
  const Compensator compensator(model);
  for (int q = 0; q < 2; ++q) {
    const PixelMap& map = model.projectors[q].map;
    std::vector<Picture> pictures(2);
    pictures[q] = Picture(map.width, map.height, 3);
    const int patch = model.patches.index(q, 4, 2);  // lit by both
    std::vector<float> share(model.patches.size(), 0.f);
    for (int i = 0; i < map.width * map.height; ++i)
      if (map.surface[i] >= 0 && model.patches.index({map.surface[i], map.u[i], map.v[i]}) == patch)
        for (int c = 0; c < 3; ++c) pictures[q].data()[3 * i + c] = 65535;
    const PatchTarget target = compensator.patch_target(pictures);
    const Radiosity added = target.target - target.low;
    Eigen::Index row, column;
    added.maxCoeff(&row, &column);
    EXPECT_EQ(row, patch);
    // Blocks of 4 x 4 pixels spill over the border of a patch of about 25 x 20.
    EXPECT_GT(added.row(patch).sum(), .75f * (target.high - target.low).row(patch).sum() / 2);
  }
}

TEST(FramePlan, OverlapsMeetAtTheSamePointOfTheScreen) {
  const Model model = test::room({.projectors = 3, .pictures = {{160, 110}, {150, 90}, {120, 100}}});
  const FramePlan plan = make_frame_plan(model);
  int compared = 0;
  for (int q = 0; q < 3; ++q)
    for (const Overlap& overlap : plan.projectors[q].overlaps) {
      const PixelMap &map = model.projectors[q].map, &other = model.projectors[overlap.other].map;
      for (int y = 0; y < overlap.height; ++y)
        for (int x = 0; x < overlap.width; ++x) {
          const auto p = overlap.pixel[static_cast<std::size_t>(y) * overlap.width + x];
          if (p[0] == kNowhere) continue;
          const std::size_t i = static_cast<std::size_t>(y + overlap.y0) * map.width + x + overlap.x0;
          const std::size_t j = static_cast<std::size_t>(std::lround(p[1])) * other.width + std::lround(p[0]);
          if (other.surface[j] != map.surface[i]) continue;  // across the crease or the border
          ++compared;
          EXPECT_NEAR(map.u[i], other.u[j], .02);  // half a pixel of 1/100 of a wall, slanted
          EXPECT_NEAR(map.v[i], other.v[j], .02);
        }
    }
  EXPECT_GT(compared, 10000);
}

TEST(FramePlan, NobodyLightsAWallFromBehindOrThroughAnother) {
  const Model model = test::room();
  ProjectorModel p = model.projectors[0];
  const ChartPoint centre{0, .6, .5};
  const Eigen::Vector3d x = model.screen.point(centre), n = model.screen.normal(centre);
  EXPECT_NE(lighting_pixel(p, p.device.position(), model.screen, centre).x(), kNowhere);
  ProjectorModel blocked = p;
  std::fill(blocked.map.surface.begin(), blocked.map.surface.end(), 1);
  EXPECT_EQ(lighting_pixel(blocked, blocked.device.position(), model.screen, centre).x(), kNowhere);
  p.device.device_from_world = look_at(x - 2 * n, x, {0, 1, 0});
  EXPECT_EQ(lighting_pixel(p, p.device.position(), model.screen, centre).x(), kNowhere);
}

TEST(EncodeTable, IsTheResponseToATenthOfASixteenBitCode) {
  for (const char* name : {"gamma:2.2", "srgb", "linear", "gamma:1.8"}) {
    const Response response = *Response::parse(name);
    const EncodeTable table(response);
    for (int n = 0; n <= 4000; ++n) {
      const float x = static_cast<float>(std::pow(n / 4000., 3));
      // Below 2^-32 the table goes straight to 0: 3 codes of 65535 at gamma 2.2.
      EXPECT_NEAR(table(x), response.encode(x), x < 0x1p-32f ? 5e-5 : 1.5e-6) << name << ' ' << x;
    }
    EXPECT_EQ(table(0), 0);
    EXPECT_EQ(table(-1), 0);
    EXPECT_EQ(table(2), 1);
  }
}

TEST(Dither, IsEvenAndShortOfHalfACode) {
  double sum = 0;
  std::array<int, 8> bins{};
  for (int y = 0; y < 90; ++y)
    for (int x = 0; x < 110; ++x)
      for (int c = 0; c < 3; ++c) {
        const float d = dither(x, y, c);
        ASSERT_LT(std::abs(d), .4985f);
        sum += d;
        ++bins[static_cast<std::size_t>((d + .5f) * 8)];
      }
  EXPECT_NEAR(sum / 29700, 0, .002);  // its values are spread more evenly than random ones
  for (const int n : bins) EXPECT_NEAR(n / 29700., .125, .005);
}

}  // namespace
}  // namespace countershade::solver
