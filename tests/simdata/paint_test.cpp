#include "simdata/room/paint.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "calib/base/random.h"
#include "simdata/render/scene.h"

namespace countershade {
namespace {

using simdata::SurfacePoint;

constexpr double kPi = std::numbers::pi;

// Integral over the hemisphere of f cos / pi, by strata.
template <class Function>
double cosine_mean(Function f) {
  constexpr int kSide = 600;
  double sum = 0;
  for (int j = 0; j < kSide; ++j)
    for (int i = 0; i < kSide; ++i)
      sum += f(simdata::cosine_direction(Eigen::Vector3d::UnitZ(), Eigen::Vector3d::UnitX(), (i + .5) / kSide,
                                         (j + .5) / kSide));
  return sum / (kSide * kSide);
}

Eigen::Vector3d slanted(double degrees) {
  return {std::sin(degrees * kPi / 180), 0, std::cos(degrees * kPi / 180)};
}

simdata::Paint painted(const SimulatedSurface& s) {
  Simulation room;
  room.surfaces = {s};
  return simdata::Paint(room);
}

SurfacePoint origin() {
  SurfacePoint p;
  p.surface = 0;
  return p;
}

// A smooth lobe loses almost nothing; masking takes the rest, never more than all, and more of it where the surface is
// rough. At alpha = 1, seen from above, D = 1 / pi and G / (4 cos cos) = 1 / (2 (1 + cos)): the albedo is 1 - ln 2.
TEST(Ggx, ReflectsAllLightButWhatMaskingTakes) {
  const auto albedo = [](double alpha, double degrees) {
    return cosine_mean([&](const Eigen::Vector3d& in) {
      return kPi * simdata::ggx(Eigen::Vector3d::UnitZ(), in, slanted(degrees), alpha);
    });
  };
  EXPECT_NEAR(albedo(1, 0), 1 - std::log(2.), 1e-4);
  EXPECT_NEAR(albedo(.1, 0), 1, .02);
  EXPECT_NEAR(albedo(.1, 45), 1, .03);
  for (double alpha : {.15, .3, .5, .8, 1.})
    for (double degrees : {0., 30., 60., 80.}) {
      EXPECT_LT(albedo(alpha, degrees), 1.002) << alpha << " " << degrees;
      EXPECT_GT(albedo(alpha, degrees), .3) << alpha << " " << degrees;
    }
  EXPECT_GT(albedo(.3, 0), albedo(.9, 0));
}

// Walter et al. 2007: with G = 1 and the normal incidence D(h) alone, integral of D cos over the normals is 1. At
// normal incidence in = out = normal, ggx = D(0) G / 4 with G = 1, D(0) = 1 / (pi alpha^2).
TEST(Ggx, PeakIsThatOfItsDistribution) {
  for (double alpha : {.1, .35, .9})
    EXPECT_NEAR(simdata::ggx({0, 0, 1}, {0, 0, 1}, {0, 0, 1}, alpha), 1 / (4 * kPi * alpha * alpha), 1e-9);
}

TEST(Ggx, IsReciprocalAndDarkBelowTheSurface) {
  const Eigen::Vector3d n(0, 0, 1), a = Eigen::Vector3d(.4, -.2, .6).normalized(),
                                    b = Eigen::Vector3d(-.5, .3, .2).normalized();
  EXPECT_DOUBLE_EQ(simdata::ggx(n, a, b, .4), simdata::ggx(n, b, a, .4));
  EXPECT_EQ(simdata::ggx(n, a, -b, .4), 0);
  EXPECT_EQ(simdata::ggx(n, -a, b, .4), 0);
}

TEST(Directing, KeepsTheLightWhereverItSendsIt) {
  for (double exponent : {.5, 2., 9.})
    for (const std::array<double, 2> tilt : {std::array{0., 0.}, {20., -10.}, {-35., 25.}}) {
      SimulatedSurface s;
      s.directing = exponent, s.directing_tilt_deg = tilt;
      const auto paint = painted(s);
      EXPECT_NEAR(cosine_mean([&](const Eigen::Vector3d& out) { return paint.directed(origin(), out); }), 1, .002);
      const double t = std::tan(tilt[0] * kPi / 180), w = std::tan(tilt[1] * kPi / 180);
      const Eigen::Vector3d axis = Eigen::Vector3d(t, w, 1).normalized();
      // (axis o)^m: the ratio of two directions.
      EXPECT_NEAR(paint.directed(origin(), slanted(10)) / paint.directed(origin(), axis),
                  std::pow(axis.dot(slanted(10)), exponent), 1e-9);
    }
}

TEST(Lobe, EvenLightGivesItsAlbedo) {
  SimulatedSurface s;
  s.gloss = .3, s.roughness = .35;
  const auto paint = painted(s);
  for (double degrees : {5., 40., 75.}) {
    const Eigen::Vector3d out = slanted(degrees);
    const double even = cosine_mean([&](const Eigen::Vector3d& in) { return paint.lobe(origin(), in, out); });
    EXPECT_NEAR(paint.evenly_lit(origin(), out), even, .002) << degrees;
  }
  EXPECT_EQ(painted(SimulatedSurface()).lobe(origin(), slanted(20), slanted(70)), 1);
}

// Drawn directions weigh what the lobe says, wherever they lead: three moments of it.
TEST(Lobe, DrawnDirectionsAreThoseThatGlossMirrors) {
  for (double roughness : {.15, .4, .9})
    for (double degrees : {0., 35., 70.}) {
      SimulatedSurface s;
      s.gloss = .7, s.roughness = roughness;
      const simdata::Paint paint = painted(s);
      const Eigen::Vector3d out = slanted(degrees);
      constexpr int kSide = 300;
      Eigen::Array3d drawn = Eigen::Array3d::Zero();
      const auto moments = [](const Eigen::Vector3d& in) { return Eigen::Array3d(1, in.x(), in.y() * in.y()); };
      for (int j = 0; j < kSide; ++j)
        for (int i = 0; i < kSide; ++i) {
          const auto in = paint.mirrored(origin(), out, (i + .5) / kSide, (j + .5) / kSide);
          if (in.weight > 0) drawn += in.weight * moments(in.direction) / (kSide * kSide);
          EXPECT_TRUE(!(in.weight > 0) || std::abs(in.direction.norm() - 1) < 1e-9);
        }
      for (int k = 0; k < 3; ++k) {
        const double expected =
            cosine_mean([&](const Eigen::Vector3d& in) { return paint.glossy(origin(), in, out) * moments(in)[k]; });
        EXPECT_NEAR(drawn[k], expected, 2e-3) << roughness << " " << degrees << " " << k;
      }
    }
}

TEST(Paint, PatchworkHasOneAlbedoPerCellAndDaylightItsRectangle) {
  SimulatedSurface s;
  s.patchwork = .2, s.patchwork_cells = {3, 2};
  s.daylight = .7, s.daylight_from = {.2, .1}, s.daylight_to = {.5, .9};
  const auto paint = painted(s);
  const auto at = [](double u, double v) {
    SurfacePoint p = origin();
    p.u = u, p.v = v;
    return p;
  };
  std::vector<double> cells;
  for (int j = 0; j < 2; ++j)
    for (int i = 0; i < 3; ++i) {
      cells.push_back(paint.texture(at((i + .1) / 3, (j + .2) / 2)));
      EXPECT_EQ(paint.texture(at((i + .9) / 3, (j + .7) / 2)), cells.back());
      EXPECT_NEAR(cells.back(), 1, .2);
    }
  std::sort(cells.begin(), cells.end());
  EXPECT_EQ(std::adjacent_find(cells.begin(), cells.end()), cells.end()) << "all differ";
  EXPECT_EQ(paint.daylight(at(.3, .5)), .7);
  EXPECT_EQ(paint.daylight(at(.3, .05)), 0);
  EXPECT_EQ(paint.daylight(at(.6, .5)), 0);
}

}  // namespace
}  // namespace countershade
