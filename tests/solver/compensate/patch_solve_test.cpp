// Laws of the patch-level solutions: closed form, clipped solution, the paper's algorithms, certificate.
#include <gtest/gtest.h>

#include "solver/compensate/compensate.h"
#include "tests/support/test_model.h"

namespace countershade::solver {
namespace {

using Eigen::MatrixXd;

float largest(const Radiosity& r) {
  return r.cwiseAbs().maxCoeff();
}

// K = F with the given largest eigenvalue: symmetric, not negative, no negative eigenvalues, so that theory is sharp.
Eigen::MatrixXf known_spectrum(int n, double radius, std::uint64_t seed) {
  Random random(seed);
  MatrixXd A(n, n);
  for (double& a : A.reshaped()) a = random.uniform();
  const MatrixXd S = A * A.transpose();
  return (S * (radius / Eigen::SelfAdjointEigenSolver<MatrixXd>(S).eigenvalues().maxCoeff())).cast<float>();
}

Gather gather_of(const Eigen::MatrixXf& F) {
  const int n = static_cast<int>(F.rows());
  return Gather(F, Radiosity::Ones(n, 3), {{0, n, 0, 0}});
}

TEST(Gather, EqualsTheDenseProductWithAndWithoutZeroBlocks) {
  const Model model = test::room({.grid = {{9, 7}, {8, 11}}});
  const Radiosity x = test::random_radiosity(model.patches.size(), -1, 1, 1);
  const Radiosity expected = model.k.cwiseProduct(model.F * x);
  EXPECT_EQ(row_bands(model.F, model.patches, 1)[1].skipped, 88);
  // Single precision: 150 terms of size 1e-2.
  EXPECT_LT(largest(Gather::patches(model)(x) - expected), 2e-6f);
  Eigen::MatrixXf full = model.F;
  full(70, 80) = .25f;  // a wall that sees itself
  EXPECT_EQ(row_bands(full, model.patches, 1)[1].skipped, 0);
  const Gather K(full, model.k, row_bands(full, model.patches, 1));
  EXPECT_LT(largest(K(x) - model.k.cwiseProduct(full * x)), 2e-6f);
  const Radiosity at_receivers = receiver_gain(model).cwiseProduct(model.G * x);
  EXPECT_LT(largest(Gather::receivers(model)(x) - at_receivers), 2e-6f);
}

TEST(Gather, KappaIsTheLargestRowSum) {
  const Model model = test::room();
  const Radiosity ones = Radiosity::Ones(model.patches.size(), 3);
  EXPECT_NEAR(Gather::patches(model).kappa(), Gather::patches(model)(ones).maxCoeff(), 1e-6);  // float sums
}

TEST(ClosedForm, ForwardOfDirectForIsTheTarget) {
  const Model model = test::room();
  const Radiosity target = test::random_radiosity(model.patches.size(), .05, .9, 2);
  const Radiosity shown = forward(model, direct_for(model, target));
  EXPECT_LT(largest(shown - target), 1e-6f);                  // float sums of a series that ends at 1e-7
  EXPECT_GT(largest(forward(model, target) - target), .05f);  // what a plain show gets wrong
}

TEST(ClosedForm, ForwardSolvesTheLinearSystem) {
  const Model model = test::room();
  const Radiosity direct = test::random_radiosity(model.patches.size(), 0, 1, 3);
  const Radiosity shown = forward(model, direct);
  for (int c = 0; c < 3; ++c) {
    const MatrixXd K = model.k.col(c).cast<double>().asDiagonal() * model.F.cast<double>();
    const Eigen::VectorXd exact =
        (MatrixXd::Identity(K.rows(), K.cols()) - K).partialPivLu().solve(direct.col(c).cast<double>());
    EXPECT_LT((shown.col(c).cast<double>() - exact).cwiseAbs().maxCoeff(), 2e-6);  // float sums
  }
}

struct ClippedCase {
  Model model = test::room({.k = .95});
  Radiosity low, high, target;
  Clipped solution;
  ClippedCase() {
    const int P = model.patches.size();
    low = test::random_radiosity(P, .001, .02, 4);
    high = low + test::random_radiosity(P, .6, .9, 5);
    const Radiosity wish = test::random_radiosity(P, 0, 1, 6);
    target = low + wish.cwiseProduct(wish).cwiseProduct(high - low);  // much of it dark: clips
    for (int i = 0; i < P; i += 3) target.row(i) = low.row(i);
    solution = clipped_direct_for(model, target, low, high, 1e-7f, 200);
  }
};

TEST(ClippedSolution, ShowsExactlyWhatDoesNotClipAndStaysInRange) {
  const ClippedCase c;
  EXPECT_TRUE((c.solution.direct.array() >= c.low.array()).all());
  EXPECT_TRUE((c.solution.direct.array() <= c.high.array()).all());
  const Radiosity shown = forward(c.model, c.solution.direct);
  EXPECT_LT(largest(shown - c.solution.shown), 1e-6f);  // float sums
  int clipped = 0;
  for (Eigen::Index i = 0; i < shown.size(); ++i) {
    const float D = c.solution.direct.data()[i];
    if (D == c.low.data()[i] || D == c.high.data()[i]) {
      ++clipped;
      continue;
    }
    EXPECT_NEAR(shown.data()[i], c.target.data()[i], 1e-6);  // float sums
  }
  EXPECT_GT(clipped, shown.size() / 5);
  EXPECT_LT(clipped, shown.size() * 4 / 5);
}

TEST(ClippedSolution, ShowsWhiteWhereMoreIsAskedFor) {
  ClippedCase c;
  c.target.row(3) = c.high.row(3) * 2;
  const Clipped solution = clipped_direct_for(c.model, c.target, c.low, c.high, 1e-7f, 200);
  EXPECT_EQ(solution.direct.row(3), c.high.row(3));
}

TEST(ClippedSolution, IsNeverWorseThanThePlainShow) {
  const ClippedCase c;
  const Radiosity plain = forward(c.model, c.target);
  const Radiosity shown = forward(c.model, c.solution.direct);
  EXPECT_TRUE((shown.array() >= c.target.array() - 1e-6f).all());  // float sums
  EXPECT_TRUE((shown.array() <= plain.array() + 1e-6f).all());
}

TEST(ClippedSolution, DoesNotDependOnWhereItIsStoppedBeyondTheTolerance) {
  const ClippedCase c;
  const Clipped rough = clipped_direct_for(c.model, c.target, c.low, c.high, 1e-3f, 200);
  EXPECT_LT(rough.gathers, c.solution.gathers);
  // The moves shrink by kappa < .5 per gather, so all later ones together are below the last.
  EXPECT_LT(largest(rough.shown - c.solution.shown), 1e-3f);
}

TEST(ClippedSolution, IsTheClosedFormWhereNothingClips) {
  const Model model = test::room();
  const int P = model.patches.size();
  const Radiosity target = test::random_radiosity(P, .5, .6, 7);
  const Clipped solution = clipped_direct_for(model, target, Radiosity::Zero(P, 3), Radiosity::Ones(P, 3), 1e-6f, 40);
  EXPECT_EQ(solution.gathers, 1);
  EXPECT_LT(largest(solution.direct - direct_for(model, target)), 1e-6f);
}

TEST(ClippedSolution, RefusesARangeUpsideDown) {
  const Model model = test::room();
  const Radiosity one = Radiosity::Ones(model.patches.size(), 3);
  EXPECT_THROW(clipped_direct_for(model, one, one, .5f * one, 1e-6f, 5), Bug);
}

TEST(PaperAlgorithm, ConvergesJustWhereTheSumOfPowersIsBelowOne) {
  const std::pair<int, double> limits[] = {{1, 1.}, {2, .6180}, {3, .5437}, {4, .5188}, {7, .5020}};
  for (const auto& [H, limit] : limits)
    for (const double factor : {.96, 1.04}) {
      const Gather K = gather_of(known_spectrum(23, factor * limit, 8));
      const Radiosity target = test::random_radiosity(23, .1, 1, 9);
      const PaperSolution solution = paper_direct_for(K, target, H, 1e-5f, 1500);
      EXPECT_EQ(solution.converged, factor < 1) << "H " << H << " l " << factor * limit;
    }
}

TEST(PaperAlgorithm, FixedPointIsTooBrightByTheBouncesItForgets) {
  for (const int H : {1, 2, 5}) {
    const Eigen::MatrixXf F = known_spectrum(19, .45, 10);
    const Gather K = gather_of(F);
    const Radiosity target = test::random_radiosity(19, .1, 1, 11);
    const PaperSolution solution = paper_direct_for(K, target, H, 1e-6f, 500);
    ASSERT_TRUE(solution.converged);
    MatrixXd power = F.cast<double>();
    for (int n = 0; n < H; ++n) power = power * F.cast<double>();
    const MatrixXd exact = (MatrixXd::Identity(19, 19) - power).partialPivLu().solve(target.cast<double>());
    const Radiosity shown = forward(K, solution.direct);
    // The last move, times 1 / (1 - .45 - .. - .45^5) = 5, in single precision.
    EXPECT_LT((shown.cast<double>() - exact).cwiseAbs().maxCoeff(), 1e-5);
    EXPECT_GT((exact - target.cast<double>()).cwiseAbs().maxCoeff(), 1e-3);
  }
}

TEST(PaperAlgorithm, FirstPassOfAlgorithm1IsTheClosedForm) {
  const Model model = test::room();
  const Radiosity target = test::random_radiosity(model.patches.size(), .1, 1, 12);
  const PaperSolution solution = paper_direct_for(model, target, 1, 0, 1);
  EXPECT_FALSE(solution.converged);
  EXPECT_LT(largest(solution.direct - direct_for(model, target)), 1e-7f);
}

TEST(Certificate, BoundsTheErrorAndIsTightForErrorsOfOneSign) {
  const Model model = test::room();
  const int P = model.patches.size();
  const Radiosity target = test::random_radiosity(P, .2, .8, 13);
  const Radiosity noise = test::random_radiosity(P, -.05, .05, 14);
  const Radiosity direct = direct_for(model, target) + noise;
  const Radiosity error = (forward(model, direct) - target).cwiseAbs();
  EXPECT_TRUE((certificate(model, direct, target).array() >= error.array() - 1e-6f).all());  // float sums
  const Radiosity brighter = direct_for(model, target) + noise.cwiseAbs();
  const Radiosity exact = forward(model, brighter) - target;
  EXPECT_LT(largest(certificate(model, brighter, target) - exact), 2e-6f);  // float sums
  EXPECT_LT(largest(certificate(model, direct_for(model, target), target)), 1e-6f);
}

TEST(Optimum, IsTheClosedFormWhereNothingClips) {
  const Model model = test::room();
  const Radiosity target = test::random_radiosity(model.patches.size(), .4, .6, 21);
  const Radiosity low = Radiosity::Zero(target.rows(), 3), high = Radiosity::Ones(target.rows(), 3);
  const Clipped best = optimal_direct_for(model, target, low, high, 60);
  EXPECT_LT(largest(best.shown - target), 1e-5f);
}

TEST(Optimum, SatisfiesTheConditionsOfAMinimumInTheBox) {
  Model model = test::room();
  model.k = test::random_radiosity(model.patches.size(), .5, .95, 23);  // strong and uneven, or K^T would be lost on it
  Radiosity target = test::random_radiosity(model.patches.size(), 0, .03, 22);
  target.topRows(20).array() += .9f;  // a bright window in a dark room
  const Radiosity low = Radiosity::Constant(target.rows(), 3, .001f), high = Radiosity::Ones(target.rows(), 3);
  const Clipped clipped = clipped_direct_for(model, target, low, high, 1e-7f, 1000);
  const Clipped best = optimal_direct_for(model, target, low, high, 400);
  EXPECT_LE((best.shown - target).norm(), (forward(model, clipped.direct) - target).norm());
  EXPECT_TRUE((best.direct.array() >= low.array()).all() && (best.direct.array() <= high.array()).all());
  // The gradient, by a dense solve: zero inside the box, pointing out of it at its sides.
  for (int c = 0; c < 3; ++c) {
    const int n = static_cast<int>(target.rows());
    const MatrixXd IK = MatrixXd::Identity(n, n) - (model.k.col(c).asDiagonal() * model.F).cast<double>();
    const Eigen::VectorXd B = IK.lu().solve(best.direct.col(c).cast<double>());
    const Eigen::VectorXd gradient = IK.transpose().lu().solve(B - target.col(c).cast<double>());
    const double scale = gradient.cwiseAbs().maxCoeff();
    for (int i = 0; i < n; ++i) {
      const bool at_low = best.direct(i, c) <= low(i, c), at_high = best.direct(i, c) >= high(i, c);
      const double tolerance = 5e-3 * scale;  // 400 steps
      EXPECT_LT(at_low ? 0 : gradient[i], tolerance) << i;
      EXPECT_GT(at_high ? 0 : gradient[i], -tolerance) << i;
    }
  }
}

TEST(Forecast, OfACompensatedShowIsBelowThatOfThePlainOne) {
  const Model model = test::room();
  const std::vector<Picture> plain = test::pictures(model, 120, 200), dark = test::pictures(model, 20, 250, true);
  const Forecast good = forecast(model, plain, compensate_frame(model, plain, {.bits = 16}).pictures),
                 none = forecast(model, plain, plain);
  EXPECT_LT(good.optimum, 1e-4);                      // a patch at the rim of a picture has next to no light to give up
  EXPECT_LT(good.deviation, .15 * none.deviation);    // patches sample the pictures more coarsely than the pixel step
  EXPECT_LE(none.deviation, 1.8 * none.certificate);  // a bound on the mean; rms is above it where the light is uneven
  const Forecast clipped = forecast(model, dark, compensate_frame(model, dark, {.bits = 16}).pictures);
  EXPECT_GT(clipped.optimum, 0);
  EXPECT_GT(clipped.deviation, .9 * clipped.optimum);
}

}  // namespace
}  // namespace countershade::solver
