// What a slip of the pen would change without any law of light noticing: closed forms of single parts.
#include <gtest/gtest.h>
#include <cmath>
#include "simdata/render/emitter.h"
#include "simdata/render/indirect.h"
#include "simdata/render/patch_truth.h"
#include "simdata/room/mesh.h"
#include "simdata/room/paint.h"
#include "simdata/room/room_check.h"
#include "tests/simdata/small_room.h"
namespace countershade {
namespace {

SimulatedSurface part(const char* shape, std::array<double, 2> azimuth) {
  SimulatedSurface s;
  s.id = "s", s.shape = shape, s.origin = {.3, -.2, .7}, s.radius = 2.3, s.top_radius = 1.1, s.height = 1.9;
  s.azimuth_deg = azimuth, s.elevation_deg = {-20, 70};
  return s;
}
TEST(RoundShape, BeyondHalfATurnAndAtItsFirstRim) {
  for (const char* k : {"cylinder", "cone", "sphere"}) {
    const auto far = *simdata::make_shape(part(k, {130, 260}));
    for (double u : {.02, .41, .97}) {
      const auto p = far->at(u, .37);
      const auto hit = far->intersect({p.x + .3 * p.normal, -p.normal}, 0);
      ASSERT_TRUE(hit) << k << u;
      EXPECT_NEAR(hit->u, u, 1e-9);
    }
    SimulatedSurface s = part(k, {-50, 95});
    const auto one = *simdata::make_shape(s);
    s.azimuth_deg[0] -= 1e-9;
    const auto rim = (*simdata::make_shape(s))->at(0, .37);
    EXPECT_TRUE(one->intersect({rim.x + .3 * rim.normal, -rim.normal}, 0)) << k;
  }
}
TEST(Enclosure, InsideOnlyAndOnlyWhenLitFromInside) {
  for (const char* k : {"cylinder", "sphere"}) {
    SimulatedSurface s = part(k, {-50, 95});
    const Eigen::Vector3d in(.3 + 1.4, .1, .7 - 1.1), out(.3 + 1.9, .1, .7 - 1.6);
    EXPECT_TRUE((*simdata::make_shape(s))->encloses(in));
    EXPECT_FALSE((*simdata::make_shape(s))->encloses(out));
    s.lit = "outside";
    EXPECT_FALSE((*simdata::make_shape(s))->encloses(in));
  }
}
TEST(MeshShape, TriangleIsNoParallelogramAndItsChartHasTwoAxes) {
  const simdata::MeshShape m(
      {{{0, 0, 0}, {3, 0, 0}, {0, 0, -2}}, std::vector<Eigen::Vector3d>(3, {0, 1, 0}), {{0, 1, 2}}});
  EXPECT_FALSE(m.intersect({{2, 1, -1.5}, {0, -1, 0}}, 0));
  const auto hit = m.intersect({{.6, 1, -.5}, {0, -1, 0}}, 0);
  ASSERT_TRUE(hit);
  EXPECT_NEAR(static_cast<const simdata::Shape&>(m).at(*hit).u, .2, 1e-9);
  EXPECT_NEAR(static_cast<const simdata::Shape&>(m).at(*hit).v, .75, 1e-9);
}
TEST(Beam, HasFalloffAndPassesAScreenFromBehindOnly) {
  auto room = test::small_room();
  auto p = room.simulation.projectors[0];
  p.falloff = .24, p.distortion = {};
  const Device device = *simdata::true_projector(room.simulation, room.rig, p.id);
  const simdata::Emitter with(p, device, 8);
  p.falloff = 0;
  const simdata::Emitter without(p, device, 8);
  const auto shapes = *simdata::make_shapes(room.simulation);
  const auto scene = *simdata::Scene::make(shapes, {.37, .6});
  const auto at = scene->point(0, .3, .7);
  const auto a = with.beam(*scene, at), b = without.beam(*scene, at);
  ASSERT_TRUE(a && b);
  const double dx = b->pixel.x() - 79.5, dy = b->pixel.y() - 49.5;
  EXPECT_NEAR(a->irradiance / b->irradiance, 1 - .24 * 4 * (dx * dx + dy * dy) / (160. * 160 + 100 * 100), 1e-12);
  auto turned = at;
  turned.normal = -at.normal;
  const auto c = without.beam(*scene, turned);
  EXPECT_NEAR(b->irradiance / (*without.beam(**simdata::Scene::make(shapes, {0, 0}), at)).irradiance, 1, 1e-12);
  ASSERT_TRUE(c);
  EXPECT_NEAR(c->irradiance / b->irradiance, .37, 1e-12);
}
TEST(TrueGeometry, NamesItsChartAndPaintsItsTexture) {
  auto room = test::small_room();
  room.simulation.surfaces[0].texture = .3, room.simulation.surfaces[0].albedo = {.5, .6, .4};
  const auto sim = test::simulate(room);
  const auto g = sim->geometry(0);
  const Device camera = *simdata::true_camera(room.simulation, "camera");
  const auto shapes = *simdata::make_shapes(room.simulation);
  int n = 0;
  for (int y = 50; y < 100; y += 9)
    for (int x = 40; x < 200; x += 11) {
      const int s = g.surface.at(x, y);
      if (s < 0) continue;
      ++n;
      const double u = g.u.at(x, y), v = g.v.at(x, y);
      const Ray r = camera.ray({1. * x, 1. * y});
      EXPECT_NEAR((shapes[s]->at(u, v).x - r.origin - g.depth.at(x, y) * r.direction).norm(), 0, 1e-5);
      if (s == 0) {
        EXPECT_NEAR(g.albedo.at(x, y, 1) / room.simulation.surfaces[0].albedo[1],
                    1 + .3 * std::sin(2.9 * u + 1.7 * v + .8) * std::cos(4.3 * v - 1.1 * u), 1e-5);
      }
    }
  EXPECT_GT(n, 30);
}
TEST(SmallerRoom, PixelsKeepTheirPlaces) {
  const auto big = simdata::default_two_wall();
  const auto small = simdata::smaller(big, 8, 8, 64);
  const auto a = big.simulation.cameras[0].principal, b = small.simulation.cameras[0].principal;
  for (int i : {0, 1}) EXPECT_NEAR(8 * (b[i] + .5), a[i] + .5, 1e-9);
}
TEST(Roll, TurnsProjectorsAsItTurnsCameras) {
  auto room = test::small_room();
  auto& c = room.simulation.cameras[0];
  auto& p = room.simulation.projectors[0];
  c.position = p.position, c.target = p.target, c.roll_deg = p.roll_deg = 9;
  EXPECT_NEAR((Eigen::Matrix3d(simdata::true_camera(room.simulation, c.id)->device_from_world.rotation) -
               Eigen::Matrix3d(simdata::true_projector(room.simulation, room.rig, p.id)->device_from_world.rotation))
                  .norm(),
              0, 1e-12);
}
std::string refused(const simdata::RigAndRoom& r) {
  SilentProgress q;
  auto m = simdata::Simulator::make(r.rig, r.simulation, q);
  return m ? "" : m.error().message;
}
TEST(ImpossibleRoom, IsRefusedByItsCause) {
  auto r = test::small_room();
  r.simulation.cameras[0].position = {.2, 1, -3}, r.simulation.cameras[0].target = {0, 1, 0};
  EXPECT_NE(refused(r).find("sees no light"), std::string::npos) << "backs are black";
  r = test::small_room();
  r.simulation.projectors[1].position = {0, 1, 0};
  EXPECT_NE(refused(r).find("stands in"), std::string::npos);
  r = test::small_room();
  r.simulation.surfaces[1].albedo = {.4, .6, .5}, r.simulation.surfaces[1].transmission = .9;
  EXPECT_NE(refused(r).find("transmission"), std::string::npos);
  r = test::small_room();
  r.simulation.projectors[1].target = r.simulation.projectors[1].position, r.simulation.projectors[1].target[1] -= 1;
  EXPECT_NE(refused(r).find("straight up or down"), std::string::npos);
}
TEST(Gloss, EachCameraHasItsOwn) {
  auto both = simdata::smaller(*simdata::default_room("glossy"), 8, 8, 64);
  both.simulation.block_px = 8;
  for (auto& s : both.simulation.surfaces) s.roughness = .15;
  auto spec = both.rig.cameras[0];
  auto cam = both.simulation.cameras[0];
  spec.id = cam.id = "second";
  cam.position[0] += 1.3, cam.position[1] += .4;
  auto one = both;
  both.rig.cameras.push_back(spec), both.simulation.cameras.push_back(cam);
  one.rig.cameras = {spec}, one.simulation.cameras = {cam};
  const auto a = test::simulate(both), b = test::simulate(one);
  std::vector<Picture> pictures{test::waves(0), test::waves(1)};
  EXPECT_EQ(a->light(1, pictures).indirect.data(), b->light(0, pictures).indirect.data());
}
TEST(Surround, BacksHideTheSurroundToo) {
  for (bool back : {false, true}) {
    Simulation room;
    room.samples = 256, room.surfaces.resize(2);
    auto &a = room.surfaces[0], &b = room.surfaces[1];
    a.id = "a", b.id = "b";
    a.origin = {0, 0, 0}, a.along_u = {1.7, 0, 0}, a.along_v = {0, 1.1, 0};
    b.origin = {back ? 0. : 1.7, 0, .8}, b.along_u = {back ? 1.7 : -1.7, 0, 0}, b.along_v = {0, 1.1, 0};
    const auto scene = *simdata::Scene::make(*simdata::make_shapes(room), {0, 0});
    const simdata::Paint paint(room);
    const std::vector<simdata::Emitter> none;
    SilentProgress q;
    const auto light = *simdata::IndirectLight::make(scene, none, paint, room, {}, q);
    EXPECT_NEAR(1 - light->escape(0).mean(), 0.35567, .003) << back;
  }
}
TEST(Layout, RoundSurfacesThatCrossAreNamed) {
  for (double z : {-2.3, -.9}) {
    Simulation s;
    s.surfaces = {part("cylinder", {-50, 95}), part("sphere", {-180, 180})};
    s.surfaces[1].id = "ball", s.surfaces[1].lit = "outside";
    s.surfaces[1].radius = .4, s.surfaces[1].elevation_deg = {-90, 90}, s.surfaces[1].origin = {.5, .7, .7 + z};
    EXPECT_EQ(simdata::check_layout(Rig(), s, *simdata::make_shapes(s)).has_value(), z > -1) << z;
  }
}

// Twelve faces are refined to more than are looked at one by one: rays, each of which meets the closed cube.
TEST(ByRays, NothingEscapesAClosedMesh) {
  std::vector<Eigen::Vector3d> corners;
  for (int i = 0; i < 8; ++i) corners.emplace_back(i & 1, (i >> 1) & 1, i >> 2);
  const std::vector<Eigen::Vector3i> inward{{0, 1, 2}, {1, 3, 2}, {4, 6, 5}, {5, 6, 7}, {0, 4, 1}, {1, 4, 5},
                                            {2, 3, 6}, {3, 7, 6}, {0, 2, 4}, {2, 6, 4}, {1, 5, 3}, {3, 5, 7}};
  const auto cube = simdata::prepared_mesh(corners, inward, "cube");
  ASSERT_TRUE(cube);
  ASSERT_GT(cube->faces.size(), 3000u);
  Simulation room;
  room.samples = 256, room.surfaces.resize(1), room.surfaces[0].id = "c";
  const auto scene = *simdata::Scene::make({std::make_shared<simdata::MeshShape>(*cube)});
  const simdata::Paint paint(room);
  const std::vector<simdata::Emitter> none;
  SilentProgress quiet;
  const auto light = *simdata::IndirectLight::make(scene, none, paint, room, {}, quiet);
  EXPECT_LT(light->escape(0).cwiseAbs().maxCoeff(), .01);  // leaks at edges
}

// A crumpled sheet whose corners stand once per face: light between 40,000 corners does not fit into any computer.
TEST(IndirectLight, RoomsThatDoNotFitIntoMemoryAreRefusedBeforeTheyTakeAny) {
  std::vector<Eigen::Vector3d> corners;
  std::vector<Eigen::Vector3i> faces;
  constexpr int kSide = 99;
  Random random(hash_name("crumpled"));
  for (int y = 0; y <= kSide; ++y)
    for (int x = 0; x <= kSide; ++x) corners.emplace_back(x, y, random.uniform(0, 4));
  for (int y = 0; y < kSide; ++y)
    for (int x = 0; x < kSide; ++x) {
      const int at = y * (kSide + 1) + x;
      faces.emplace_back(at, at + 1, at + kSide + 1), faces.emplace_back(at + 1, at + kSide + 2, at + kSide + 1);
    }
  Simulation room;
  room.surfaces.resize(1), room.surfaces[0].id = "crumpled";
  const auto sheet = simdata::prepared_mesh(corners, faces, "crumpled");
  ASSERT_TRUE(sheet) << sheet.error().message;
  ASSERT_GT(sheet->corners.size(), 35000u);
  const auto scene = *simdata::Scene::make({std::make_shared<simdata::MeshShape>(*sheet)});
  const simdata::Paint paint(room);
  const std::vector<simdata::Emitter> none;
  SilentProgress quiet;
  const auto light = simdata::IndirectLight::make(scene, none, paint, room, {}, quiet);
  ASSERT_FALSE(light);
  EXPECT_NE(light.error().message.find("simplify surface 'crumpled'"), std::string::npos) << light.error().message;
}

TEST(PatchTruth, RowsOfAClosedRoomSumToOneAndItsSigmasAreTrue) {
  simdata::RigAndRoom room = simdata::smaller(*simdata::default_room("closed-room"), 8, 8, 64);
  SilentProgress quiet;
  const auto simulator = test::simulate(room);
  const simdata::PatchTruth t = simulator->patch_truth(2, 3, 2500, quiet);
  const int n = static_cast<int>(t.area.size());
  ASSERT_EQ(n, 36);
  EXPECT_NEAR(t.area.sum(), 2 * (4.2 * 2.6 + 5.1 * 2.6 + 4.2 * 5.1), 1e-9);
  double square = 0;
  int pairs = 0;
  for (int i = 0; i < n; ++i) {
    EXPECT_NEAR(t.form_factor.row(i).sum(), 1, 1e-4) << i;  // every ray meets a lit side; floats
    for (int j = 0; j < i; ++j) {
      if (!(t.form_factor(i, j) > .01)) continue;
      const double z = (t.area[i] * t.form_factor(i, j) - t.area[j] * t.form_factor(j, i)) /
                       std::hypot(t.area[i] * t.form_factor_sigma(i, j), t.area[j] * t.form_factor_sigma(j, i));
      EXPECT_LT(std::abs(z), 5);
      square += z * z, ++pairs;
    }
  }
  ASSERT_GT(pairs, 100);
  EXPECT_NEAR(square / pairs, 1, .45);  // strata make it smaller than chance alone; pairs of a row depend on each other
  for (int c = 0; c < 3; ++c) {
    const Eigen::MatrixXd system =
        Eigen::MatrixXd::Identity(n, n) - Eigen::MatrixXd(t.albedo.col(c).asDiagonal()) * t.form_factor.cast<double>();
    EXPECT_LT((t.transport[c].cast<double>() * system - Eigen::MatrixXd::Identity(n, n)).cwiseAbs().maxCoeff(), 1e-4);
    for (int s = 0; s < 6; ++s) EXPECT_NEAR(t.albedo(6 * s, c), room.simulation.surfaces[s].albedo[c], 1e-6) << s;
  }
}

// A lone wall does not hide what stands behind it, also at grazing angles.
TEST(Visibility, WallDoesNotHideItsOwnBack) {
  Simulation room;
  room.surfaces.resize(1);
  room.surfaces[0].id = "s", room.surfaces[0].along_u = {1.2, .3, -.4}, room.surfaces[0].along_v = {-.2, 1.7, .5};
  const auto scene = *simdata::Scene::make(*simdata::make_shapes(room), {1});
  for (double cosine : {.002, .05, .3, .9})
    for (double u : {.13, .52, .9}) {
      const auto p = scene->point(0, u, .37);
      const Eigen::Vector3d to = p.x - 3 * cosine * p.normal + 3 * std::sqrt(1 - cosine * cosine) * p.along_u;
      EXPECT_TRUE(scene->visible(p, to, -1, true)) << cosine << " " << u;
    }
}

// Direct light of pixels of the left wall, over albedo and what `reflected` says: the same everywhere.
template <class Reflected>
void expect_even(const simdata::RigAndRoom& room, std::span<const Picture> pictures, Reflected reflected) {
  const auto simulator = test::simulate(room);
  const simdata::TrueGeometry g = simulator->geometry(0);
  const Image direct = simulator->light(0, pictures).direct;
  const auto scene = *simdata::Scene::make(*simdata::make_shapes(room.simulation), {9, 9});
  const Device camera = *simdata::true_camera(room.simulation, "camera");
  double first = 0;
  int checked = 0;
  for (int y = 40; y < 110; y += 8)
    for (int x = 14; x < 112; x += 9) {
      if (!test::inside_wall(g, x, y) || g.surface.at(x, y) != 0) continue;
      const auto at = scene->point(0, g.u.at(x, y), g.v.at(x, y));
      const double expected = reflected(*scene, at, -camera.ray({1. * x, 1. * y}).direction.normalized());
      if (!(expected > 0)) continue;
      const double ratio = direct.at(x, y, 1) / g.albedo.at(x, y, 1) / expected;
      if (first == 0) first = ratio;
      EXPECT_NEAR(ratio / first, 1, .01) << x << " " << y;  // a pixel's mean against its centre
      ++checked;
    }
  EXPECT_GT(checked, 30);
}

TEST(Daylight, LeavesAsTheScreenDirectsIt) {
  auto room = test::small_room();
  SimulatedSurface& wall = room.simulation.surfaces[0];
  wall.directing = 6, wall.directing_tilt_deg = {-12, 5};
  wall.daylight = 1, wall.daylight_from = {0, 0}, wall.daylight_to = {1, 1};
  for (SimulatedProjector& p : room.simulation.projectors) p.black_level = 0;
  const simdata::Paint paint(room.simulation);
  expect_even(room, std::vector<Picture>(2),
              [&](const simdata::Scene&, const simdata::SurfacePoint& at, const Eigen::Vector3d& out) {
                return paint.evenly_lit(at, out);
              });
}

// Light through a screen leaves diffusely: gloss, a matter of its front, sees it as light from everywhere.
TEST(RearProjection, LeavesAsIfItCameFromEverywhere) {
  auto room = simdata::smaller(*simdata::default_room("rear"), 8, 8, 64);
  room.simulation.block_px = 8;
  SimulatedSurface& wall = room.simulation.surfaces[0];
  wall.gloss = .5, wall.roughness = .3;
  for (SimulatedProjector& p : room.simulation.projectors) p.black_level = 0;
  const simdata::Paint paint(room.simulation);
  const Device device = *simdata::true_projector(room.simulation, room.rig, "left");
  const simdata::Emitter emitter(room.simulation.projectors[0], device, 8);
  expect_even(room, std::vector<Picture>{test::flat(1), {}},
              [&](const simdata::Scene& scene, const simdata::SurfacePoint& at, const Eigen::Vector3d& out) {
                const auto beam = emitter.beam(scene, at, -3);
                return beam ? beam->irradiance * paint.evenly_lit(at, out) : 0;
              });
}

// Of the indirect light at pixels on a raster, per channel: the fast path less path tracing.
struct Totals {
  double deviation = 0, sum = 0, variance = 0;
};
std::array<Totals, 3> against_path_tracing(const simdata::RigAndRoom& room, int dx, int dy, int paths) {
  const auto simulator = test::simulate(room);
  const std::vector<Picture> pictures{test::waves(0), test::waves(1)};
  const simdata::TrueGeometry g = simulator->geometry(0);
  std::vector<Eigen::Vector2d> pixels;
  for (int y = 30; y < 120; y += dy)
    for (int x = 12; x < 230; x += dx)
      if (test::inside_wall(g, x, y)) pixels.emplace_back(x, y);
  EXPECT_GT(pixels.size(), 60u);
  const Image fast = simulator->light(0, pictures).indirect;
  const auto traced = simulator->trace_indirect(0, pictures, pixels, paths);
  std::array<Totals, 3> totals;
  for (std::size_t i = 0; i < pixels.size(); ++i)
    for (int c = 0; c < 3; ++c) {
      const double value = fast.at(static_cast<int>(pixels[i].x()), static_cast<int>(pixels[i].y()), c);
      totals[c].deviation += value - traced.mean[3 * i + c], totals[c].sum += traced.mean[3 * i + c];
      totals[c].variance += std::pow(traced.standard_error[3 * i + c], 2);
    }
  return totals;
}

// Much gloss, little albedo: one reflection, whose lobe the fast path must follow exactly.
TEST(Gloss, FirstReflectionIsThatOfPathTracing) {
  auto room = simdata::smaller(*simdata::default_room("glossy"), 8, 8, 256);
  room.simulation.block_px = 4;
  for (SimulatedSurface& wall : room.simulation.surfaces) wall.albedo = {.04, .05, .03};
  room.simulation.surfaces[0].gloss = .6, room.simulation.surfaces[0].roughness = .25;
  room.simulation.surfaces[1].gloss = .5, room.simulation.surfaces[1].roughness = .35;
  const Totals green = against_path_tracing(room, 11, 9, 20000)[1];
  EXPECT_LT(std::abs(green.deviation), 4 * std::sqrt(green.variance) + .01 * green.sum);  // a draft's interpolation
}

// Much gloss and much albedo: light that has bounced meets gloss again and again.
TEST(Gloss, AllReflectionsAreThoseOfPathTracing) {
  auto room = simdata::smaller(*simdata::default_room("glossy"), 8, 8, 1024);
  room.simulation.block_px = 4, room.simulation.ambient = .1;
  for (SimulatedSurface& wall : room.simulation.surfaces) wall.albedo = {.8, .9, .7}, wall.texture = .1;
  room.simulation.surfaces[0].gloss = .95, room.simulation.surfaces[0].roughness = .4;
  room.simulation.surfaces[1].gloss = .85, room.simulation.surfaces[1].roughness = .5;
  for (const Totals& t : against_path_tracing(room, 8, 6, 12000))
    EXPECT_LT(std::abs(t.deviation), 4 * std::sqrt(t.variance) + 1e-3 * t.sum);
}

// In an even surround a lone wall looks as it does where light comes evenly from everywhere, gloss and all.
TEST(Gloss, MirrorsTheSurround) {
  auto room = test::small_room();
  room.simulation.surfaces.resize(1);
  SimulatedSurface& wall = room.simulation.surfaces[0];
  wall.gloss = .5, wall.roughness = .3;
  room.simulation.ambient = .3;
  for (SimulatedProjector& p : room.simulation.projectors) {
    p.black_level = 0;
    p.target = {wall.origin[0] + wall.along_u[0] / 2, p.target[1], wall.origin[2] + wall.along_u[2] / 2};
  }
  const simdata::Paint paint(room.simulation);
  expect_even(room, std::vector<Picture>(2),
              [&](const simdata::Scene&, const simdata::SurfacePoint& at, const Eigen::Vector3d& out) {
                return paint.evenly_lit(at, out);
              });
}

// Where a full cylinder's chart is cut makes no difference.
TEST(Seam, OfAColumnIsNotSeen) {
  Image first;
  // The camera sees azimuth 180 in the middle, a pixel covers 5.4 degrees and its samples half of that: one of the two
  // seams there lies within a pixel.
  for (const std::array<double, 2> cut : {std::array{-93., 267.}, {-180., 180.}, {-177.3, 182.7}}) {
    auto room = simdata::smaller(*simdata::default_room("column"), 8, 8, 256);
    room.simulation.block_px = 4;
    SimulatedSurface& column = room.simulation.surfaces[2];
    column.azimuth_deg = cut, column.radius = .25;
    const auto simulator = test::simulate(room);
    const Image light = simulator->light(0, std::vector<Picture>{test::flat(1), test::flat(.2)}).indirect;
    if (first.empty()) {
      first = light;
      continue;
    }
    const simdata::TrueGeometry g = simulator->geometry(0);
    int checked = 0;
    for (int y = 1; y < 149; ++y)
      for (int x = 1; x < 239; ++x)
        if (test::inside_wall(g, x, y) && g.surface.at(x, y) == 2) {
          // 19 receivers about the column: linear between them, with other places.
          EXPECT_NEAR(light.at(x, y, 1), first.at(x, y, 1), .08 * first.at(x, y, 1) + .0015) << x << " " << y;
          ++checked;
        }
    EXPECT_GT(checked, 100);
  }
}

}  // namespace
}  // namespace countershade
