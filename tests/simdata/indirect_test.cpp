#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "tests/simdata/small_room.h"

namespace countershade {
namespace {

using test::flat;
using test::simulate;
using test::small_room;

// Lambert 1760: share of the light at x (normal n) that a uniform convex polygon, anticlockwise from x, sends.
double polygon_form_factor(const Eigen::Vector3d& x, const Eigen::Vector3d& n,
                           const std::vector<Eigen::Vector3d>& polygon) {
  double sum = 0;
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const Eigen::Vector3d a = (polygon[i] - x).normalized(), b = (polygon[(i + 1) % polygon.size()] - x).normalized();
    sum += std::acos(a.dot(b)) * a.cross(b).normalized().dot(n);
  }
  return std::abs(sum) / (2 * std::numbers::pi);
}

std::vector<Eigen::Vector3d> corners(const Surface& wall) {
  return {wall.point(0, 0), wall.point(1, 0), wall.point(1, 1), wall.point(0, 1)};
}

using Three = std::array<double, 3>;

void paint(simdata::RigAndRoom& room, const Three& albedo) {
  for (SimulatedSurface& wall : room.simulation.surfaces) wall.albedo = albedo;
}

double total(const Image& image) {
  double sum = 0;
  for (float v : image.data()) sum += v;
  return sum;
}

// A projector so far away that its light is parallel: it lights the right wall evenly and grazes the left one, which is
// perpendicular. So the left wall receives albedo times E times the form factor of the right wall.
TEST(IndirectLight, OfAnEvenlyLitWallIsItsPointFormFactor) {
  auto room = small_room();
  Simulation& s = room.simulation;
  // Albedos: further bounces below 1e-3.
  s.surfaces = simdata::surfaces_of({90, {3, 2}, {2.6, 2.1}, .1, .05, {.01, .012, .008}, {.02, .01, .03}});
  const Three &left_albedo = s.surfaces[0].albedo, &right_albedo = s.surfaces[1].albedo;
  const Screen screen = simdata::room_screen(s);
  const double far = 100;  // a picture of 5 x 3.1 m
  const Eigen::Vector3d middle = screen.surfaces[1]->point(.5, .5),
                        at = middle + far * screen.surfaces[1]->normal(0, 0);
  for (SimulatedProjector& p : s.projectors) {
    p.position = {at.x(), at.y(), at.z()}, p.target = {middle.x(), middle.y(), middle.z()};
    p.throw_ratio = 20, p.lens_shift = {0, 0}, p.roll_deg = 0, p.falloff = 0, p.black_level = 0, p.gain = 1;
  }
  const auto simulator = simulate(room);
  const simdata::TrueLight light = simulator->light(0, std::vector<Picture>{{}, flat(1)});
  const simdata::TrueGeometry g = simulator->geometry(0);
  const Device camera = *simdata::true_camera(s, "camera");
  const std::vector<Eigen::Vector3d> emitter = corners(*screen.surfaces[1]);
  // E on the right wall, from the direct light of a pixel in its middle.
  int checked = 0;
  double irradiance = 0;
  for (int y = 0; y < 150; ++y)
    for (int x = 0; x < 240; ++x)
      if (test::inside_wall(g, x, y) && g.surface.at(x, y) == 1 && irradiance == 0)
        irradiance = light.direct.at(x, y, 0) / simulator->scale(0) / right_albedo[0];
  ASSERT_GT(irradiance, 0);
  for (int y = 3; y < 150; y += 4)
    for (int x = 1; x < 240; x += 3) {
      if (!test::inside_wall(g, x, y) || g.surface.at(x, y) != 0 || (1 - g.u.at(x, y)) * 3 < .03) continue;
      const Ray ray = camera.ray({1. * x, 1. * y});
      const Eigen::Vector3d point = ray.origin + g.depth.at(x, y) * ray.direction.normalized();
      const double F = polygon_form_factor(point, screen.surfaces[0]->normal(0, 0), emitter);
      for (int c = 0; c < 3; ++c) {
        const double expected = simulator->scale(0) * left_albedo[c] * right_albedo[c] * irradiance * F;
        // 256 antithetic strata and linear interpolation between 28 x 20 receivers: 1.5 %, most beside the crease; more
        // where F itself is small.
        EXPECT_NEAR(light.indirect.at(x, y, c) / expected, 1, .015 + 3e-4 / F)
            << x << " " << y << " " << c << " F " << F;
        ++checked;
      }
    }
  EXPECT_GT(checked, 500);
}

// In an even surround of radiance L, walls of albedo 1 vanish: what they reflect equals what they hide.
TEST(IndirectLight, WhiteWallsVanishInAnEvenSurround) {
  auto room = small_room();
  paint(room, {1, 1, 1});
  room.simulation.ambient = .7;
  for (SimulatedProjector& p : room.simulation.projectors) p.black_level = 0;
  const auto dark = simulate(room);
  const simdata::TrueLight light = dark->light(0, std::vector<Picture>{{}, {}});
  double worst = 0, mean = 0;
  for (std::size_t i = 0; i < light.direct.data().size(); ++i) {
    const double shown = (light.direct.data()[i] + light.indirect.data()[i]) / dark->scale(0) / .7;
    worst = std::max(worst, std::abs(shown - 1));
    mean += std::abs(shown - 1) / light.direct.data().size();
  }
  EXPECT_LT(mean, .001);  // quadrature
  EXPECT_LT(worst, .1);   // interpolation beside the ends of the crease, where the walls differ in height
}

TEST(IndirectLight, VanishesWhereOneWallIsBlack) {
  auto room = small_room();
  room.simulation.surfaces[0].albedo = {0, 0, 0};
  const simdata::TrueLight light = simulate(room)->light(0, std::vector<Picture>{flat(1), flat(1)});
  EXPECT_GT(total(light.direct), 100);
  EXPECT_EQ(total(light.indirect), 0);
}

// indirect / direct = rho f1 + rho^2 f2 + ..: doubles with albedo when it is small, more than doubles when it is not.
TEST(IndirectLight, GrowsFasterThanTheAlbedo) {
  const auto ratio = [](double albedo) {
    auto room = small_room();
    paint(room, {albedo, albedo, albedo});
    const simdata::TrueLight light = simulate(room)->light(0, std::vector<Picture>{flat(1), flat(1)});
    return total(light.indirect) / total(light.direct);
  };
  const double tiny = ratio(.001), low = ratio(.4), high = ratio(.8);
  // Through second order, with the form factors of about .2 that two walls have: f2 / f1 between .05 and .4.
  EXPECT_GT(low / .4, tiny / .001 * (1 + .4 * .05));
  EXPECT_LT(low / .4, tiny / .001 * (1 + .4 * .5));
  EXPECT_GT(high, 2.03 * low);
}

TEST(IndirectLight, EqualsPathTracingWithinItsStandardError) {
  auto room = small_room();
  for (SimulatedSurface& wall : room.simulation.surfaces) wall.texture = .15;
  room.simulation.ambient = .05;
  room.simulation.samples = 1024;  // the full number of receivers
  const auto simulator = simulate(room);
  const std::vector<Picture> pictures{test::waves(0), test::waves(1)};
  const simdata::TrueGeometry g = simulator->geometry(0);
  std::vector<Eigen::Vector2d> pixels;
  for (int y = 40; y < 110; y += 13)
    for (int x = 20; x < 230; x += 17)
      if (test::inside_wall(g, x, y)) pixels.emplace_back(x, y);
  ASSERT_GT(pixels.size(), 30u);
  const Image light = simulator->light(0, pictures).indirect;
  const auto traced = simulator->trace_indirect(0, pictures, pixels, 6000);
  double chi2 = 0, bias = 0;
  for (std::size_t i = 0; i < pixels.size(); ++i)
    for (int c = 0; c < 3; ++c) {
      const double shown = light.at(static_cast<int>(pixels[i].x()), static_cast<int>(pixels[i].y()), c);
      const double z = (shown - traced.mean[3 * i + c]) / traced.standard_error[3 * i + c];
      EXPECT_LT(std::abs(z), 5) << pixels[i].transpose() << " " << c;
      chi2 += z * z, bias += z;
    }
  const double n = 3. * pixels.size();
  // Channels of one path are correlated, so n counts a third: 4 sigma.
  EXPECT_NEAR(chi2 / n, 1, 4 * std::sqrt(2 / (n / 3)));
  EXPECT_NEAR(bias / n, 0, 4 / std::sqrt(n / 3));
}

}  // namespace
}  // namespace countershade
