#include "solver/fit/lens/uncertainty.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/solver/fit/lens/seen_boards.h"

namespace countershade::solver {
namespace {

TEST(LensUncertainty, DerivativeIsThatOfFiniteDifferences) {
  const SeenBoards seen("derivative", 4);
  const LensFit fit = fit_lens(seen.data, {}).value();
  const LensUncertainty uncertainty(seen.data, fit);
  const Eigen::Vector3d x(0.11, -0.07, 0.35);
  for (bool far : {false, true}) {
    const auto J = uncertainty.derivative(x, far);
    const auto moved = [&](int k, double step) {
      std::vector<double> intrinsics = fit.lens.intrinsics();
      std::vector<Pose> poses = fit.camera_from_board;
      if (k < 9) {
        intrinsics[k] += step;
      } else {
        Pose& pose = poses[(k - 9) / 6];
        Eigen::Vector3d change = Eigen::Vector3d::Zero();
        change[(k - 9) % 3] = step;
        if ((k - 9) % 6 < 3)
          pose.rotation = rotation_from_vector(vector_from_rotation(pose.rotation) + change);
        else
          pose.translation += change;
      }
      const Lens lens = Lens::make("LENSMODEL_OPENCV5", intrinsics, 640, 480).value();
      return seen_through_boards(fit.camera_from_board, poses, lens, x, far);
    };
    for (int k = 0; k < 9 + 24; ++k) {
      const double step = k < 4 ? 1e-2 : 1e-6;
      const Eigen::Vector2d difference = (moved(k, step) - moved(k, -step)) / (2 * step);
      EXPECT_LT((difference - J.col(k)).norm(), 1e-5 * (1 + J.col(k).norm())) << k << (far ? " far" : " near");
    }
  }
}

// The same boards seen 150 times with fresh noise: the pixel of a point scatters as predicted.
TEST(LensUncertainty, PredictedCovarianceIsMonteCarlo) {
  SeenBoards seen("monte carlo", 8);
  Random random(hash_name("monte carlo noise"));
  constexpr int kDraws = 150;
  const Eigen::Vector2d pixels[] = {{320, 240}, {90, 60}, {560, 300}};
  Eigen::Matrix2d found[6], predicted[6];
  for (int k = 0; k < 6; ++k) found[k].setZero(), predicted[k].setZero();
  for (int draw = 0; draw < kDraws; ++draw) {
    seen.see(random);
    const LensFit fit = fit_lens(seen.data, {}).value();
    const LensUncertainty uncertainty(seen.data, fit);
    for (int k = 0; k < 6; ++k) {
      const bool far = k >= 3;
      const Eigen::Vector3d x = seen.lens.unproject(pixels[k % 3]) * (far ? 1 : 0.3);
      const Eigen::Vector2d off =
          seen_through_boards(seen.poses, fit.camera_from_board, fit.lens, x, far) - pixels[k % 3];
      found[k] += off * off.transpose() / kDraws;
      predicted[k] += uncertainty.covariance_of_point(x, far) / kDraws;
    }
  }
  for (int k = 0; k < 6; ++k) {
    // In the predicted ellipse's own axes the scatter is a unit circle; the relative sigma of a variance from 150 draws
    // is sqrt(2 / 150) = .115, of the mean of two .082.
    const Eigen::Matrix2d whitened =
        predicted[k].llt().matrixL().solve(predicted[k].llt().matrixL().solve(found[k]).transpose());
    EXPECT_NEAR(whitened.trace() / 2, 1, 3.3 * 0.082) << k;
    EXPECT_LT(std::abs(whitened(0, 1)), 3.5 * 0.082) << k;
  }
}

TEST(LensUncertainty, FourTimesTheViewsHalveIt) {
  SeenBoards seen("views", 8);
  const LensFit few = fit_lens(seen.data, {}).value();
  const BoardViews first = seen.data;
  Random random(hash_name("more views"));
  for (int i = 0; i < 3; ++i) {
    SeenBoards again = seen;
    again.see(random);
    seen.data.views.insert(seen.data.views.end(), again.data.views.begin(), again.data.views.begin() + 8);
  }
  const LensFit many = fit_lens(seen.data, {}).value();
  for (double distance : {0.3, LensUncertainty::kInfinity}) {
    const double a = worst_sigma(LensUncertainty(first, few).covariance({100, 80}, distance)) / few.sigma_px;
    const double b = worst_sigma(LensUncertainty(seen.data, many).covariance({100, 80}, distance)) / many.sigma_px;
    EXPECT_NEAR(a / b, 2, 0.1);  // the lenses at which it is taken differ by their noise
  }
}

TEST(LensUncertainty, FacingBoardsLeaveTheFocalLengthOpen) {
  const SeenBoards facing("tilt", 8, brown_lens(), 0.25), tilted("tilt", 8);
  const LensFit fit_facing = fit_lens(facing.data, {}).value(), fit_tilted = fit_lens(tilted.data, {}).value();
  EXPECT_GT(LensUncertainty(facing.data, fit_facing).focal_sigma(),
            3 * LensUncertainty(tilted.data, fit_tilted).focal_sigma());
}

TEST(LensDifference, OfALensAndItselfIsNothing) {
  for (const Eigen::Vector2d& d : lens_difference(brown_lens(), brown_lens(), pixel_grid(640, 480, 8, 6)))
    EXPECT_LT(d.norm(), 1e-9);
}

TEST(LensDifference, OfFocalLengthsGrowsFromTheMiddle) {
  const Lens a = Lens::pinhole(500, 319.5, 239.5, 640, 480), b = Lens::pinhole(505, 319.5, 239.5, 640, 480);
  const auto q = pixel_grid(640, 480, 9, 7);
  const auto difference = lens_difference(a, b, q);
  for (std::size_t i = 0; i < q.size(); ++i)  // no rotation helps where all is symmetric
    EXPECT_LT((difference[i] - 0.01 * (q[i] - Eigen::Vector2d(319.5, 239.5))).norm(), 1e-6);
}

TEST(LensDifference, DoesNotSeeARotationOfTheCamera) {
  // A principal point that is off by 2 pixels is, near the axis of a long lens, a rotation.
  const Lens a = Lens::pinhole(5000, 319.5, 239.5, 640, 480), b = Lens::pinhole(5000, 321.5, 239.5, 640, 480);
  for (const Eigen::Vector2d& d : lens_difference(a, b, pixel_grid(640, 480, 9, 7))) EXPECT_LT(d.norm(), 0.02);
}

TEST(LensDifference, BetweenHalvesIsAsPredicted) {
  SeenBoards a("half a", 8), b("half b", 8);
  Random random(hash_name("halves"));
  std::vector<Eigen::Vector2d> q;  // not the corners, where no point lies
  for (const Eigen::Vector2d& inside : pixel_grid(480, 360, 6, 5)) q.emplace_back(inside + Eigen::Vector2d(80, 60));
  double found = 0, predicted = 0;
  constexpr int kPairs = 60;
  for (int i = 0; i < kPairs; ++i) {
    a.see(random), b.see(random);
    const LensFit fit_a = fit_lens(a.data, {}).value(), fit_b = fit_lens(b.data, {}).value();
    for (const Eigen::Vector2d& d : lens_difference(fit_a.lens, fit_b.lens, q))
      found += d.squaredNorm() / (2.0 * q.size());
    predicted +=
        std::pow(predicted_difference_rms(LensUncertainty(a.data, fit_a), LensUncertainty(b.data, fit_b), q), 2);
  }
  // About three directions of the lens dominate: relative sigma sqrt(2 / (3 * 60)) = .1.
  EXPECT_NEAR(found / predicted, 1, 0.3);
}

}  // namespace
}  // namespace countershade::solver
