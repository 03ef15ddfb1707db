#include "solver/fit/lens/lens_fit.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <fstream>

#include "calib/file/file.h"
#include "solver/fit/lens/lens_parts.h"
#include "solver/fit/lens/model_file.h"
#include "solver/fit/lens/uncertainty.h"
#include "tests/solver/fit/lens/seen_boards.h"
#include "tests/support/cli.h"

namespace countershade::solver {
namespace {

using countershade::testing::TemporaryFolder;
using ::testing::HasSubstr;

TEST(LensFit, WithoutNoiseTheLensIsFoundExactly) {
  SeenBoards seen("exact", 8);
  seen.sigma_px = 0;
  Random random(1);
  seen.see(random);
  const LensFit fit = fit_lens(seen.data, {}).value();
  EXPECT_LT(fit.rms_px, 1e-6);
  for (const Eigen::Vector2d& q : pixel_grid(640, 480, 5, 5)) {
    const Eigen::Vector3d x = seen.lens.unproject(q);
    EXPECT_LT((seen_through_boards(seen.poses, fit.camera_from_board, fit.lens, x, true) - q).norm(), 1e-4);
  }
}

TEST(LensFit, RecoversLensAndNoiseWithinItsSigma) {
  const SeenBoards seen("recovers", 15);
  const LensFit fit = fit_lens(seen.data, {}).value();
  const LensUncertainty uncertainty(seen.data, fit);
  const int n = uncertainty.lens_states();
  ASSERT_EQ(n, 9);
  Eigen::VectorXd off(n);
  for (int i = 0; i < n; ++i) off[i] = fit.lens.intrinsics()[i] - seen.lens.intrinsics()[i];
  const Eigen::MatrixXd V = uncertainty.state_covariance().topLeftCorner(n, n);
  EXPECT_LT(off.dot(V.ldlt().solve(off)), 27.9);  // chi2 with 9 degrees of freedom exceeds it once in 1000
  // 1890 coordinates: the standard deviation of a standard deviation is .2 / sqrt(2 * 1791) = .0033.
  EXPECT_NEAR(fit.sigma_px, 0.2, 3.3 * 0.0033);
  EXPECT_NEAR(fit.freedom, fit.observations - 9 - 6 * 15, 0.5);
}

TEST(LensFit, ResidualIsModelMinusSeen) {
  const SeenBoards seen("residual", 5);
  const LensFit fit = fit_lens(seen.data, {}).value();
  for (int i = 0; i < seen.data.board.points(); i += 7) {
    const Eigen::Vector2d q = fit.lens.project(fit.camera_from_board[2] * seen.data.board.point(i));
    EXPECT_LT((q - seen.data.views[2][i] - fit.residual_px[2][i]).norm(), 1e-6);
  }
}

TEST(LensFit, FindsGrossErrorsAndOnlyThose) {
  SeenBoards seen("outliers", 10);
  for (int k = 0; k < 12; ++k) seen.data.views[k % 10][5 * k] += Eigen::Vector2d(4 + k, -3);
  const LensFit blind = fit_lens(seen.data, {}).value();
  const LensFit fit = fit_lens(seen.data, {.model = "LENSMODEL_OPENCV5", .find_outliers = true}).value();
  for (int k = 0; k < 12; ++k) EXPECT_FALSE(fit.used[k % 10][5 * k]) << k;
  EXPECT_LE(fit.outliers, 13);  // of 618 good points .02 are expected beyond the bound
  EXPECT_GT(blind.sigma_px, 0.6);
  EXPECT_NEAR(fit.sigma_px, 0.2, 0.02);
}

TEST(LensFit, PoseOfAKnownLensIsTheBoards) {
  SeenBoards seen("pose", 4);
  seen.sigma_px = 0;
  Random random(1);
  seen.see(random);
  for (std::size_t v = 0; v < seen.poses.size(); ++v) {
    const Pose pose = fit_pose(seen.data, seen.data.views[v], seen.lens, {}).value();
    EXPECT_LT((pose.rotation - seen.poses[v].rotation).norm(), 1e-6);
    EXPECT_LT((pose.translation - seen.poses[v].translation).norm(), 1e-7);
  }
  EXPECT_FALSE(fit_pose(seen.data, BoardView(63, {NAN, NAN}), seen.lens, {}));
}

TEST(LensFit, TooFewViewsAreRefused) {
  const SeenBoards seen("few", 1);
  const auto fit = fit_lens(seen.data, {});
  ASSERT_FALSE(fit);
  EXPECT_EQ(fit.error().code, ErrorCode::kRefused);
  EXPECT_THAT(fit.error().message, HasSubstr("1 views of the board; a lens needs at least 2"));
}

TEST(LensFit, SplineBeginsAsTheLensIsAndCoversThePicture) {
  const SeenBoards seen("spline", 12);
  const LensFit brown = fit_lens(seen.data, {}).value();
  const LensFit spline = fit_lens(seen.data, {.model = splined_model(brown.lens, 9), .start = &brown}).value();
  EXPECT_LT(spline.rms_px, brown.rms_px);  // 148 parameters against 9
  EXPECT_GT(spline.rms_px, 0.8 * brown.rms_px);
  for (const Eigen::Vector2d& q : pixel_grid(640, 480, 3, 3))
    EXPECT_LT((spline.lens.project(spline.lens.unproject(q)) - q).norm(), 1e-4);
}

// N = J^T J of mrcal against differences of our own projection.
TEST(LensProblem, NormalMatrixIsThatOfFiniteDifferences) {
  const SeenBoards seen("normal", 3);
  const LensFit fit = fit_lens(seen.data, {}).value();
  const lens_parts::Linearisation l = lens_parts::linearise(lens_parts::problem_of(seen.data, fit));
  const int points = seen.data.board.points(), rows = 2 * points * 3;
  const auto residuals = [&](const Eigen::VectorXd& step) {
    std::vector<double> intrinsics = fit.lens.intrinsics();
    for (int i = 0; i < 9; ++i) intrinsics[i] += step[l.lens_at + i];
    const Lens lens = Lens::make("LENSMODEL_OPENCV5", intrinsics, 640, 480).value();
    Eigen::VectorXd x(rows);
    for (int v = 0; v < 3; ++v) {
      const Eigen::Vector3d r = vector_from_rotation(fit.camera_from_board[v].rotation);
      const Pose pose{rotation_from_vector(r + step.segment<3>(l.poses_at + 6 * v)),
                      fit.camera_from_board[v].translation + step.segment<3>(l.poses_at + 6 * v + 3)};
      for (int i = 0; i < points; ++i)
        x.segment<2>(2 * (v * points + i)) = lens.project(pose * seen.data.board.point(i));
    }
    return x;
  };
  Eigen::MatrixXd J(rows, l.states);
  for (int k = 0; k < l.states; ++k) {
    Eigen::VectorXd step = Eigen::VectorXd::Zero(l.states);
    step[k] = 1e-4 * l.scale[k];  // a ten-thousandth of what mrcal takes for a typical size
    J.col(k) = (residuals(step) - residuals(-step)) / 2e-4;
  }
  const Eigen::MatrixXd N = J.transpose() * J;
  // Differences of this size are right to about 1e-6 of the largest entries.
  EXPECT_LT((N - l.N_board).cwiseAbs().maxCoeff(), 1e-5 * N.cwiseAbs().maxCoeff());
  EXPECT_GE((l.N - l.N_board).trace(), 0);
}

bool python_has_mrcal() {
  return std::system("/usr/bin/python3 -c 'import mrcal' >/dev/null 2>&1") == 0;
}

class FittedModel : public ::testing::TestWithParam<bool> {};  // splined?

// Debian's Python mrcal reads our file with all that it was fitted from, finds nothing left to optimise, and computes
// the same uncertainty.
TEST_P(FittedModel, IsMrcalsAndSoIsItsUncertainty) {
  if (!python_has_mrcal()) GTEST_SKIP() << "python3-mrcal is not installed";
  const TemporaryFolder folder;
  const SeenBoards seen("mrcal", 12);
  LensFit fit = fit_lens(seen.data, {.model = "LENSMODEL_OPENCV5", .find_outliers = true}).value();
  if (GetParam()) {
    const LensFit brown = fit;
    fit = fit_lens(seen.data, {.model = splined_model(brown.lens, 9), .start = &brown}).value();
  }
  ASSERT_TRUE(write_fitted_cameramodel(folder / "camera.cameramodel", seen.data, fit));
  const Device back = read_cameramodel(folder / "camera.cameramodel").value();
  EXPECT_EQ(back.lens.model(), fit.lens.model());
  EXPECT_EQ(back.lens.intrinsics(), fit.lens.intrinsics());
  const LensUncertainty uncertainty(seen.data, fit);
  std::ofstream(folder / "check.py")
      << "import sys, numpy, mrcal\n"
         "m = mrcal.cameramodel(sys.argv[1]); sigma = float(sys.argv[2])\n"
         "before = m.intrinsics()[1].copy(); inputs = m.optimization_inputs()\n"
         "print(mrcal.optimize(**inputs)['rms_reproj_error__pixels'], abs(inputs['intrinsics'][0] / before - "
         "1)[:4].max())\n"
         "for q in ((320., 240.), (40., 70.), (600., 430.)):\n"
         "  for far in (False, True):\n"
         "    v = mrcal.unproject(numpy.array(q), *m.intrinsics(), normalize = True) * (1 if far else .4)\n"
         "    C = mrcal.projection_uncertainty(v, m, atinfinity = far, what = 'covariance', observed_pixel_uncertainty "
         "= "
         "sigma)\n"
         "    print(C[0, 0], C[0, 1], C[1, 1])\n";
  const std::string command =
      fmt::format("/usr/bin/python3 {} {} {:.17g} > {}", (folder / "check.py").string(),
                  (folder / "camera.cameramodel").string(), fit.sigma_px, (folder / "said").string());
  ASSERT_EQ(std::system(command.c_str()), 0);
  std::ifstream said(folder / "said");
  double rms = 0, moved = 0;
  said >> rms >> moved;
  EXPECT_NEAR(rms, fit.rms_px, 0.06 * rms);  // mrcal counts regularisation as measurements that have no error
  EXPECT_LT(moved, 1e-3);                    // px, of focal lengths and principal point
  for (const Eigen::Vector2d& q : {Eigen::Vector2d(320, 240), {40, 70}, {600, 430}})
    for (double distance : {0.4, LensUncertainty::kInfinity}) {
      const Eigen::Matrix2d ours = uncertainty.covariance(q, distance);
      double xx = 0, xy = 0, yy = 0;
      said >> xx >> xy >> yy;
      EXPECT_NEAR(ours(0, 0), xx, 1e-5 * xx);
      EXPECT_NEAR(ours(0, 1), xy, 1e-5 * std::sqrt(xx * yy));
      EXPECT_NEAR(ours(1, 1), yy, 1e-5 * yy);
    }
}

INSTANTIATE_TEST_SUITE_P(Kinds, FittedModel, ::testing::Bool(),
                         [](const auto& info) { return info.param ? "Splined" : "Brown"; });

}  // namespace
}  // namespace countershade::solver
