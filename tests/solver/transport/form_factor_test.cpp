#include "solver/transport/form_factor.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "solver/transport/patch_flow.h"
#include "solver/transport/quadrature.h"

namespace countershade::solver {
namespace {

using V = Eigen::Vector3d;
using Corners = std::array<V, 4>;

Corners rectangle(const V& origin, const V& u, const V& v) {
  return {origin, origin + u, origin + u + v, origin + v};
}

// An axis-aligned box with inward-facing faces.
Screen box(double x, double y, double z) {
  Screen screen;
  const auto face = [&](const V& o, const V& u, const V& v) {
    screen.surfaces.push_back(std::make_shared<PlaneSurface>(o, u, v));
  };
  face(V(0, 0, 0), V(x, 0, 0), V(0, y, 0));
  face(V(0, 0, z), V(0, y, 0), V(x, 0, 0));
  face(V(0, 0, 0), V(0, y, 0), V(0, 0, z));
  face(V(x, 0, 0), V(0, 0, z), V(0, y, 0));
  face(V(0, 0, 0), V(0, 0, z), V(x, 0, 0));
  face(V(0, y, 0), V(x, 0, 0), V(0, 0, z));
  return screen;
}

TEST(FormFactor, AgreesWithTheUnitCube) {
  const Corners floor = rectangle(V(0, 0, 0), V(1, 0, 0), V(0, 1, 0)),
                ceiling = rectangle(V(0, 0, 1), V(0, 1, 0), V(1, 0, 0));
  const Corners wall = rectangle(V(0, 0, 0), V(0, 1, 0), V(0, 0, 1));
  EXPECT_NEAR(form_factor(floor, ceiling), opposite_rectangles(1, 1, 1), 1e-10);
  EXPECT_NEAR(form_factor(floor, ceiling), 0.199825, 1e-6);  // the published value has six digits
  EXPECT_NEAR(form_factor(floor, wall), adjacent_rectangles(1, 1, 1), 1e-9);
  EXPECT_NEAR(form_factor(floor, wall), 0.200044, 1e-6);
}

TEST(FormFactor, ClosedRoomRowsSumToOne) {
  const Screen screen = box(2, 3, 5);
  const Patches patches({{3, 2}, {2, 4}, {3, 3}, {2, 5}, {4, 2}, {1, 3}});
  SilentProgress progress;
  const Eigen::MatrixXf F = form_factors(screen, patches, FormFactorMethod::kExact, progress);
  // Entries are floats: about 40 of them, each rounded to 6e-8 relative.
  for (int i = 0; i < F.rows(); ++i) EXPECT_NEAR(F.row(i).cast<double>().sum(), 1.0, 2e-6) << i;
}

TEST(FormFactor, ExchangeIsSymmetric) {
  const Corners a = rectangle(V(0.1, 0, 0), V(0.4, 0, 0), V(0, 0.7, 0)),
                b = rectangle(V(0, 0.2, 0.3), V(0, 0.9, 0), V(0, 0, 0.2));
  EXPECT_NEAR(patch_flow(a, b, 1e-11) / patch_flow(b, a, 1e-11), 1, 1e-12);
}

TEST(FormFactor, IsAdditive) {
  const Corners a = rectangle(V(0, 0, 0), V(1.3, 0, 0), V(0, 0.9, 0));
  const Corners whole = rectangle(V(0, 0, 0), V(0, 0.9, 0), V(0, 0, 0.8));
  const Corners low = rectangle(V(0, 0, 0), V(0, 0.9, 0), V(0, 0, 0.05)),
                high = rectangle(V(0, 0, 0.05), V(0, 0.9, 0), V(0, 0, 0.75));
  EXPECT_NEAR((form_factor(a, low) + form_factor(a, high)) / form_factor(a, whole), 1, 1e-9);
}

TEST(FormFactor, DoesNotDependOnTheUnit) {
  const auto at = [](double unit) {
    return form_factor(rectangle(V(0, 0, 0), V(unit, 0, 0), V(0, 2 * unit, 0)),
                       rectangle(V(0, 0, 0), V(0, 2 * unit, 0), V(0, 0, 0.5 * unit)));
  };
  EXPECT_NEAR(at(1e-3) / at(1), 1, 1e-10);
  EXPECT_NEAR(at(100) / at(1), 1, 1e-10);
}

TEST(FormFactor, OrdersOfQuadratureAgreeWhereTheyMeet) {
  const Corners a = rectangle(V(0, 0, 0), V(0.1, 0, 0), V(0, 0.08, 0));
  for (double distance : {0.3, 0.6, 1.5, 6.0, 60.0}) {
    const Corners b = rectangle(V(0.02, 0, distance), V(0, 0.08, 0), V(0.1, 0, 0));
    EXPECT_NEAR(patch_flow(a, b, 1e-8) / patch_flow(a, b, 1e-12), 1, 1e-8) << distance;
  }
}

TEST(FormFactor, PartsBehindTheHorizonDoNotExchangeLight) {
  const Corners a = rectangle(V(0, 0, 0), V(1, 0, 0), V(0, 1, 0));
  const Corners half = rectangle(V(2, 0, 0), V(0, 1, 0), V(0, 0, 0.5));   // faces -x, above a's plane
  const Corners both = rectangle(V(2, 0, -0.5), V(0, 1, 0), V(0, 0, 1));  // reaches as far below it
  const Corners facing_half = rectangle(V(2, 0, 0), V(0, 0, 0.5), V(0, 1, 0)),
                facing_both = rectangle(V(2, 0, -0.5), V(0, 0, 1), V(0, 1, 0));
  EXPECT_EQ(form_factor(a, half), 0);  // turned away
  EXPECT_EQ(form_factor(a, both), 0);
  EXPECT_GT(form_factor(a, facing_half), 0.01);
  EXPECT_NEAR(form_factor(a, facing_both) / form_factor(a, facing_half), 1, 1e-9);
}

TEST(FormFactor, DegeneratePolygonsExchangeNothing) {
  const Corners a = rectangle(V(0, 0, 0), V(1, 0, 0), V(0, 1, 0)), line = rectangle(V(0, 0, 1), V(0, 0, 0), V(1, 0, 0));
  EXPECT_EQ(form_factor(a, line), 0);
  EXPECT_EQ(form_factor(line, a), 0);
}

TEST(PointFormFactor, AveragesToThePatchFormFactor) {
  const Corners a = rectangle(V(0.2, 0.1, 0), V(0.6, 0, 0), V(0, 0.5, 0)),
                b = rectangle(V(0, 0, 0.1), V(0, 0.9, 0), V(0, 0, 0.7));
  const GaussRule& rule = gauss_rule(16);
  double mean = 0;
  for (int i = 0; i < 16; ++i)
    for (int j = 0; j < 16; ++j)
      mean += rule.weight[i] * rule.weight[j] *
              point_form_factor(a[0] + rule.node[i] * (a[1] - a[0]) + rule.node[j] * (a[3] - a[0]), V(0, 0, 1), b);
  EXPECT_NEAR(mean / form_factor(a, b), 1, 1e-9);
}

TEST(PointFormFactor, IsHalfAtAnInfiniteWallsFoot) {
  // Row sum at an open edge of angle t: (1 + cos t) / 2 (PHYSICS 7), from very near the edge of a very long wall.
  for (double degrees : {60.0, 90.0, 130.0}) {
    const double t = degrees * std::numbers::pi / 180;
    const V up(std::cos(t), 0, std::sin(t));
    const Corners wall = rectangle(V(0, -1e4, 0), V(0, 2e4, 0), 1e4 * up);
    EXPECT_NEAR(point_form_factor(V(1, 0, 0), V(0, 0, 1), wall), (1 + std::cos(t)) / 2, 1e-3)
        << degrees;  // 1e4 is not infinite
  }
}

TEST(CentreFormFactor, IsWrongByFiftyNinePercentAtAnEdgeAtEveryResolution) {
  for (int n : {2, 16, 128}) {
    const double s = 1.0 / n;
    const Corners a = rectangle(V(0, 0, 0), V(s, 0, 0), V(0, s, 0)), b = rectangle(V(0, 0, 0), V(0, s, 0), V(0, 0, s));
    EXPECT_NEAR(centre_form_factor(a, b) / form_factor(a, b), 1.59, 0.01);
  }
}

}  // namespace
}  // namespace countershade::solver
