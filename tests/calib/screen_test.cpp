#include "calib/geometry/screen.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "calib/base/check.h"
#include "calib/base/random.h"

namespace countershade {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

// A plane with skew axes of different lengths, tilted in the world.
PlaneSurface skew_plane() {
  return {{0.4, -1.1, 0.7}, {2.1, 0.3, -0.2}, {0.5, 0.2, 1.4}};
}

Random seeded() {
  const auto* info = ::testing::UnitTest::GetInstance()->current_test_info();
  return Random(hash_name(fmt::format("{}.{}", info->test_suite_name(), info->name())));
}

// Two walls of different sizes that meet at x = 2, one of them skew, and a small board before the first.
Screen corner() {
  Screen screen;
  screen.surfaces = {
      std::make_shared<PlaneSurface>(Vector3d(0, 3, 0), Vector3d(2, 0, 0), Vector3d(0, 0, 1.5)),
      std::make_shared<PlaneSurface>(Vector3d(2, 3, 0), Vector3d(0.6, -1.7, 0), Vector3d(0.1, 0, 1.2)),
      std::make_shared<PlaneSurface>(Vector3d(0.5, 2.2, 0.3), Vector3d(0.4, 0.1, 0), Vector3d(0, 0, 0.5)),
  };
  return screen;
}

TEST(PlaneSurface, NormalIsUCrossV) {
  const PlaneSurface plane({0, 0, 0}, {2, 0, 0}, {0, 3, 0});
  EXPECT_EQ(plane.normal(0.2, 0.9), Vector3d::UnitZ());
  EXPECT_EQ(plane.area_element(0.1, 0.2), 6);
  const PlaneSurface skew = skew_plane();
  EXPECT_NEAR(skew.normal(0, 0).dot(skew.along_u()), 0, 1e-15);  // rounding
  EXPECT_NEAR(skew.normal(0, 0).dot(skew.along_v()), 0, 1e-15);
  EXPECT_NEAR(skew.normal(0, 0).norm(), 1, 1e-15);
}

TEST(PlaneSurface, RefusesAxesThatSpanNoArea) {
  EXPECT_THROW(PlaneSurface({0, 0, 0}, {1, 2, 3}, {2, 4, 6}), Bug);
  EXPECT_THROW(PlaneSurface({0, 0, 0}, {0, 0, 0}, {2, 4, 6}), Bug);
  EXPECT_THROW(PlaneSurface({0, 0, 0}, {NAN, 0, 0}, {2, 4, 6}), Bug);
}

TEST(PlaneSurface, ChartOfUndoesPointAlsoBesideThePlane) {
  const PlaneSurface plane = skew_plane();
  Random random = seeded();
  for (int i = 0; i < 100; ++i) {
    const double u = random.uniform(-1, 2), v = random.uniform(-1, 2);
    const Vector3d beside = plane.point(u, v) + random.uniform(-2, 2) * plane.normal(u, v);
    EXPECT_LT((plane.chart_of(beside) - Vector2d(u, v)).norm(), 1e-14);  // rounding; the axes are 60 degrees apart
  }
}

TEST(PlaneSurface, RayHitsThePointItAimsAt) {
  const PlaneSurface plane = skew_plane();
  Random random = seeded();
  for (int i = 0; i < 100; ++i) {
    const double u = random.uniform(), v = random.uniform();
    const Vector3d aim = plane.point(u, v);
    const Vector3d origin = aim + random.uniform(0.1, 3) * plane.normal(u, v) + random.uniform(-2, 2) * plane.along_u();
    const double stretch = random.uniform(0.1, 10);
    const auto hit = plane.intersect({origin, (aim - origin) * stretch});
    ASSERT_TRUE(hit);
    EXPECT_NEAR(hit->t, 1 / stretch, 1e-12 / stretch);  // grazing rays lose two digits of 1e-16
    EXPECT_NEAR(hit->u, u, 1e-12);
    EXPECT_NEAR(hit->v, v, 1e-12);
  }
}

TEST(PlaneSurface, IsHitOnItsLitSideOnlyAndAheadOnly) {
  const PlaneSurface plane = skew_plane();
  const Vector3d aim = plane.point(0.3, 0.6), n = plane.normal(0, 0);
  EXPECT_TRUE(plane.intersect({aim + n, -n}));
  EXPECT_FALSE(plane.intersect({aim - n, n})) << "from behind";
  EXPECT_FALSE(plane.intersect({aim + n, n})) << "away from it";
  EXPECT_FALSE(plane.intersect({aim - n, -n})) << "it lies behind the origin";
  EXPECT_FALSE(plane.intersect({aim + n, plane.along_u()})) << "parallel";
  EXPECT_FALSE(plane.intersect({aim, -n})) << "t = 0";
  EXPECT_FALSE(plane.intersect({aim + n, Vector3d::Constant(NAN)})) << "no ray";
}

TEST(PlaneSurface, MarginWidensTheChartOnAllFourSides) {
  const PlaneSurface plane = skew_plane();
  for (const Vector2d& c : {Vector2d(-0.03, 0.4), Vector2d(1.03, 0.4), Vector2d(0.4, -0.03), Vector2d(0.4, 1.03)}) {
    const Ray ray{plane.point(c.x(), c.y()) + plane.normal(0, 0), -plane.normal(0, 0)};
    EXPECT_FALSE(plane.intersect(ray)) << c.transpose();
    EXPECT_FALSE(plane.intersect(ray, 0.02)) << c.transpose();
    const auto hit = plane.intersect(ray, 0.04);
    ASSERT_TRUE(hit) << c.transpose();
    EXPECT_NEAR(hit->u, c.x(), 1e-14);  // rounding: not clamped
    EXPECT_NEAR(hit->v, c.y(), 1e-14);
  }
}

TEST(Screen, NearestSurfaceIsHit) {
  const Screen screen = corner();
  const Vector3d eye(0.9, -1, 0.6);
  for (int s = 0; s < 3; ++s) {
    const ChartPoint c{s, 0.9, 0.8};
    const ChartPoint hit = screen.intersect({eye, screen.point(c) - eye});
    EXPECT_EQ(hit.surface, s);
    EXPECT_NEAR(hit.u, c.u, 1e-14);  // rounding
    EXPECT_NEAR(hit.v, c.v, 1e-14);
  }
  // The board hides this point of the wall, whichever of them comes first in the list.
  const Vector3d board = screen.point({2, 0.5, 0.5});
  EXPECT_EQ(screen.intersect({eye, board - eye}).surface, 2);
  Screen other = screen;
  std::swap(other.surfaces[0], other.surfaces[2]);
  EXPECT_EQ(other.intersect({eye, board - eye}).surface, 0);
  EXPECT_EQ(screen.intersect({eye, Vector3d(0, -1, 0)}).surface, -1);
  EXPECT_EQ(Screen().intersect({eye, Vector3d(0, 1, 0)}).surface, -1);
}

const std::vector<std::pair<int, int>> kGrid = {{5, 3}, {2, 7}, {4, 1}};

TEST(Patches, AreCountedSurfaceBySurfaceAndRowByRow) {
  const Patches patches(kGrid);
  EXPECT_EQ(patches.size(), 15 + 14 + 4);
  EXPECT_EQ(patches.surfaces(), 3);
  EXPECT_EQ(patches.offset(2), 29);
  EXPECT_EQ(patches.count(1), 14);
  EXPECT_EQ(patches.index(1, 1, 3), 15 + 3 * 2 + 1);
  EXPECT_EQ(patches.grid(), kGrid);
  EXPECT_EQ(Patches().size(), 0);
  EXPECT_THROW(Patches({{3, 0}}), Bug);
  EXPECT_THROW(Patches({{-1, 2}}), Bug);
}

TEST(Patches, CentreLiesInItsOwnPatch) {
  const Patches patches(kGrid);
  for (int i = 0; i < patches.size(); ++i) {
    const ChartPoint c = patches.centre(i);
    EXPECT_EQ(patches.index(c), i);
    EXPECT_EQ(patches.surface_of(i), c.surface);
  }
  const ChartPoint c = patches.centre(patches.index(0, 3, 1));
  EXPECT_DOUBLE_EQ(c.u, 0.7);
  EXPECT_DOUBLE_EQ(c.v, 0.5);
  EXPECT_THROW(patches.surface_of(33), Bug);
  EXPECT_THROW(patches.surface_of(-1), Bug);
}

TEST(Patches, PointsOutsideTheChartBelongToTheNearestPatch) {
  const Patches patches(kGrid);
  EXPECT_EQ(patches.index({0, -0.2, 0.5}), patches.index(0, 0, 1));
  EXPECT_EQ(patches.index({0, 1.0, 1.0}), patches.index(0, 4, 2));
  EXPECT_EQ(patches.index({1, 1e30, -1e30}), patches.index(1, 1, 0));
  EXPECT_THROW(patches.index({-1, 0.5, 0.5}), Bug);
  EXPECT_THROW(patches.index({3, 0.5, 0.5}), Bug);
  EXPECT_THROW(patches.index({0, NAN, 0.5}), Bug);
}

TEST(PatchAreas, SumUpToTheSurfaces) {
  const Screen screen = corner();
  const Patches patches(kGrid);
  const Eigen::VectorXd areas = patch_areas(screen, patches);
  ASSERT_EQ(areas.size(), 33);
  EXPECT_NEAR(areas.segment(0, 15).sum(), 3.0, 1e-14);  // 2 x 1.5; rounding
  EXPECT_NEAR(areas[3], 0.2, 1e-15);
  // |(.6, -1.7, 0) x (.1, 0, 1.2)| = |(-2.04, -.72, .17)|
  EXPECT_NEAR(areas.segment(15, 14).sum(), std::sqrt(2.04 * 2.04 + 0.72 * 0.72 + 0.17 * 0.17), 1e-14);
}

TEST(PatchCorners, GoAnticlockwiseSeenFromTheLitSide) {
  const Screen screen = corner();
  const Patches patches(kGrid);
  const Eigen::VectorXd areas = patch_areas(screen, patches);
  for (int i = 0; i < patches.size(); ++i) {
    const auto x = patch_corners(screen, patches, i);
    // Area vector of a polygon: half the sum of x_k cross x_(k+1); it points at who sees it anticlockwise.
    Vector3d area = Vector3d::Zero(), sum = Vector3d::Zero();
    for (int k = 0; k < 4; ++k) area += 0.5 * x[k].cross(x[(k + 1) % 4]), sum += x[k];
    const ChartPoint c = patches.centre(i);
    EXPECT_LT((area - areas[i] * screen.normal(c)).norm(), 1e-14) << i;  // rounding of numbers up to 5
    EXPECT_LT((sum / 4 - screen.point(c)).norm(), 1e-14) << i;
  }
  // The first is the corner of smallest u and v, the second lies along u.
  const auto x = patch_corners(screen, patches, patches.index(0, 1, 2));
  EXPECT_LT((x[0] - Vector3d(0.4, 3, 1)).norm(), 1e-15);  // rounding
  EXPECT_LT((x[1] - Vector3d(0.8, 3, 1)).norm(), 1e-15);
}

}  // namespace
}  // namespace countershade
