#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <cmath>
#include <numbers>

#include "simdata/render/emitter.h"
#include "tests/simdata/small_room.h"

namespace countershade {
namespace {

using test::flat;
using test::simulate;
using test::small_room;

// One simulator of the small room for all tests that change nothing.
const simdata::Simulator& shared() {
  static const auto simulator = simulate(small_room());
  return *simulator;
}

Eigen::Vector3d vector(const std::array<double, 3>& a) {
  return {a[0], a[1], a[2]};
}

// The inverse square law from the projector's place, throw and axis alone.
double irradiance(const SimulatedProjector& p, const Eigen::Vector3d& x, const Eigen::Vector3d& normal) {
  const Eigen::Vector3d ray = x - vector(p.position), axis = (vector(p.target) - vector(p.position)).normalized();
  const double r = ray.norm(), cos_theta = -normal.dot(ray) / r, cos_alpha = axis.dot(ray) / r;
  return p.gain * p.throw_ratio * p.throw_ratio * cos_theta / (r * r * std::pow(cos_alpha, 3));
}

TEST(DirectLight, FollowsTheInverseSquareLawOfEachProjector) {
  auto room = small_room();
  for (SimulatedProjector& p : room.simulation.projectors) p.falloff = 0, p.black_level = 0;
  const auto simulator = simulate(room);
  const simdata::TrueGeometry g = simulator->geometry(0);
  const Device camera = *simdata::true_camera(room.simulation, "camera");
  const Image lit[2] = {simulator->light(0, std::vector<Picture>{flat(1), flat(0)}).direct,
                        simulator->light(0, std::vector<Picture>{flat(0), flat(1)}).direct};
  const std::array<double, 3>* albedo[2] = {&room.simulation.surfaces[0].albedo, &room.simulation.surfaces[1].albedo};
  double reference = 0;
  int checked = 0;
  for (int y = 3; y < 150; y += 7)
    for (int x = 2; x < 240; x += 5)
      for (int q = 0; q < 2; ++q) {
        const double column = g.projector_x[q].at(x, y), row = g.projector_y[q].at(x, y);
        if (!test::inside_wall(g, x, y) || !(column > 4 && column < 155 && row > 4 && row < 95)) continue;
        const Ray ray = camera.ray({1. * x, 1. * y});
        const Eigen::Vector3d point = ray.origin + g.depth.at(x, y) * ray.direction.normalized();
        const Eigen::Vector3d normal(g.normal.at(x, y, 0), g.normal.at(x, y, 1), g.normal.at(x, y, 2));
        for (int c = 0; c < 3; ++c) {
          const double expected = (*albedo[static_cast<int>(g.surface.at(x, y))])[c] *
                                  irradiance(room.simulation.projectors[q], point, normal);
          const double ratio = lit[q].at(x, y, c) / expected;
          if (reference == 0) reference = ratio;
          // A pixel is a few centimetres of wall: its mean differs from its centre by second order, < .2 %.
          EXPECT_NEAR(ratio / reference, 1, .002) << x << " " << y << " " << q << " " << c;
          ++checked;
        }
      }
  EXPECT_GT(checked, 500);
}

TEST(DirectLight, ReferenceIrradianceIsOneAtTheWorkingDistanceOfTheFirstProjector) {
  auto room = small_room();
  for (SimulatedProjector& p : room.simulation.projectors) p.falloff = 0, p.black_level = 0;
  const auto simulator = simulate(room);
  const simdata::TrueGeometry g = simulator->geometry(0);
  const Image lit = simulator->light(0, std::vector<Picture>{flat(1), flat(0)}).direct;
  const Device camera = *simdata::true_camera(room.simulation, "camera");
  const SimulatedProjector& p = room.simulation.projectors[0];
  double checked = 0;
  for (int y = 60; y < 90; y += 5)
    for (int x = 30; x < 110; x += 5) {
      if (g.surface.at(x, y) != 0 || std::isnan(g.projector_x[0].at(x, y))) continue;
      const Ray ray = camera.ray({1. * x, 1. * y});
      const Eigen::Vector3d point = ray.origin + g.depth.at(x, y) * ray.direction.normalized();
      const Eigen::Vector3d normal(g.normal.at(x, y, 0), g.normal.at(x, y, 1), g.normal.at(x, y, 2));
      const double unit = irradiance(p, point, normal) / (p.throw_ratio * p.throw_ratio);
      const double distance =
          std::sqrt(lit.at(x, y, 0) / simulator->scale(0) / room.simulation.surfaces[0].albedo[0] / unit);
      EXPECT_GT(distance, 3.5);
      EXPECT_LT(distance, 4.6);  // the projector stands 3.5 to 4.6 m from its wall's points
      ++checked;
    }
  EXPECT_GT(checked, 20);
}

TEST(Emitter, GivesTheSameFluxAtAnyThrowShiftResolutionAndDistortion) {
  Simulation room;  // a wall of 40 m that catches every picture
  room.surfaces = simdata::surfaces_of({170, {20, 20}, {20, 20}, -9, -9});
  const auto scene = *simdata::Scene::make(*simdata::make_shapes(room));
  std::vector<double> flux;
  for (int i = 0; i < 4; ++i) {
    SimulatedProjector p;
    p.id = "p";
    p.position = {.3, 1, 4}, p.target = {-.4 + i % 3, .7, .4};
    p.falloff = 0, p.throw_ratio = 1 + .4 * (i % 3), p.lens_shift = {.1 * (i % 3), -.2 * (i % 3)};
    if (i == 3) p.distortion = {-.15, .04, .02, -.015, .01};  // densities of .6 to 1.3 of the undistorted ones
    Rig rig;
    rig.projectors.resize(1);
    rig.projectors[0].id = "p";
    rig.projectors[0].resolution = {160 + 80 * i, 100 + 50 * i};
    room.projectors = {p};
    const simdata::Emitter emitter(p, *simdata::true_projector(room, rig, "p"), 8);
    double sum = 0;
    constexpr int kGrid = 2000;
    for (int s = 0; s < 2; ++s)
      for (int b = 0; b < kGrid; ++b)
        for (int a = 0; a < kGrid; ++a) {
          const double u = (a + .5) / kGrid, v = (b + .5) / kGrid;
          const simdata::SurfacePoint x = scene->point(s, u, v);
          if ((x.x - Eigen::Vector3d(0, 1, 0)).norm() > 5) continue;
          if (const auto beam = emitter.beam(*scene, x)) sum += beam->irradiance * 400. / (kGrid * kGrid);
        }
    flux.push_back(sum);
  }
  // power 1 m^2 means flux 1; cells of a centimetre on a picture of two metres leave .5 %.
  for (double f : flux) EXPECT_NEAR(f, 1, .005);
}

TEST(Emitter, LightsNothingBeyondTheFoldOfItsDistortion) {
  Simulation room;
  room.surfaces = simdata::surfaces_of({170, {20, 20}, {20, 20}, -9, -9});
  const auto scene = *simdata::Scene::make(*simdata::make_shapes(room));
  SimulatedProjector p;
  p.id = "p", p.position = {0, 1, 4}, p.target = {0, 1, 0};
  p.distortion = {-.3, 0, 0, 0, 0};  // folds at a tangent of 1.05
  Rig rig;
  rig.projectors.resize(1);
  rig.projectors[0].id = "p", rig.projectors[0].resolution = {160, 100};
  room.projectors = {p};
  const Device device = *simdata::true_projector(room, rig, "p");
  const simdata::Emitter emitter(p, device, 8);
  int lit = 0, folded = 0;
  for (int i = 1; i < 200; ++i) {
    const simdata::SurfacePoint x = scene->point(1, i / 200., .5);
    const Eigen::Vector3d seen = device.device_from_world * x.x;
    const bool beyond = std::abs(seen.x() / seen.z()) > 1.05;
    const auto beam = emitter.beam(*scene, x);
    EXPECT_FALSE(beyond && beam) << i;
    folded += beyond && device.lens.contains(device.project(x.x));
    lit += beam.has_value();
  }
  EXPECT_GT(lit, 10);
  EXPECT_GT(folded, 10);
}

TEST(DirectLight, GreyPictureGivesBlackLevelPlusGammaOfItsValue) {
  const std::vector<Picture> white{flat(1), flat(1)}, grey{flat(.5), flat(.5)}, black{{}, {}};
  const Image w = shared().light(0, white).direct, g = shared().light(0, grey).direct,
              b = shared().light(0, black).direct;
  const double expected = .001 + .999 * std::pow(std::lround(65535 * .5) / 65535., 2.2);
  double brightest = 0;
  for (std::size_t i = 0; i < w.data().size(); ++i) {
    EXPECT_NEAR(g.data()[i], expected * w.data()[i], 1e-6);
    EXPECT_NEAR(b.data()[i], .001 * w.data()[i], 1e-6);
    brightest = std::max<double>(brightest, w.data()[i]);
  }
  EXPECT_GT(brightest, .3);
}

TEST(DirectLight, ComesFromTheProjectorPixelThatTheGeometryNames) {
  const int edge = 71;
  const std::vector<Picture> pictures{test::picture([](int x, int y, int) { return x < edge && y > 33 ? 1. : 0.; }),
                                      {}};
  const Image lit = shared().light(0, pictures).direct;
  const Image all = shared().light(0, std::vector<Picture>{flat(1), {}}).direct;
  const simdata::TrueGeometry g = shared().geometry(0);
  int on = 0, off = 0;
  for (int y = 0; y < 150; ++y)
    for (int x = 0; x < 240; ++x) {
      const double column = g.projector_x[0].at(x, y), row = g.projector_y[0].at(x, y);
      // Three projector pixels of margin: defocus, interpolation, and the camera pixel's own size.
      if (!test::inside_wall(g, x, y) || !(column > 3 && column < 156 && row > 3 && row < 96)) continue;
      if (std::abs(column - edge) < 3 || std::abs(row - 33.5) < 3) continue;
      const bool bright = column < edge && row > 33.5;
      EXPECT_NEAR(lit.at(x, y, 1) / all.at(x, y, 1), bright ? 1 : .001, .01) << x << " " << y;
      (bright ? on : off) += 1;
    }
  EXPECT_GT(on, 500);
  EXPECT_GT(off, 500);
}

TEST(Light, IsLinearInThePattern) {
  const auto left_half = [](int x, int, int c) { return x < 70 + 3 * c ? .7 : 0.; };
  const auto right_half = [](int x, int, int c) { return x < 70 + 3 * c ? 0. : .4; };
  const auto both = [&](int x, int y, int c) { return left_half(x, y, c) + right_half(x, y, c); };
  const auto light = [&](auto value) {
    return shared().light(0, std::vector<Picture>{test::picture(value), test::picture(value)});
  };
  const simdata::TrueLight a = light(left_half), b = light(right_half), sum = light(both),
                           black = shared().light(0, std::vector<Picture>{{}, {}});
  for (std::size_t i = 0; i < sum.direct.data().size(); ++i) {  // single precision of values below 1
    EXPECT_NEAR(sum.direct.data()[i], a.direct.data()[i] + b.direct.data()[i] - black.direct.data()[i], 1e-6);
    EXPECT_NEAR(sum.indirect.data()[i], a.indirect.data()[i] + b.indirect.data()[i] - black.indirect.data()[i], 2e-6);
  }
}

TEST(Light, BrightestWhiteComesToTheWhiteLevel) {
  const simdata::TrueLight white = shared().light(0, std::vector<Picture>{flat(1), flat(1)});
  std::vector<float> brightest;
  for (std::size_t i = 0; i < white.direct.pixels(); ++i) {
    float most = 0;
    for (int c = 0; c < 3; ++c)
      most = std::max(most, white.direct.data()[3 * i + c] + white.indirect.data()[3 * i + c]);
    brightest.push_back(most);
  }
  std::sort(brightest.begin(), brightest.end());
  EXPECT_NEAR(brightest[static_cast<std::size_t>(.999 * brightest.size())], .8, 1e-3);
}

TEST(Light, DoesNotDependOnTheNumberOfThreads) {
  const std::vector<Picture> pictures{test::waves(0), test::waves(1)};
  simdata::TrueLight light[2];
  for (int threads : {1, 2}) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    light[threads - 1] = simulate(small_room())->light(0, pictures);
  }
  EXPECT_EQ(light[0].direct.data(), light[1].direct.data());
  EXPECT_EQ(light[0].indirect.data(), light[1].indirect.data());
}

TEST(Camera, VignettingTakesItsShareOfTheCorner) {
  auto room = small_room();
  const double plain = simulate(room)->scale(0);
  const Image without = shared().light(0, std::vector<Picture>{flat(1), flat(1)}).direct;
  room.simulation.cameras[0].vignetting = .3;
  const auto simulator = simulate(room);
  const Image with = simulator->light(0, std::vector<Picture>{flat(1), flat(1)}).direct;
  for (const auto& [x, y] : {std::pair{20, 60}, {120, 75}, {225, 110}}) {
    const double dx = x - 119.5, dy = y - 74.5;
    const double expected = 1 - .3 * (dx * dx + dy * dy) / (120. * 120 + 75 * 75);
    EXPECT_NEAR(with.at(x, y, 0) / simulator->scale(0) / (without.at(x, y, 0) / plain), expected, 1e-5);
  }
}

TEST(Make, ImpossibleRoomsAreRefusedByName) {
  SilentProgress progress;
  auto room = small_room();
  room.simulation.surfaces[0].albedo[1] = 1.2;
  auto made = simdata::Simulator::make(room.rig, room.simulation, progress);
  ASSERT_FALSE(made.has_value());
  EXPECT_EQ(made.error().code, ErrorCode::kBadValue);
  EXPECT_NE(made.error().message.find("albedo"), std::string::npos) << made.error().message;
  room = small_room();
  room.simulation.projectors[1].target = {0, 0, 100};
  EXPECT_NE(simdata::Simulator::make(room.rig, room.simulation, progress).error().message.find("right"),
            std::string::npos);
  room = small_room();
  room.simulation.cameras.clear();
  EXPECT_FALSE(simdata::Simulator::make(room.rig, room.simulation, progress).has_value());
}

// Defocus spreads a pixel by the same Gaussian along both axes, also beyond the picture's rim.
TEST(Emitter, DefocusIsAGaussianAlongBothAxes) {
  const auto room = small_room();
  SimulatedProjector spec = room.simulation.projectors[0];
  spec.defocus_sigma_px = 1.5;
  spec.black_level = 0;
  const Device device = *simdata::true_projector(room.simulation, room.rig, spec.id);
  const simdata::Emitter emitter(spec, device, 16);
  for (const auto& [x0, y0] : {std::pair{37, 33}, std::pair{0, 99}}) {  // across two blocks, and in a corner
    Picture dot(160, 100, 3);
    for (int c = 0; c < 3; ++c) dot.at(x0, y0, c) = 65535;
    const simdata::PictureLight light = emitter.light_of(dot);
    double norm = 0;
    for (int k = -6; k <= 6; ++k) norm += std::exp(-0.5 * k * k / 2.25);
    for (int dy = -4; dy <= 4; ++dy)
      for (int dx = -4; dx <= 4; ++dx) {
        const double expected = std::exp(-0.5 * (dx * dx + dy * dy) / 2.25) / (norm * norm);
        EXPECT_NEAR(light.at(static_cast<float>(x0 + dx), static_cast<float>(y0 + dy))[1], expected, 1e-6)  // float
            << x0 << " " << dx << " " << dy;
      }
  }
}

}  // namespace
}  // namespace countershade
