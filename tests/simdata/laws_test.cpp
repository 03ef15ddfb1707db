// Laws of light that hold in whole rooms, whatever they look like.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <numbers>

#include "simdata/render/indirect.h"
#include "simdata/room/paint.h"
#include "tests/simdata/small_room.h"
#include "tests/support/cli.h"

namespace countershade {
namespace {

using simdata::IndirectLight;
using simdata::Receivers;
using simdata::Rgb;
using simdata::RigAndRoom;

constexpr double kPi = std::numbers::pi;

// Indirect irradiance in a room that only daylight lights.
struct Daylit {
  Simulation room;
  std::shared_ptr<const simdata::Scene> scene;
  std::unique_ptr<simdata::Paint> paint;
  std::vector<simdata::Emitter> none;
  std::unique_ptr<IndirectLight> indirect;
  std::vector<Rgb> field;

  explicit Daylit(Simulation given) : room(std::move(given)) {
    scene = *simdata::Scene::make(*simdata::make_shapes(room));
    paint = std::make_unique<simdata::Paint>(room);
    SilentProgress progress;
    indirect = *IndirectLight::make(scene, none, *paint, room, {}, progress);
    field = indirect->solve({}, 0);
  }
  double irradiance(int surface, double u, double v, int channel = 0) const {
    const Receivers::Stencil s = indirect->receivers(surface).stencil(scene->point(surface, u, v));
    double sum = 0;
    for (int i = 0; i < 4; ++i) sum += s.weight[i] * field[surface](s.index[i], channel);
    return sum;
  }
  // Mean over the surface.
  double mean(int surface, int channel = 0) const {
    constexpr int kSteps = 200;
    double sum = 0, area = 0;
    for (int j = 0; j < kSteps; ++j)
      for (int i = 0; i < kSteps; ++i) {
        const double u = (i + .5) / kSteps, v = (j + .5) / kSteps, a = scene->shape(surface).area_element(u, v);
        sum += a * irradiance(surface, u, v, channel), area += a;
      }
    return sum / area;
  }
};

void light_wholly(SimulatedSurface& s, double irradiance) {
  s.daylight = irradiance, s.daylight_from = {0, 0}, s.daylight_to = {1.001, 1.001};
}

// Every wall lit by the same irradiance 1 and of the same albedo rho: radiosity rho / (1 - rho) everywhere.
TEST(WhiteFurnace, ClosedRoomGlowsEvenly) {
  Simulation room = simdata::default_room("closed-room")->simulation;
  room.samples = 256;
  const std::array<double, 3> rho{.5, .8, .95};
  for (SimulatedSurface& s : room.surfaces) s.albedo = rho, light_wholly(s, 1);
  const Daylit lit(room);
  for (int s = 0; s < 6; ++s)
    for (int c = 0; c < 3; ++c)
      for (double u : {.02, .3, .77})
        for (double v : {.04, .5, .98}) {
          const double radiosity = rho[c] * (1 + lit.irradiance(s, u, v, c));
          // Form factors of 256 strata are good to 1e-3; all bounces add up to 1 / (1 - rho) times that.
          EXPECT_NEAR(radiosity * (1 - rho[c]) / rho[c], 1, 2e-3) << s << " " << c << " " << u << " " << v;
        }
}

// Inside a sphere every point sees every other one alike, F_ij = A_j / (4 pi r^2): the interreflection of a part of it
// is the same everywhere, rho E_mean f / (1 - rho f), f = its share of the whole sphere.
TEST(Sphere, InterreflectionIsEvenAndKnown) {
  Simulation room = simdata::default_room("dome")->simulation;
  room.samples = 256;
  SimulatedSurface& dome = room.surfaces[0];
  dome.albedo = {.3, .6, .9};
  dome.azimuth_deg = {-130, 170}, dome.elevation_deg = {-35, 65};
  dome.daylight = 1.3, dome.daylight_from = {.1, .2}, dome.daylight_to = {.4, .7};
  const Daylit lit(room);
  const auto sine = [](double degrees) { return std::sin(degrees * kPi / 180); };
  const double share = 300. / 360 * (sine(65) - sine(-35)) / 2;
  const double lit_share = .3 * 300. / 360 * (sine(-35 + .7 * 100) - sine(-35 + .2 * 100)) / 2;
  for (int c = 0; c < 3; ++c) {
    const double rho = dome.albedo[c], expected = rho * 1.3 * lit_share / (1 - rho * share);
    for (double u : {.03, .2, .55, .96})
      for (double v : {.05, .4, .93}) EXPECT_NEAR(lit.irradiance(0, u, v, c) / expected, 1, .025) << u << " " << v;
    // The rim of the patch cuts strata, at random: each point has .6 % of noise, their mean less.
    EXPECT_NEAR(lit.mean(0, c) / expected, 1, .002);
  }
}

// Howell's catalogue, C-11: equal parallel rectangles a x b at distance c.
double parallel_plates(double a, double b, double c) {
  const double x = a / c, y = b / c, x2 = 1 + x * x, y2 = 1 + y * y;
  return 2 / (kPi * x * y) *
         (.5 * std::log(x2 * y2 / (1 + x * x + y * y)) + x * std::sqrt(y2) * std::atan(x / std::sqrt(y2)) +
          y * std::sqrt(x2) * std::atan(y / std::sqrt(x2)) - x * std::atan(x) - y * std::atan(y));
}
// C-14: rectangles l x w (from) and l x h (to) at right angles, common edge l.
double perpendicular_plates(double l, double w, double h) {
  const double W = w / l, H = h / l, W2 = W * W, H2 = H * H, s = std::sqrt(H2 + W2);
  const double A = (1 + W2) * (1 + H2) / (1 + W2 + H2);
  const double B = W2 * (1 + W2 + H2) / ((1 + W2) * (W2 + H2)), C = H2 * (1 + H2 + W2) / ((1 + H2) * (H2 + W2));
  return 1 / (kPi * W) *
         (W * std::atan(1 / W) + H * std::atan(1 / H) - s * std::atan(1 / s) +
          .25 * std::log(A * std::pow(B, W2) * std::pow(C, H2)));
}

TEST(Plates, ExchangeLightByTheCataloguesFormFactors) {
  EXPECT_NEAR(parallel_plates(1, 1, 1), .199825, 1e-6);
  EXPECT_NEAR(perpendicular_plates(1, 1, 1), .200044, 1e-6);
  Simulation room;
  room.samples = 1024;
  room.surfaces.resize(2);
  SimulatedSurface &a = room.surfaces[0], &b = room.surfaces[1];
  a.id = "a", b.id = "b";
  a.albedo = b.albedo = {1e-3, 1e-3, 1e-3};  // one reflection
  light_wholly(a, 1);
  a.origin = {0, 0, 0}, a.along_u = {1.7, 0, 0}, a.along_v = {0, 1.1, 0};
  b.origin = {1.7, 0, .8}, b.along_u = {-1.7, 0, 0}, b.along_v = {0, 1.1, 0};
  EXPECT_NEAR(Daylit(room).mean(1) / 1e-3 / parallel_plates(1.7, 1.1, .8), 1, 1e-3);
  // b stands on a's right side; by reciprocity the mean irradiance of b is F_ba.
  b.origin = {1.7, 0, 0}, b.along_u = {0, 0, .9}, b.along_v = {0, 1.1, 0};
  EXPECT_NEAR(Daylit(room).mean(1) / 1e-3 / perpendicular_plates(1.1, .9, 1.7), 1, 3e-3);  // steep beside the edge
}

// What comes in equals what all walls absorb.
TEST(ClosedRoom, AbsorbsWhatComesIn) {
  Simulation room = simdata::default_room("closed-room")->simulation;
  room.samples = 1024;
  room.surfaces[2].patchwork = 0;
  room.surfaces[1].daylight = 2, room.surfaces[1].daylight_from = {.2, .3}, room.surfaces[1].daylight_to = {.6, .9};
  room.surfaces[4].daylight = .5, room.surfaces[4].daylight_from = {.1, .05}, room.surfaces[4].daylight_to = {.3, .5};
  const Daylit lit(room);
  for (int c = 0; c < 3; ++c) {
    double in = 0, absorbed = 0;
    for (int s = 0; s < 6; ++s) {
      const SimulatedSurface& wall = room.surfaces[s];
      const double area = lit.scene->shape(s).area_element(.5, .5),
                   share =
                       (wall.daylight_to[0] - wall.daylight_from[0]) * (wall.daylight_to[1] - wall.daylight_from[1]);
      const double direct = wall.daylight * share * area;
      in += direct;
      absorbed += (1 - wall.albedo[c]) * (direct + area * lit.mean(s, c));
    }
    EXPECT_NEAR(absorbed / in, 1, 3e-3) << c;  // interpolation beside the edges
  }
}

// ---- devices in rooms ----

// A camera that is exactly like a projector, with its place.
RigAndRoom twins(bool swapped) {
  RigAndRoom made = test::small_room();
  made.rig.projectors.resize(1), made.simulation.projectors.resize(1);
  made.simulation.samples = 1024;
  for (SimulatedSurface& wall : made.simulation.surfaces) wall.texture = .2;
  made.rig.projectors[0].resolution = {160, 100};
  SimulatedProjector& p = made.simulation.projectors[0];
  SimulatedCamera& c = made.simulation.cameras[0];
  const std::array<double, 3> here{-1.1, 1.6, 3.9}, there{1.2, 1.0, 4.3}, at{.1, 1.1, .2};
  p.throw_ratio = 1.1, p.lens_shift = {0, 0}, p.roll_deg = 0, p.falloff = 0, p.black_level = 0, p.gain = 1;
  p.defocus_sigma_px = 0;
  c.resolution = {160, 100}, c.focal_px = 1.1 * 160, c.principal = {79.5, 49.5}, c.distortion = {0, 0, 0, 0, 0};
  c.roll_deg = 0, c.psf_sigma_px = 0;
  p.position = swapped ? here : there, c.position = swapped ? there : here;
  p.target = c.target = at;
  return made;
}

// Mean indirect radiance on a square of the camera's pixels per flux of a square of the projector's.
double transport(bool swapped, std::array<int, 2> lit, std::array<int, 2> seen) {
  constexpr int kSide = 12;
  RigAndRoom room = twins(swapped);
  room.simulation.block_px = 4;
  const auto simulator = test::simulate(room);
  const std::vector<Picture> pictures{test::picture([&](int x, int y, int) {
    return x >= lit[0] && x < lit[0] + kSide && y >= lit[1] && y < lit[1] + kSide ? 1. : 0.;
  })};
  const simdata::TrueLight light = simulator->light(0, pictures);
  double sum = 0;
  for (int y = seen[1]; y < seen[1] + kSide; ++y)
    for (int x = seen[0]; x < seen[0] + kSide; ++x) sum += light.indirect.at(x, y, 1);
  // The flux per pixel from the direct light that one pixel sees: E = power throw^2 W / H cos / (r^2 cos^3 alpha).
  const Picture white = test::flat(1);
  const simdata::TrueLight all = simulator->light(0, std::vector<Picture>{white});
  const simdata::TrueGeometry g = simulator->geometry(0);
  const Device camera = *simdata::true_camera(room.simulation, "camera");
  for (int y = 30; y < 70; ++y)
    for (int x = 20; x < 140; ++x)
      if (test::inside_wall(g, x, y) && g.projector_x[0].at(x, y) > 8 && g.projector_x[0].at(x, y) < 150 &&
          g.projector_y[0].at(x, y) > 8 && g.projector_y[0].at(x, y) < 90) {
        const Ray ray = camera.ray({1. * x, 1. * y});
        const Eigen::Vector3d at = ray.origin + g.depth.at(x, y) * ray.direction;
        const Eigen::Vector3d normal(g.normal.at(x, y, 0), g.normal.at(x, y, 1), g.normal.at(x, y, 2));
        const Device projector = *simdata::true_projector(room.simulation, room.rig, room.rig.projectors[0].id);
        const Eigen::Vector3d to = projector.position() - at;
        const double r = to.norm(), cos_alpha = (projector.device_from_world * at).z() / r;
        const double unit =
            g.albedo.at(x, y, 1) * 1.1 * 1.1 * 1.6 * normal.dot(to) / (r * r * r * std::pow(cos_alpha, 3));
        return sum / (all.direct.at(x, y, 1) / unit);
      }
  ADD_FAILURE() << "no pixel that sees the picture";
  return 0;
}

TEST(Reciprocity, CameraAndProjectorCanBeSwapped) {
  for (const auto& [a, b] :
       {std::pair{std::array{30, 40}, std::array{110, 44}}, {std::array{118, 30}, std::array{52, 60}}}) {
    const double there = transport(false, a, b), back = transport(true, b, a);
    EXPECT_GT(there, 0);
    EXPECT_NEAR(back / there, 1, .02);  // 1024 strata against squares of 12 pixels; the squares' rims cross blocks
  }
}

TEST(PathTracing, StandardErrorHalvesWithFourTimesThePaths) {
  const auto simulator = test::simulate(test::small_room());
  const std::vector<Picture> pictures{test::waves(0), test::waves(1)};
  const std::vector<Eigen::Vector2d> pixels{{60, 70}, {90, 60}, {100, 75}, {115, 80}, {140, 70}, {170, 72}};
  const auto few = simulator->trace_indirect(0, pictures, pixels, 10000),
             many = simulator->trace_indirect(0, pictures, pixels, 40000);
  double ratio = 0;
  for (std::size_t i = 0; i < few.mean.size(); ++i)
    ratio += few.standard_error[i] / many.standard_error[i] / few.mean.size();
  // One path in twenty brings light: an error's own error is about 2 % of it, and six pixels count.
  EXPECT_NEAR(ratio, 2, .08);
}

// Of a typical pixel, between renderings that differ in their seed alone. (Beside the crease strata are split until
// they are small against their distance, however many samples there are, and noise is the same.)
double noise(int samples) {
  std::vector<Image> images;
  for (std::uint64_t seed : {11, 12, 13, 14}) {
    RigAndRoom room = test::small_room();
    room.simulation.samples = samples, room.simulation.seed = seed;
    const auto simulator = test::simulate(room);
    images.push_back(simulator->light(0, std::vector<Picture>{test::waves(0), test::waves(1)}).indirect);
    for (float& v : images.back().data()) v /= static_cast<float>(simulator->scale(0));
  }
  std::vector<double> variances;
  for (std::size_t i = 0; i < images[0].data().size(); ++i) {
    double mean = 0, square = 0;
    for (const Image& image : images) mean += image.data()[i] / 4., square += std::pow(image.data()[i], 2) / 4.;
    if (mean > 0) variances.push_back(std::max(0., square - mean * mean));
  }
  std::nth_element(variances.begin(), variances.begin() + variances.size() / 2, variances.end());
  return std::sqrt(variances[variances.size() / 2]);
}

// Random strata would halve it; pairs of points that mirror each other do at least as well.
TEST(FastPath, NoiseAtLeastHalvesWithFourTimesTheSamples) {
  const double coarse = noise(225), fine = noise(900);
  EXPECT_LT(fine, .55 * coarse);
  EXPECT_GT(fine, .02 * coarse);
}

class RoomTest : public ::testing::TestWithParam<std::string> {};

// The fast path against path tracing, in every room that there is.
TEST_P(RoomTest, FastPathIsFullPathTracing) {
  testing::TemporaryFolder folder;
  RigAndRoom room = simdata::smaller(*simdata::default_room(GetParam()), 8, 8, 256);
  room.simulation.block_px = 4;
  for (const auto& [name, contents] : room.files) std::ofstream(folder / name) << contents;
  for (SimulatedSurface& s : room.simulation.surfaces)
    if (!s.mesh.empty()) s.mesh = folder / s.mesh.string();
  const auto simulator = test::simulate(room);
  std::vector<Picture> pictures;
  for (int q = 0; q < static_cast<int>(room.rig.projectors.size()); ++q) pictures.push_back(test::waves(q));
  const simdata::TrueLight light = simulator->light(0, pictures);
  const simdata::TrueGeometry g = simulator->geometry(0);
  std::vector<Eigen::Vector2d> pixels;
  for (int y = 6; y < 148; y += 13)
    for (int x = 7; x < 236; x += 19)
      if (test::inside_wall(g, x, y)) pixels.emplace_back(x, y);
  ASSERT_GT(pixels.size(), 30u);
  const auto traced = simulator->trace_indirect(0, pictures, pixels, 3000);
  double chi2 = 0, deviation = 0, mean = 0, variance = 0;
  for (std::size_t i = 0; i < pixels.size(); ++i) {
    const double fast = light.indirect.at(static_cast<int>(pixels[i].x()), static_cast<int>(pixels[i].y()), 1);
    // A draft has few receivers: a hundredth of the light, and .2 % of full scale beside edges.
    const double error = std::hypot(traced.standard_error[3 * i + 1], .01 * traced.mean[3 * i + 1] + .002);
    const double z = (fast - traced.mean[3 * i + 1]) / error;
    EXPECT_LT(std::abs(z), 4.5) << pixels[i].transpose();
    chi2 += z * z / pixels.size();
    deviation += fast - traced.mean[3 * i + 1], mean += traced.mean[3 * i + 1];
    variance += std::pow(traced.standard_error[3 * i + 1], 2);
  }
  EXPECT_LT(chi2, 1.4);
  EXPECT_GT(mean, 0);
  EXPECT_LT(std::abs(deviation), 4 * std::sqrt(variance) + .005 * mean);  // a draft's interpolation; gloss
}

std::vector<std::string> all_rooms() {
  std::vector<std::string> names;
  for (const auto& [name, what] : simdata::room_kinds()) names.push_back(name);
  return names;
}
INSTANTIATE_TEST_SUITE_P(All, RoomTest, ::testing::ValuesIn(all_rooms()), [](const auto& info) {
  std::string name = info.param;
  std::erase(name, '-');
  return name;
});

}  // namespace
}  // namespace countershade
