#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "calib/base/check.h"
#include "solver/transport/form_factor.h"
#include "solver/transport/model.h"
#include "solver/transport/patch_flow.h"

namespace countershade::solver {
namespace {

using V = Eigen::Vector3d;

Screen screen_of(std::initializer_list<std::array<V, 3>> planes) {
  Screen screen;
  for (const auto& [origin, u, v] : planes) screen.surfaces.push_back(std::make_shared<PlaneSurface>(origin, u, v));
  return screen;
}

// An axis-aligned box with inward-facing faces.
Screen box(double x, double y, double z) {
  const V X(x, 0, 0), Y(0, y, 0), Z(0, 0, z), O(0, 0, 0);
  return screen_of({{O, X, Y}, {Z, Y, X}, {O, Y, Z}, {X, Z, Y}, {O, Z, X}, {Y, X, Z}});
}

// Floor and wall that share the y axis at dihedral angle t; walls of different width, height 2.
Screen dihedral(double t, double scale = 1) {
  return screen_of({{V(0, 0, 0), V(1.5, 0, 0) * scale, V(0, 2, 0) * scale},
                    {V(0, 0, 0), V(0, 2, 0) * scale, V(std::cos(t), 0, std::sin(t)) * scale}});
}

Eigen::MatrixXf exact(const Screen& screen, const Patches& patches) {
  SilentProgress progress;
  return form_factors(screen, patches, FormFactorMethod::kExact, progress);
}

TEST(FormFactors, ClosedRoomRowsSumToOne) {
  const Patches patches({{3, 2}, {2, 4}, {3, 3}, {2, 5}, {4, 2}, {1, 3}});
  const Eigen::MatrixXf F = exact(box(2, 3, 5), patches);
  // Sums of about 40 floats, each rounded to 6e-8 relative; roundings partly cancel.
  for (int i = 0; i < F.rows(); ++i) EXPECT_NEAR(F.row(i).cast<double>().sum(), 1.0, 2e-7) << i;
}

TEST(FormFactors, AreReciprocalToTheRoundingOfFloats) {
  const Screen screen = dihedral(1.9);
  const Patches patches({{5, 3}, {4, 2}});
  const Eigen::MatrixXf F = exact(screen, patches);
  const Eigen::VectorXd areas = patch_areas(screen, patches);
  for (int i = 0; i < patches.size(); ++i)
    for (int j = 0; j < patches.size(); ++j)
      EXPECT_NEAR(areas[i] * F(i, j), areas[j] * F(j, i), 1.3e-7 * areas[i] * F(i, j))
          << i << ' ' << j;  // two roundings
}

TEST(FormFactors, AreThoseOfTheirPairs) {
  const Screen screen = dihedral(1.2);
  const Patches patches({{5, 3}, {4, 2}});
  const Eigen::MatrixXf F = exact(screen, patches);
  for (int i = 0; i < patches.count(0); ++i)
    for (int j = patches.count(0); j < patches.size(); ++j) {
      const auto a = patch_corners(screen, patches, i), b = patch_corners(screen, patches, j);
      EXPECT_NEAR(F(i, j) / form_factor(a, b), 1, 1e-7);  // the header's bound
      EXPECT_NEAR(F(j, i) / form_factor(b, a), 1, 1e-7);
    }
}

TEST(FormFactors, AreZeroWithinAPlane) {
  // Two charts of one plane, and a wall.
  const Screen screen = screen_of({{V(0, 0, 0), V(1, 0, 0), V(0, 1, 0)},
                                   {V(1, 0, 0), V(1, 0, 0), V(0, 1, 0)},
                                   {V(0, 0, 0), V(0, 1, 0), V(0, 0, 1)}});
  const Patches patches({{3, 2}, {2, 2}, {2, 3}});
  const Eigen::MatrixXf F = exact(screen, patches);
  EXPECT_EQ(F.topLeftCorner(10, 10).cwiseAbs().maxCoeff(), 0);
  EXPECT_EQ(F.bottomRightCorner(6, 6).cwiseAbs().maxCoeff(), 0);
  EXPECT_GT(F.topRightCorner(10, 6).minCoeff(), 0);
}

TEST(FormFactors, DoNotDependOnTheUnit) {
  const Patches patches({{6, 4}, {3, 5}});
  const Eigen::MatrixXf F = exact(dihedral(1), patches);
  for (double unit : {1e-3, .3, 100.}) {
    const Eigen::MatrixXf scaled = exact(dihedral(1, unit), patches);
    EXPECT_LT((scaled - F).cwiseAbs().maxCoeff(), 1e-7 * F.maxCoeff()) << unit;  // floats
  }
}

TEST(FormFactors, RowSumAtALongOpenEdgeIsHalfOfOnePlusCosine) {
  for (double t : {.6, 1.5, 2.4}) {
    const Screen screen = screen_of(
        {{V(0, 0, 0), V(20, 0, 0), V(0, 20, 0)}, {V(0, 0, 0), V(0, 20, 0), 20 * V(std::cos(t), 0, std::sin(t))}});
    const Patches patches({{200, 1}, {1, 1}});
    // The first of 200 strips beside the edge, .1 m wide before a wall of 20 m: the ends of the wall take a few
    // thousandths.
    EXPECT_NEAR(exact(screen, patches)(0, 200), (1 + std::cos(t)) / 2, .006) << t;
  }
}

TEST(FormFactors, OfCentresExceedOneAtAnAcuteEdge) {
  const Patches patches({{16, 12}, {16, 12}});
  SilentProgress progress;
  const Screen screen = dihedral(std::numbers::pi / 6);
  const double of_centres =
      form_factors(screen, patches, FormFactorMethod::kCentre, progress).rowwise().sum().maxCoeff();
  EXPECT_GT(of_centres, 1);  // light from nothing
  EXPECT_LT(exact(screen, patches).rowwise().sum().maxCoeff(), 1);
}

class CurvedSurface final : public Surface {
 public:
  V point(double u, double v) const override { return {u, v, u * u}; }
  V normal(double, double) const override { return {0, 0, 1}; }
  double area_element(double, double) const override { return 1; }
  std::optional<Hit> intersect(const Ray&, double) const override { return std::nullopt; }
};

TEST(FormFactors, AreOfPlanesOnly) {
  Screen screen;
  screen.surfaces = {std::make_shared<CurvedSurface>()};
  SilentProgress progress;
  EXPECT_THROW(form_factors(screen, Patches({{2, 2}}), FormFactorMethod::kExact, progress), Bug);
}

class Listener final : public Progress {
 public:
  void step(std::string_view, double done, double total) override {
    if (done == 0) ++starts;
    EXPECT_GE(done, last);
    last = done, share = done / total;
  }
  void note(std::string_view) override {}
  void warn(std::string_view) override {}
  int starts = 0;
  double last = 0, share = 0;
};

TEST(FormFactors, TellHowFarTheyAre) {
  Listener listener;
  form_factors(dihedral(1), Patches({{7, 3}, {2, 1}}), FormFactorMethod::kExact, listener);
  EXPECT_EQ(listener.starts, 1);
  EXPECT_EQ(listener.share, 1);
}

TEST(ReceiverFormFactors, AverageToThePatchFormFactors) {
  // 90 degrees; patches away from the edge, where 12 x 12 midpoints resolve the kernel.
  const Screen screen = screen_of({{V(1, 0, 0), V(1.5, 0, 0), V(0, 2, 0)}, {V(0, 0, .5), V(0, 2, 0), V(0, 0, 1)}});
  const Patches patches({{3, 2}, {2, 3}});
  const Eigen::MatrixXf F = exact(screen, patches);
  const int factor = 12;
  SilentProgress progress;
  const Eigen::MatrixXf G = receiver_form_factors(screen, patches, receiver_points(patches, factor), progress);
  ASSERT_EQ(G.rows(), patches.size() * factor * factor);
  Eigen::MatrixXd mean = Eigen::MatrixXd::Zero(patches.size(), patches.size());
  const std::vector<ChartPoint> receivers = receiver_points(patches, factor);
  for (int r = 0; r < G.rows(); ++r)
    mean.row(patches.index(receivers[r])) += G.row(r).cast<double>() / (factor * factor);
  // Midpoint rule: second derivative (1 / .7 m)^2 times (.6 m / 12)^2 / 24.
  EXPECT_LT(((mean - F.cast<double>()).array().abs() / (F.cast<double>().array() + 1e-12)).maxCoeff(), 2e-3);
}

TEST(ReceiverFormFactors, OfAClosedRoomSumToOne) {
  const Screen screen = box(2, 3, 5);
  const Patches patches({{3, 2}, {2, 4}, {3, 3}, {2, 5}, {4, 2}, {1, 3}});
  SilentProgress progress;
  const std::vector<ChartPoint> receivers{
      {0, .01, .7}, {3, .33, .999}, {5, 1e-6, 1e-6}, {2, .5, .5}, {4, .2, 1 - 1e-9}};
  const Eigen::MatrixXf G = receiver_form_factors(screen, patches, receivers, progress);
  for (int r = 0; r < G.rows(); ++r) EXPECT_NEAR(G.row(r).cast<double>().sum(), 1, 2e-7) << r;  // floats, as above
}

}  // namespace
}  // namespace countershade::solver
