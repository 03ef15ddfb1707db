#include "simdata/room/shape.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <numbers>

#include "calib/base/random.h"
#include "simdata/render/scene.h"
#include "simdata/room/mesh.h"
#include "simdata/room/room_check.h"
#include "tests/support/cli.h"

namespace countershade {
namespace {

using simdata::Shape;
using simdata::SurfacePoint;
using ::testing::HasSubstr;
namespace support = countershade::testing;

SimulatedSurface surface(const std::string& shape) {
  SimulatedSurface s;
  s.id = "s", s.shape = shape;
  s.origin = {.3, -.2, .7};
  s.along_u = {1.2, .3, -.4}, s.along_v = {-.2, 1.7, .5};
  s.radius = 2.3, s.top_radius = 1.1, s.height = 1.9;
  s.azimuth_deg = {-50, 95}, s.elevation_deg = {-20, 70};
  return s;
}

std::shared_ptr<const Shape> shape(const SimulatedSurface& s) {
  return simdata::make_shape(s).value();
}

class ShapeTest : public ::testing::TestWithParam<const char*> {};

// Tangents by finite differences: normal perpendicular to both, area element = length of their cross product.
TEST_P(ShapeTest, NormalAndAreaAreThoseOfItsChart) {
  const auto one = shape(surface(GetParam()));
  constexpr double h = 1e-5;
  for (double u : {.1, .43, .8})
    for (double v : {.15, .6, .9}) {
      const SurfacePoint p = one->at(u, v);
      const Eigen::Vector3d du = (one->at(u + h, v).x - one->at(u - h, v).x) / (2 * h),
                            dv = (one->at(u, v + h).x - one->at(u, v - h).x) / (2 * h);
      EXPECT_NEAR(p.normal.norm(), 1, 1e-12);
      EXPECT_NEAR(p.normal.dot(du), 0, 1e-7);
      EXPECT_NEAR(p.normal.dot(dv), 0, 1e-7);
      EXPECT_NEAR(du.cross(dv).norm() / one->area_element(u, v), 1, 1e-8);
      EXPECT_GT(du.cross(dv).dot(p.normal), 0) << "the lit side is that of the chart, seen from inside";
      EXPECT_NEAR(p.along_u.dot(du) / du.norm(), 1, 1e-9);
    }
}

TEST_P(ShapeTest, RayThroughAPointOfTheChartFindsIt) {
  const auto one = shape(surface(GetParam()));
  Random random(3);
  for (int i = 0; i < 200; ++i) {
    const SurfacePoint p = one->at(random.uniform(.01, .99), random.uniform(.01, .99));
    const Eigen::Vector3d from =
        p.x + .3 * p.normal + .1 * Eigen::Vector3d(random.normal(), random.normal(), random.normal());
    const auto hit = one->intersect({from, p.x - from}, 0);
    ASSERT_TRUE(hit);
    EXPECT_NEAR(hit->t, 1, 1e-9);
    EXPECT_NEAR(hit->u, p.u, 1e-9);
    EXPECT_NEAR(hit->v, p.v, 1e-9);
    EXPECT_FALSE(one->intersect({from, from - p.x}, 0) && one->form() == Shape::Form::kFlat);
  }
}

TEST_P(ShapeTest, OutsideMeansTheOtherSide) {
  SimulatedSurface s = surface(GetParam());
  const SurfacePoint in = shape(s)->at(.3, .4);
  s.lit = "outside";
  if (s.shape == "rectangle") return;  // has no inside
  EXPECT_NEAR((shape(s)->at(.3, .4).normal + in.normal).norm(), 0, 1e-12);
}

INSTANTIATE_TEST_SUITE_P(All, ShapeTest, ::testing::Values("rectangle", "cylinder", "cone", "sphere"));

// Embree meets curved shapes through callbacks, in single precision; analytic intersection is the reference.
TEST(Scene, EmbreeAndAnalyticHitsAgree) {
  Simulation room;
  SimulatedSurface floor = surface("rectangle");
  floor.id = "floor", floor.origin = {-3, -.5, 3}, floor.along_u = {6, 0, 0}, floor.along_v = {0, 0, -6};
  SimulatedSurface ball = surface("sphere");
  ball.id = "ball", ball.lit = "outside", ball.radius = .4, ball.origin = {.2, .3, .1};
  ball.azimuth_deg = {-180, 180}, ball.elevation_deg = {-90, 90};
  SimulatedSurface screen = surface("cone");
  screen.id = "screen", screen.origin = {0, -.5, 0};
  room.surfaces = {floor, ball, screen};
  const auto scene = *simdata::Scene::make(*simdata::make_shapes(room));
  const SurfacePoint from = scene->point(0, .4, .3);
  Random random(5);
  std::vector<int> met(4, 0);
  for (int i = 0; i < 4000; ++i) {
    const Eigen::Vector3d d = simdata::cosine_direction(from.normal, from.along_u, random.uniform(), random.uniform());
    const simdata::SceneHit fast = scene->hit(from, d), exact = scene->look({from.x + 1e-6 * from.normal, d});
    ASSERT_EQ(fast.at.surface, exact.at.surface) << d.transpose();
    ++met[fast.at.surface + 1];
    if (fast.at.surface < 0) continue;
    EXPECT_EQ(fast.front, exact.front);
    EXPECT_NEAR((fast.at.x - exact.at.x).norm(), 0, 2e-5);
    // What is hit first is visible, what lies behind it is not.
    if (fast.front) {
      EXPECT_TRUE(scene->visible(from, exact.at.x, exact.at.surface));
    }
    EXPECT_FALSE(scene->visible(from, exact.at.x + .2 * d)) << d.transpose();
  }
  for (int i : {0, 2, 3}) EXPECT_GT(met[i], 100) << i;  // away, ball, screen
  EXPECT_EQ(met[1], 0) << "the floor does not see itself";
}

TEST(Scene, FullBallHidesItsFarSide) {
  Simulation room;
  SimulatedSurface ball = surface("sphere");
  ball.lit = "outside", ball.azimuth_deg = {-180, 180}, ball.elevation_deg = {-90, 90}, ball.radius = .5;
  SimulatedSurface wall = surface("rectangle");
  wall.id = "wall", wall.origin = {-2, -2, -3}, wall.along_u = {4, 0, 0}, wall.along_v = {0, 4, 0};
  room.surfaces = {wall, ball};
  const auto scene = *simdata::Scene::make(*simdata::make_shapes(room));
  const SurfacePoint from = scene->point(0, .5, .5);
  int seen = 0;
  for (int i = 0; i < 20; ++i)
    for (int j = 1; j < 20; ++j) {
      const SurfacePoint p = scene->point(1, i / 20., j / 20.);
      const double cosine = p.normal.dot((from.x - p.x).normalized());
      if (std::abs(cosine) < .02) continue;  // grazing: within what rays skip at their ends
      const bool faces = cosine > 0;
      EXPECT_EQ(scene->visible(from, p.x, 1), faces) << i << " " << j;
      seen += faces;
    }
  EXPECT_GT(seen, 50);
}

// ---- meshes ----

std::vector<Eigen::Vector3d> cube_corners() {
  std::vector<Eigen::Vector3d> corners;
  for (int i = 0; i < 8; ++i) corners.emplace_back(i & 1, (i >> 1) & 1, i >> 2);
  return corners;
}
// Lit from outside.
std::vector<Eigen::Vector3i> cube_faces() {
  return {{0, 2, 1}, {1, 2, 3}, {4, 5, 6}, {5, 7, 6}, {0, 1, 4}, {1, 5, 4},
          {2, 6, 3}, {3, 6, 7}, {0, 4, 2}, {2, 4, 6}, {1, 3, 5}, {3, 7, 5}};
}

double area_of(const simdata::MeshShape::Triangles& t) {
  double sum = 0;
  for (const Eigen::Vector3i& f : t.faces)
    sum += (t.corners[f[1]] - t.corners[f[0]]).cross(t.corners[f[2]] - t.corners[f[0]]).norm() / 2;
  return sum;
}

TEST(Mesh, IsRefinedAndSplitAtItsEdgesWithoutChangingItsShape) {
  const auto cube = simdata::prepared_mesh(cube_corners(), cube_faces(), "cube");
  ASSERT_TRUE(cube) << cube.error().message;
  EXPECT_GE(cube->faces.size(), 1500u);
  EXPECT_NEAR(area_of(*cube), 6, 1e-12);
  for (std::size_t f = 0; f < cube->faces.size(); ++f)
    for (int k = 0; k < 3; ++k) {
      const Eigen::Vector3d n = cube->normals[cube->faces[f][k]];
      const Eigen::Vector3d& a = cube->corners[cube->faces[f][0]];
      const Eigen::Vector3d own =
          (cube->corners[cube->faces[f][1]] - a).cross(cube->corners[cube->faces[f][2]] - a).normalized();
      EXPECT_NEAR(n.dot(own), 1, 1e-12) << "no corner is shared over an edge of the cube";
    }
}

TEST(Mesh, WhatIsWrongWithOneIsSaid) {
  auto complaint = [](const std::vector<Eigen::Vector3d>& corners, const std::vector<Eigen::Vector3i>& faces) {
    const auto made = simdata::prepared_mesh(corners, faces, "m");
    return made ? std::string() : made.error().message;
  };
  auto flipped = cube_faces();
  std::swap(flipped[4][0], flipped[4][1]);
  EXPECT_THAT(complaint(cube_corners(), flipped), HasSubstr("opposite sides"));
  auto open = cube_faces();
  open.resize(7);
  EXPECT_EQ(complaint(cube_corners(), open), "") << "a screen has holes";
  EXPECT_THAT(complaint(cube_corners(), {}), HasSubstr("no faces"));
  auto bad = cube_corners();
  bad[3].y() = std::nan("");
  EXPECT_THAT(complaint(bad, cube_faces()), HasSubstr("not finite"));
  auto tiny = cube_corners();
  for (auto& x : tiny) x *= 1e-5;
  EXPECT_THAT(complaint(tiny, cube_faces()), HasSubstr("mesh_scale"));
  EXPECT_THAT(complaint({{0, 0, 0}, {1, 1, 1}, {2, 2, 2}}, {{0, 1, 2}}), HasSubstr("no area"));
  std::vector<Eigen::Vector3i> many(30000, Eigen::Vector3i(0, 2, 1));
  EXPECT_THAT(complaint(cube_corners(), many), HasSubstr("at most 20000"));
}

// Two rectangles in one mesh: the second a turn about y, `angle` against the first, its middle moved by `offset`.
std::string complaint_about_two(double angle, const Eigen::Vector3d& offset) {
  std::vector<Eigen::Vector3d> corners;
  for (int part = 0; part < 2; ++part)
    for (int i = 0; i < 4; ++i) {
      const Eigen::Vector3d flat((i & 1) - .5, (i >> 1) - .5, 0);
      corners.push_back(part == 0 ? flat : Eigen::AngleAxisd(angle, Eigen::Vector3d::UnitY()) * flat + offset);
    }
  const auto made = simdata::prepared_mesh(corners, {{0, 1, 2}, {1, 3, 2}, {4, 5, 6}, {5, 7, 6}}, "m");
  return made ? std::string() : made.error().message;
}

TEST(Mesh, FacesThatPassThroughEachOtherAreRefusedAndThoseThatTouchAreNot) {
  EXPECT_THAT(complaint_about_two(1, {0, 0, 0}), HasSubstr("pass through each other")) << "middle in middle";
  EXPECT_THAT(complaint_about_two(std::acos(0), {.23, .11, 0}), HasSubstr("at (0.230, "));
  EXPECT_THAT(complaint_about_two(.3, {.4, .9, .02}), HasSubstr("pass through")) << "a corner only";
  EXPECT_THAT(complaint_about_two(0, {.61, -.34, 0}), HasSubstr("lie in each other"));
  EXPECT_EQ(complaint_about_two(0, {.61, -.34, .001}), "");
  EXPECT_EQ(complaint_about_two(0, {1, 0, 0}), "") << "side by side, welded";
  EXPECT_EQ(complaint_about_two(0, {1, .3, 0}), "") << "side by side, shifted";
  for (double angle : {.4, 1.3, 2.2})
    for (double rise : {0., .21}) {
      const Eigen::Vector3d half(-.5 * std::cos(angle), rise,
                                 .5 * std::sin(angle));  // its left side lies in the middle
      EXPECT_EQ(complaint_about_two(angle, -half + Eigen::Vector3d(.1, 2 * rise, 0)), "")
          << "stands on the other " << angle << " " << rise;
      EXPECT_THAT(complaint_about_two(angle, -.9 * half + Eigen::Vector3d(.1, 1.9 * rise, 0)), HasSubstr("pass"))
          << "and through it " << angle << " " << rise;
    }
}

TEST(Layout, MeshesThatCrossAreNamed) {
  support::TemporaryFolder folder;
  std::string text;
  for (const Eigen::Vector3d& x : cube_corners()) text += fmt::format("v {} {} {}\n", x.x(), x.y(), x.z());
  for (const Eigen::Vector3i& f : cube_faces()) text += fmt::format("f {} {} {}\n", f.x() + 1, f.y() + 1, f.z() + 1);
  std::ofstream(folder / "cube.obj") << text;
  for (double x : {.37, 1., 1.01}) {
    Simulation room;
    for (double at : {0., x}) {
      SimulatedSurface& cube = room.surfaces.emplace_back(surface("mesh"));
      cube.id = at == 0 ? "one" : "other", cube.mesh = folder / "cube.obj", cube.origin = {at, .13 * at, .21 * at};
    }
    const auto checked = simdata::check_layout(Rig(), room, *simdata::make_shapes(room));
    EXPECT_EQ(checked.has_value(), x > 1) << x;  // at 1 two faces lie in each other
    if (checked) continue;
    EXPECT_THAT(checked.error().message, HasSubstr("'one' and 'other'"));
  }
}

TEST(Mesh, ObjAndPlyFilesAreReadAndBrokenOnesRefused) {
  support::TemporaryFolder folder;
  const auto read = [&](const std::string& name, const std::string& text, double scale = 1) {
    std::ofstream(folder / name) << text;
    return simdata::read_mesh(folder / name, scale, {1, 2, 3});
  };
  const auto obj = read("a.obj", "v 0 0 0\nv 200 0 0\nv 200 100 0\nv 0 100 0\nf 1 2 3 4\n", .01);
  ASSERT_TRUE(obj) << obj.error().message;
  EXPECT_NEAR(area_of(*obj), 2, 1e-9);
  Eigen::AlignedBox3d box;
  for (const auto& x : obj->corners) box.extend(x);
  EXPECT_NEAR((box.min() - Eigen::Vector3d(1, 2, 3)).norm(), 0, 1e-6);
  EXPECT_NEAR((box.max() - Eigen::Vector3d(3, 3, 3)).norm(), 0, 1e-6);
  const auto ply = read("a.ply",
                        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float "
                        "z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 "
                        "0\n3 0 1 2\n");
  ASSERT_TRUE(ply) << ply.error().message;
  EXPECT_NEAR(area_of(*ply), .5, 1e-9);
  const auto broken_ply = [&](const std::string& face) {
    const auto made =
        read("b.ply",
             "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float "
             "z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 "
             "0\n" +
                 face + "\n");
    return made ? std::string("read") : made.error().message;
  };
  EXPECT_THAT(broken_ply("3 0 1 -1"), HasSubstr("names corner -1"));
  EXPECT_THAT(broken_ply("3 0 1 3"), HasSubstr("names corner 3"));
  EXPECT_THAT(broken_ply("3 0 1 2000000000"), HasSubstr("names corner 2000000000"));
  const auto huge = read("c.ply", "ply\nformat ascii 1.0\nelement vertex 3\nelement face 4000000000\nend_header\n");
  ASSERT_FALSE(huge);
  EXPECT_THAT(huge.error().message, HasSubstr("at most 20000"));
  EXPECT_FALSE(read("a.stl", "solid\n"));
  EXPECT_FALSE(read("b.obj", "v 0 0 0\nv 1 0 0\nf 1 2 3\n")) << "a corner that is not there";
  EXPECT_FALSE(read("c.obj", "this is no mesh\n"));
  EXPECT_FALSE(read("d.obj", ""));
  EXPECT_FALSE(simdata::read_mesh(folder / "nothing.obj", 1, {0, 0, 0}));
}

// A cube's inner sides as a mesh are the closed room: whoever stands in it sees it whole.
TEST(Mesh, SeesItselfLikeTheWallsItIsMadeOf) {
  auto faces = cube_faces();
  for (auto& f : faces) std::swap(f[1], f[2]);
  const auto cube = simdata::prepared_mesh(cube_corners(), faces, "cube");
  ASSERT_TRUE(cube);
  const auto scene = *simdata::Scene::make({std::make_shared<simdata::MeshShape>(*cube)});
  Random random(9);
  for (int i = 0; i < 300; ++i) {
    const auto mesh = static_cast<const simdata::MeshShape*>(&scene->shape(0));
    SurfacePoint p = mesh->at(static_cast<int>(random.uniform() * cube->faces.size()), .3, .3);
    p.surface = 0;
    const auto hit = scene->hit(p, simdata::cosine_direction(p.normal, p.along_u, random.uniform(), random.uniform()));
    ASSERT_EQ(hit.at.surface, 0);
    EXPECT_TRUE(hit.front);
    EXPECT_TRUE(scene->visible(p, hit.at.x, 0));
  }
}

}  // namespace
}  // namespace countershade
