#include "simdata/room/rooms.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "calib/file/file.h"
#include "simdata/render/simulator.h"
#include "tests/support/cli.h"

namespace countershade {
namespace {

using simdata::RigAndRoom;
using ::testing::AllOf;
using ::testing::HasSubstr;

double crease_distance(const Screen& screen, const ChartPoint& at) {
  const Eigen::Vector3d x = screen.point(at);
  return std::hypot(x.x(), x.z());
}

// Range of the distance from the crease, along the neighbour, that a picture's crease-side edge column reaches.
std::pair<double, double> spill(const RigAndRoom& made, int q) {
  const Screen screen = simdata::room_screen(made.simulation);
  const ProjectorSpec& spec = made.rig.projectors[q];
  const Device device = *simdata::true_projector(made.simulation, made.rig, spec.id);
  double least = 100, largest = 0;
  int met = 0;
  for (int row = 0; row < spec.resolution[1]; ++row) {
    const ChartPoint hit = screen.intersect(device.ray({q == 0 ? spec.resolution[0] - 1. : 0., 1. * row}));
    if (hit.surface != 1 - q) continue;
    least = std::min(least, crease_distance(screen, hit));
    largest = std::max(largest, crease_distance(screen, hit));
    ++met;
  }
  return {met > spec.resolution[1] / 2 ? least : 0, largest};
}

double covered(const RigAndRoom& made, int q) {
  const Screen screen = simdata::room_screen(made.simulation);
  const Device device = *simdata::true_projector(made.simulation, made.rig, made.rig.projectors[q].id);
  int inside = 0;
  for (int j = 0; j < 60; ++j)
    for (int i = 0; i < 60; ++i)
      inside += device.lens.contains(device.project(screen.surfaces[q]->point((i + .5) / 60, (j + .5) / 60)));
  return inside / 3600.;
}

TEST(RoomScreen, WallsMeetInTheCreaseAtTheStatedAngleAndFaceTheAudience) {
  Simulation s;
  s.surfaces = simdata::surfaces_of({97, {3, 2}, {2.6, 2.1}, .1, -.05});
  EXPECT_NEAR(simdata::edge_angle_deg(s), 97, 1e-3);
  const Screen screen = simdata::room_screen(s);
  const Eigen::Vector3d left = screen.surfaces[0]->point(0, 0) - screen.surfaces[0]->point(1, 0);
  const Eigen::Vector3d right = screen.surfaces[1]->point(1, 0) - screen.surfaces[1]->point(0, 0);
  EXPECT_NEAR(std::acos(left.normalized().dot(right.normalized())) * 180 / std::numbers::pi, 97,
              1e-3);  // hundredths of a millimetre
  EXPECT_NEAR(left.norm(), 3, 1e-5);
  EXPECT_NEAR(right.norm(), 2.6, 1e-5);
  EXPECT_LT(left.x(), 0);
  EXPECT_NEAR((screen.surfaces[0]->point(1, .5) - Eigen::Vector3d(0, 1.1, 0)).norm(), 0, 1e-12);
  EXPECT_NEAR((screen.surfaces[1]->point(0, 1) - Eigen::Vector3d(0, 2.05, 0)).norm(), 0, 1e-12);
  for (const auto& wall : screen.surfaces)
    EXPECT_GT(wall->normal(.5, .5).dot(Eigen::Vector3d(0, 1, 5) - wall->point(.5, .5)), 0);
}

TEST(RoomScreen, CreaseIsListedOnlyWhereTheWallsShareTheirHeights) {
  Simulation s;
  s.surfaces = simdata::surfaces_of({});
  const Screen screen = simdata::room_screen(s);
  ASSERT_EQ(screen.creases.size(), 1u);
  const Crease& crease = screen.creases[0];
  for (double v : {0., .3, 1.})
    EXPECT_NEAR((screen.surfaces[0]->point(crease.u_a, v) - screen.surfaces[1]->point(crease.u_b, v)).norm(), 0, 1e-12);
  s.surfaces[1].origin[1] += .1;
  EXPECT_TRUE(simdata::room_screen(s).creases.empty());
}

// Throw ratio = distance / picture width, shift = the picture's centre from the lens axis in picture sizes, right and
// down positive: by their definitions, on a screen perpendicular to the axis.
TEST(TrueProjector, ThrowAndLensShiftAreWhatTheirDefinitionsSay) {
  RigAndRoom made = simdata::default_two_wall();
  SimulatedProjector& p = made.simulation.projectors[1];
  p.throw_ratio = 1.4;
  p.lens_shift = {.07, -.2};
  const Device device = *simdata::true_projector(made.simulation, made.rig, "right");
  const auto at = [&](double x, double y) {
    const Eigen::Vector3d d = device.lens.unproject({x, y});
    return Eigen::Vector2d(2.8 * d.x() / d.z(), 2.8 * d.y() / d.z());
  };
  const Eigen::Vector2d first = at(-.5, -.5), last = at(1279.5, 799.5), centre = at(639.5, 399.5);
  EXPECT_NEAR(last.x() - first.x(), 2.8 / 1.4, 1e-9);
  EXPECT_NEAR(last.y() - first.y(), 2.8 / 1.4 * 800 / 1280, 1e-9);
  EXPECT_NEAR(centre.x(), .07 * 2, 1e-9);
  EXPECT_NEAR(centre.y(), -.2 * 1.25, 1e-9);
}

TEST(TrueDevices, UnknownIdsAreNamed) {
  const RigAndRoom made = simdata::default_two_wall();
  EXPECT_EQ(simdata::true_camera(made.simulation, "nobody").error().code, ErrorCode::kBadValue);
  EXPECT_NE(simdata::true_projector(made.simulation, made.rig, "middle").error().message.find("middle"),
            std::string::npos);
}

TEST(DefaultRoom, EachProjectorCoversItsWallAndSpillsThirtyToFiftyCentimetres) {
  const RigAndRoom made = simdata::default_two_wall();
  for (int q = 0; q < 2; ++q) {
    const auto [least, largest] = spill(made, q);
    EXPECT_GE(least, .3) << q;
    EXPECT_LE(largest, .51) << q;
    EXPECT_GE(covered(made, q), .995) << q;
    EXPECT_LE(std::abs(made.simulation.projectors[q].lens_shift[0]), .005);
  }
}

TEST(DefaultRoom, CameraSeesBothWallsWhole) {
  const RigAndRoom made = simdata::default_two_wall();
  const Device camera = *simdata::true_camera(made.simulation, "camera");
  const Screen screen = simdata::room_screen(made.simulation);
  double low = 1e9, high = -1e9;
  for (const auto& wall : screen.surfaces)
    for (double u : {0., 1.})
      for (double v : {0., 1.}) {
        const Eigen::Vector2d q = camera.project(wall->point(u, v));
        EXPECT_TRUE(camera.lens.contains(q)) << q.transpose();
        low = std::min(low, q.x()), high = std::max(high, q.x());
      }
  EXPECT_GT(high - low, .9 * 1920);
}

TEST(RandomRooms, SpillAndCoverTheirWallsAndStayInTheirRanges) {
  for (std::uint64_t seed = 1; seed <= 25; ++seed) {
    const RigAndRoom made = simdata::random_two_wall(seed);
    const Simulation& s = made.simulation;
    for (int q = 0; q < 2; ++q) {
      EXPECT_GE(spill(made, q).first, .3) << seed << " " << q;
      EXPECT_GE(covered(made, q), .995) << seed << " " << q;
      EXPECT_GE(s.projectors[q].throw_ratio, 1.0);
      EXPECT_LE(s.projectors[q].throw_ratio, 1.6);
      EXPECT_LE(std::abs(s.projectors[q].lens_shift[1]), .3);
      EXPECT_FALSE(made.rig.projectors[q].throw_ratio) << "no prior is stated";
    }
    EXPECT_GE(simdata::edge_angle_deg(s), 79.999);
    EXPECT_LE(simdata::edge_angle_deg(s), 110.001);
    const auto norm = [](const std::array<double, 3>& v) { return std::hypot(v[0], v[1], v[2]); };
    for (const SimulatedSurface& wall : s.surfaces) {
      EXPECT_NEAR(norm(wall.along_u), 3, .6001);
      EXPECT_NEAR(norm(wall.along_v), 2.1, .3001);
      for (double a : wall.albedo) EXPECT_NEAR(a, .775, .0751);
    }
    EXPECT_NE(norm(s.surfaces[0].along_u), norm(s.surfaces[1].along_u));
    EXPECT_NE(s.surfaces[0].albedo, s.surfaces[1].albedo);
  }
}

TEST(RandomRooms, SameSeedSameRoomOtherSeedOtherRoom) {
  EXPECT_EQ(simulation_text(simdata::random_two_wall(5).simulation),
            simulation_text(simdata::random_two_wall(5).simulation));
  EXPECT_NE(simulation_text(simdata::random_two_wall(5).simulation),
            simulation_text(simdata::random_two_wall(6).simulation));
}

// ---- rooms of all kinds ----

std::string complaint(const RigAndRoom& made) {
  SilentProgress quiet;
  const auto simulator = simdata::Simulator::make(made.rig, made.simulation, quiet);
  return simulator ? std::string() : simulator.error().message;
}

TEST(RoomKinds, EachIsWrittenAndReadBackAndAsymmetric) {
  for (const auto& [kind, what] : simdata::room_kinds()) {
    const RigAndRoom made = simdata::default_room(kind).value();
    testing::TemporaryFolder folder;
    ASSERT_TRUE(write_atomically(folder / "rig.toml", rig_text(made.rig, &made.simulation)));
    const auto read = read_simulation(folder / "rig.toml");
    ASSERT_TRUE(read) << kind << ": " << read.error().message;
    if (made.files.empty()) {
      EXPECT_EQ(simulation_text(*read), simulation_text(made.simulation)) << kind;
    }
    for (std::size_t a = 0; a < made.simulation.projectors.size(); ++a)
      for (std::size_t b = 0; b < a; ++b)
        EXPECT_NE(made.simulation.projectors[a].throw_ratio, made.simulation.projectors[b].throw_ratio) << kind;
  }
  EXPECT_NE(simdata::default_room("cavern").error().message.find("cave4"), std::string::npos);
}

TEST(TwoWall, AnyAngleHasARoom) {
  for (double angle : {15., 30., 60., 97., 130., 170.}) {
    RigAndRoom made = simdata::smaller(simdata::default_two_wall(angle), 8, 8, 64);
    EXPECT_NEAR(simdata::edge_angle_deg(made.simulation), angle, .001);
    EXPECT_EQ(complaint(made), "") << angle;
  }
}

TEST(Layout, SurfacesThatPassThroughEachOtherAreNamed) {
  const auto with = [](auto change) {
    RigAndRoom made = simdata::smaller(*simdata::default_room("cave4"), 8, 8, 64);
    change(made.simulation);
    return complaint(made);
  };
  EXPECT_EQ(with([](Simulation&) {}), "");
  EXPECT_THAT(with([](Simulation& s) {
                s.surfaces[1].origin = {-1.5, -.4, 1.};
              }),
              AllOf(HasSubstr("'front-wall'"), HasSubstr("pass through")));
  // Two walls that halve each other exactly: lines of both meet there.
  EXPECT_THAT(with([](Simulation& s) {
                s.surfaces[0].origin = {-1, 0, 1}, s.surfaces[0].along_u = {2, 0, 0}, s.surfaces[0].along_v = {0, 2, 0};
                s.surfaces[2].origin = {0, 0, 0}, s.surfaces[2].along_u = {0, 0, 2}, s.surfaces[2].along_v = {0, 2, 0};
                s.surfaces.resize(3);
              }),
              HasSubstr("pass through"));
  EXPECT_THAT(with([](Simulation& s) {
                s.surfaces[3] = s.surfaces[1];
                s.surfaces[3].id = "twin";
              }),
              AllOf(HasSubstr("'twin'"), HasSubstr("lie in each other")));
  EXPECT_THAT(with([](Simulation& s) { s.cameras[0].position = {.2, 1, 0}; }), HasSubstr("stands in the surface"));
  EXPECT_THAT(with([](Simulation& s) { s.surfaces.clear(); }), HasSubstr("no surface"));
  EXPECT_THAT(with([](Simulation& s) { s.surfaces[0].albedo[1] = .9, s.surfaces[0].patchwork = .2; }),
              HasSubstr("more light than arrives"));
  EXPECT_THAT(with([](Simulation& s) { s.cameras[0].target = {0, 1, 20}; }), HasSubstr("sees no light"));
  EXPECT_THAT(with([](Simulation& s) { s.projectors[1].target = {0, 1, 30}; }), HasSubstr("lights no surface"));
  EXPECT_THAT(with([](Simulation& s) { s.cameras[0].resolution = {8192, 8192}; }), HasSubstr("32 million"));
}

}  // namespace
}  // namespace countershade
