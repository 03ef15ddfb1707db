#include "solver/fit/lens/ladder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numeric>

#include "solver/fit/lens/lens_parts.h"
#include "solver/fit/lens/views.h"
#include "tests/solver/fit/lens/seen_boards.h"

namespace countershade::solver {
namespace {

using ::testing::HasSubstr;

std::vector<int> each_its_own(const SeenBoards& seen) {
  std::vector<int> group(seen.data.views.size());
  std::iota(group.begin(), group.end(), 0);
  return group;
}

std::string chosen(const SeenBoards& seen) {
  SilentProgress progress;
  const LensChoice choice = choose_lens(seen.data, each_its_own(seen), {}, progress).value();
  EXPECT_EQ(choice.rungs.size(), 5);
  for (const LensRung& rung : choice.rungs) EXPECT_TRUE(rung.fitted) << rung.note;
  return choice.rung().model;
}

Lens lens_of(const std::string& model, std::vector<double> intrinsics) {
  return Lens::make(model, std::move(intrinsics), 640, 480).value();
}

TEST(LensLadder, PinholeForAPinhole) {
  EXPECT_EQ(chosen({"ladder pinhole", 14, lens_of("LENSMODEL_PINHOLE", {520, 524, 313, 246})}), "LENSMODEL_PINHOLE");
}

TEST(LensLadder, FourForRadialOfSecondOrder) {
  EXPECT_EQ(chosen({"ladder 4", 14, lens_of("LENSMODEL_OPENCV4", {520, 524, 313, 246, -0.21, 0.09, 0.001, -0.002})}),
            "LENSMODEL_OPENCV4");
}

TEST(LensLadder, FiveForABrownLensAndNoMore) {
  EXPECT_EQ(chosen({"ladder 5", 25,
                    lens_of("LENSMODEL_OPENCV5", {420, 424, 313, 246, -0.21, 0.06, 0.0011, -0.0007, 0.06}), 0.7, 0.4}),
            "LENSMODEL_OPENCV5");
}

TEST(LensLadder, SplineForALensThatNoneOfTheOthersDescribes) {
  // A smooth wave of about a pixel over the picture, on top of a pinhole.
  const Lens plain = lens_of("LENSMODEL_PINHOLE", {520, 520, 319.5, 239.5});
  const std::string model = splined_model(plain, 9);
  std::vector<double> intrinsics(lens_parts::parameters(model));
  const double core[] = {520, 520, 319.5, 239.5};
  std::copy_n(core, 4, intrinsics.begin());
  Random random(hash_name("wavy"));
  for (std::size_t i = 4; i < intrinsics.size(); ++i) intrinsics[i] = 0.006 * random.normal();
  EXPECT_THAT(chosen({"ladder spline", 40, lens_of(model, intrinsics), 0.7, 0.8}), HasSubstr("SPLINED_STEREOGRAPHIC"));
}

TEST(LensLadder, AViewThatCannotBeHeldOutJudgesNothing) {
  SeenBoards seen("poor view", 10);
  for (int i = 6; i < 63; ++i) seen.data.views[4][i] = {NAN, NAN};  // six points of one row hold no pose by halves
  seen.data.views[4][9] = seen.lens.project(seen.poses[4] * seen.data.board.point(9));
  seen.data.views[4][30] = seen.lens.project(seen.poses[4] * seen.data.board.point(30));
  SilentProgress progress;
  const LensChoice choice = choose_lens(seen.data, each_its_own(seen), {}, progress).value();
  EXPECT_THAT(choice.rung().model, HasSubstr("OPENCV"));
  EXPECT_THAT(choice.notes, ::testing::Contains(HasSubstr("1 views have too few points to be held out")));
}

TEST(LensLadder, HeldOutErrorOfTheTrueLensIsTheNoise) {
  const SeenBoards seen("held out", 30);
  double mean = 0;
  for (const BoardView& view : seen.data.views)
    mean += held_out_square(seen.data, view, seen.lens, std::vector<bool>(63, true)) / 30;
  // A pose from 31 points adds about 6 / 62 of the variance; 3780 coordinates: relative sigma .023, as root .012.
  EXPECT_NEAR(std::sqrt(mean), 0.2 * std::sqrt(1 + 6.0 / 62), 0.2 * 3.3 * 0.013);
}

TEST(LensLadder, FTestIsTheTextbooks) {
  EXPECT_NEAR(f_test_p(4.0, 3, 20), 0.022076999662, 1e-10);  // scipy.stats.f.sf
  EXPECT_NEAR(f_test_p(1.7, 1, 1000), 0.192588034328, 1e-10);
  EXPECT_NEAR(f_test_p(0.3, 5, 7), 0.898155764328, 1e-10);
  EXPECT_EQ(f_test_p(0, 5, 7), 1);
}

TEST(LensViews, CopiesAreOneView) {
  SeenBoards seen("copies", 6);
  seen.data.views.push_back(seen.data.views[2]);
  for (Eigen::Vector2d& q : seen.data.views.back()) q += Eigen::Vector2d(1, 2);
  EXPECT_EQ(group_alike(seen.data), (std::vector<int>{0, 1, 2, 3, 4, 5, 2}));
}

TEST(LensViews, FewerThanFourThatDifferAreRefusedWithTheReason) {
  EXPECT_TRUE(check_enough({0, 1, 2, 3}));
  const auto few = check_enough({0, 1, 0, 1, 1});
  ASSERT_FALSE(few);
  EXPECT_EQ(few.error().code, ErrorCode::kRefused);
  EXPECT_THAT(few.error().message, HasSubstr("2 views of the board that differ (of 5"));
  EXPECT_THAT(few.error().message, HasSubstr("at least 4 are needed"));
  EXPECT_THAT(few.error().message, HasSubstr("add 2 views"));
}

TEST(LensViews, FacingBoardsAreRefusedWithTheViewToAdd) {
  const SeenBoards seen("facing", 10, brown_lens(), 0.12);
  const LensFit fit = fit_lens(seen.data, {}).value();
  const ViewSummary views = summarise(seen.data, fit);
  const auto held = check_held(LensUncertainty(seen.data, fit), views);
  ASSERT_FALSE(held);
  EXPECT_THAT(held.error().message, HasSubstr("at most 1 %"));
  EXPECT_THAT(held.error().message, HasSubstr("tilted by about 30 to 45 degrees"));
  const SeenBoards tilted("facing", 10);
  const LensFit good = fit_lens(tilted.data, {}).value();
  EXPECT_TRUE(check_held(LensUncertainty(tilted.data, good), summarise(tilted.data, good)));
}

TEST(LensViews, TiltAndDistanceAreTheBoards) {
  const SeenBoards seen("tilts", 6);
  LensFit fit;
  fit.lens = seen.lens;
  fit.camera_from_board = seen.poses;
  const ViewSummary views = summarise(seen.data, fit);
  for (int v = 0; v < 6; ++v) {
    const Eigen::Vector3d middle = seen.poses[v] * (seen.data.board.point(62) / 2);
    const double cosine = std::abs(seen.poses[v].rotation.col(2).dot(middle.normalized()));
    EXPECT_NEAR(std::cos(views.tilt_deg[v] * M_PI / 180), cosine, 1e-9);
    EXPECT_NEAR(views.distance_m[v], middle.norm(), 1e-12);
  }
}

TEST(LensViews, AdviceNamesTheEmptyCorner) {
  SeenBoards seen("corner", 40);
  for (BoardView& view : seen.data.views)
    for (Eigen::Vector2d& q : view)
      if (q.x() > 450 && q.y() > 300) q = {NAN, NAN};
  LensFit fit;
  fit.lens = seen.lens;
  fit.camera_from_board = seen.poses;
  const ViewSummary views = summarise(seen.data, fit);
  EXPECT_THAT(views.advice, ::testing::Contains(HasSubstr("in the lower right corner")));
  EXPECT_THAT(views.advice, ::testing::Not(::testing::Contains(HasSubstr("left edge"))));
  EXPECT_LT(views.covered, 0.95);
  EXPECT_GT(views.covered, 0.6);
}

}  // namespace
}  // namespace countershade::solver
