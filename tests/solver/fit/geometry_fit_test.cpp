#include "solver/fit/geometry_fit.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>

#include "calib/base/random.h"
#include "simdata/room/rooms.h"
#include "solver/fit/geometry_parts.h"

namespace countershade::solver {
namespace {

constexpr double kDegree = std::numbers::pi / 180;

// A two-wall room without symmetry, seen by a small camera; correspondences by exact projection plus noise.
struct Room {
  double angle = 97 * kDegree;
  std::vector<std::shared_ptr<const PlaneSurface>> walls;
  Screen screen;
  Device camera;
  std::vector<Device> projectors;
  std::vector<Image> x, y, sigma;

  explicit Room(double noise_px, double principal_offset_px = 0, double spill_m = 0.4, double throw_ratio = 1.25) {
    // Crease along world y (up) at x = z = 0; walls open towards +z.
    const Eigen::Vector3d left(-std::sin(angle * 0.45), 0, std::cos(angle * 0.45)),
        right(std::sin(angle * 0.55), 0, std::cos(angle * 0.55));
    const Eigen::Vector3d top(0, 2.0, 0), down(0, -1.9, 0);
    walls = {std::make_shared<PlaneSurface>(top, 2.9 * left, down),
             std::make_shared<PlaneSurface>(top + 2.5 * right, -2.5 * right, down)};
    screen.surfaces = {walls[0], walls[1]};
    const Eigen::Vector3d up(0, 1, 0);
    camera.lens = Lens::pinhole(210, 121.3, 74.1, 240, 150);
    camera.device_from_world = look_at({0.35, 1.35, 4.6}, {-0.05, 1.05, 0.3}, up, 0.02);
    const auto aim = [&](const Eigen::Vector3d& from, const Eigen::Vector3d& to, double offset) {
      Device p;
      p.lens = Lens::pinhole(throw_ratio * 1280, 639.5 + offset, 399.5 + 160, 1280, 800);
      p.device_from_world = look_at(from, to, up, 0.015);
      return p;
    };
    // Each looks at the middle of its wall, so far off that it spills over the crease.
    projectors = {aim(Eigen::Vector3d(0.9, 1.6, 2.9), 0.5 * (2.3 - spill_m) * left + Eigen::Vector3d(0, 1.2, 0),
                      principal_offset_px),
                  aim(Eigen::Vector3d(-0.7, 1.75, 2.7), 0.5 * (2.0 - spill_m) * right + Eigen::Vector3d(0, 1.25, 0),
                      -0.7 * principal_offset_px)};
    photograph(noise_px);
  }

  void photograph(double noise_px) {
    Random random(hash_name("Room"));
    const float nan = std::numeric_limits<float>::quiet_NaN();
    for (const Device& p : projectors) {
      x.emplace_back(240, 150, 1, nan);
      y.emplace_back(240, 150, 1, nan);
      sigma.emplace_back(240, 150, 1, static_cast<float>(std::max(noise_px, 0.05)));
      for (int row = 0; row < 150; ++row)
        for (int column = 0; column < 240; ++column) {
          const ChartPoint at = screen.intersect(camera.ray({column, row}));
          if (at.surface < 0) continue;
          const Eigen::Vector2d q = p.project(screen.point(at));
          if (!p.lens.contains(q)) continue;
          x.back().at(column, row) = static_cast<float>(q.x() + noise_px * random.normal());
          y.back().at(column, row) = static_cast<float>(q.y() + noise_px * random.normal());
        }
    }
  }

  std::vector<ProjectorObservation> observations(int count = 2) const {
    std::vector<ProjectorObservation> result;
    for (int q = 0; q < count; ++q) {
      ProjectorSpec spec;
      spec.id = q ? "right" : "left";
      spec.resolution = {1280, 800};
      result.push_back({spec, &x[q], &y[q], &sigma[q]});
    }
    return result;
  }

  Device camera_alone() const { return {camera.lens, {}}; }
};

TEST(GeometryFit, FindsRoomAndProjectorsFromExactCorrespondences) {
  const Room room(0.0);
  SilentProgress progress;
  const auto fit = fit_geometry(room.camera_alone(), room.observations(), {}, {}, progress);
  ASSERT_TRUE(fit) << fit.error().message;
  ASSERT_EQ(fit->screen.creases.size(), 1u);
  // Exact data, a centred principal column: what is left is the float rounding of the maps (1e-4 px).
  EXPECT_NEAR(fit->screen.creases[0].angle / kDegree, room.angle / kDegree, 0.02);
  EXPECT_LT(fit->rms_px, 0.01);
  for (const ProjectorFit& p : fit->projectors) {
    EXPECT_NEAR(p.device.lens.intrinsics()[0], 1600, 2) << p.id;
    EXPECT_NEAR(p.device.lens.intrinsics()[3], 559.5, 2) << p.id;
  }
}

TEST(GeometryFit, NoiseMovesTheEdgeByItsSigma) {
  const Room room(0.3);
  SilentProgress progress;
  const auto fit = fit_geometry(room.camera_alone(), room.observations(), {}, {}, progress);
  ASSERT_TRUE(fit) << fit.error().message;
  ASSERT_EQ(fit->angle_sigma.size(), 1u);
  const double deviation = std::abs(fit->screen.creases[0].angle - room.angle);
  EXPECT_LT(deviation, 4 * fit->angle_sigma[0] + 0.01 * kDegree);  // 4 sigma, plus the optimiser's tolerance
  EXPECT_LT(fit->angle_sigma[0], 0.6 * kDegree);
  EXPECT_GT(fit->angle_sigma[0], 1e-5);
}

TEST(GeometryFit, TwoProjectorsOnTheSameWallsRemoveTheWeakDirection) {
  // Principal columns 10 and -7 px off the prior's mean: one projector would turn the edge by about 2 degrees (PHYSICS
  // 6).
  const Room room(0.05, 10);
  SilentProgress progress;
  const auto fit = fit_geometry(room.camera_alone(), room.observations(), {}, {}, progress);
  ASSERT_TRUE(fit) << fit.error().message;
  ASSERT_EQ(fit->screen.creases.size(), 1u) << fit->planes.size() << " planes";
  EXPECT_NEAR(fit->screen.creases[0].angle / kDegree, room.angle / kDegree, 1.0);
}

TEST(GeometryFit, FindsRoomsOfTheStudyDistribution) {
  // The second of these led a search that began with each projector alone to 140 degrees.
  for (std::uint64_t seed : {0, 2, 5}) {
    const simdata::RigAndRoom room = simdata::random_two_wall(hash_name("battery") + seed);
    const Screen screen = simdata::room_screen(room.simulation);
    Device camera = simdata::true_camera(room.simulation, "camera").value();
    Random random(hash_name("FindsRooms") + seed);
    std::vector<Image> x, y, sigma;
    for (const ProjectorSpec& spec : room.rig.projectors) {
      const Device projector = simdata::true_projector(room.simulation, room.rig, spec.id).value();
      const float nan = std::numeric_limits<float>::quiet_NaN();
      x.emplace_back(camera.lens.width(), camera.lens.height(), 1, nan);
      y.push_back(x.back());
      sigma.emplace_back(camera.lens.width(), camera.lens.height(), 1, 0.2f);
      for (int row = 0; row < camera.lens.height(); row += 6)
        for (int column = 0; column < camera.lens.width(); column += 6) {
          const ChartPoint at = screen.intersect(camera.ray({column, row}));
          const Eigen::Vector2d q = at.surface < 0 ? Eigen::Vector2d(-9, -9) : projector.project(screen.point(at));
          if (!projector.lens.contains(q)) continue;
          x.back().at(column, row) = static_cast<float>(q.x() + 0.2 * random.normal());
          y.back().at(column, row) = static_cast<float>(q.y() + 0.2 * random.normal());
        }
    }
    std::vector<ProjectorObservation> observations;
    for (int q = 0; q < 2; ++q) observations.push_back({room.rig.projectors[q], &x[q], &y[q], &sigma[q]});
    camera.device_from_world = {};
    SilentProgress progress;
    const auto fit = fit_geometry(camera, observations, {}, {}, progress);
    ASSERT_TRUE(fit) << fit.error().message;
    ASSERT_EQ(fit->screen.creases.size(), 1u) << seed;
    // Four sigma; the columns are free within their prior and the two projectors hold each other.
    EXPECT_NEAR(fit->screen.creases[0].angle / kDegree, simdata::edge_angle_deg(room.simulation),
                4 * fit->angle_sigma[0] / kDegree + 0.02)
        << seed;
    EXPECT_LT(fit->angle_sigma[0] / kDegree, 0.1) << seed;
  }
}

TEST(GeometryFit, ChartsMeetAtTheCreaseWithOneParameter) {
  const Room room(0.1);
  SilentProgress progress;
  const auto fit = fit_geometry(room.camera_alone(), room.observations(), {}, {}, progress);
  ASSERT_TRUE(fit) << fit.error().message;
  const Crease& crease = fit->screen.creases.at(0);
  for (double v : {0.0, 0.3, 1.0}) {
    const Eigen::Vector3d a = fit->planes[crease.surface_a]->point(crease.u_a, v),
                          b = fit->planes[crease.surface_b]->point(crease.u_b, v);
    EXPECT_LT((a - b).norm(), 1e-6 * a.norm()) << v;  // the same point up to rounding
  }
  for (const auto& plane : fit->planes)
    EXPECT_LT(plane->normal(0, 0).dot(plane->point(0.5, 0.5)), 0) << "lit side faces the camera";
}

TEST(GeometryFit, APlaneThatIsOnlyBrushedStillPlacesTheProjector) {
  // What the right projector spills onto the left wall is lost but for 1 % of its pixels: too little to place it by
  // itself, enough to resect it on the walls that the left one gives.
  const Room room(0.1);
  Image x = room.x[1];
  int own = 0, spilt = 0;
  for (int row = 0; row < 150; ++row)
    for (int column = 0; column < 240; ++column) {
      if (std::isnan(x.at(column, row))) continue;
      const bool spill = room.screen.intersect(room.camera.ray({column, row})).surface == 0;
      if (spill && (row < 71 || row > 75))
        x.at(column, row) = std::numeric_limits<float>::quiet_NaN();
      else
        ++(spill ? spilt : own);
    }
  ASSERT_LT(spilt, 0.02 * own);
  ASSERT_GT(spilt, 0.004 * own);
  std::vector<ProjectorObservation> observations = room.observations();
  observations[1].x = &x;
  SilentProgress progress;
  const auto fit = fit_geometry(room.camera_alone(), observations, {}, {}, progress);
  ASSERT_TRUE(fit) << fit.error().message;
  ASSERT_EQ(fit->screen.creases.size(), 1u);
  EXPECT_NEAR(fit->screen.creases[0].angle, room.angle, 4 * fit->angle_sigma[0] + 0.01 * kDegree);
  EXPECT_LT(fit->angle_sigma[0], 1.5 * kDegree);
}

TEST(GeometryFit, StatedPriorsSolveOnePlanePerProjector) {
  const Room room(0.1);
  std::vector<Image> x = room.x;
  for (int row = 0; row < 150; ++row)
    for (int column = 0; column < 240; ++column)
      if (room.screen.intersect(room.camera.ray({column, row})).surface != 1)
        x[1].at(column, row) = std::numeric_limits<float>::quiet_NaN();
  std::vector<ProjectorObservation> observations = room.observations();
  observations[1].x = &x[1];
  observations[1].spec.throw_ratio = 1.25;
  observations[1].spec.lens_shift = {0, -0.2};  // the picture's centre lies 160 of 800 rows above the axis
  SilentProgress progress;
  const auto fit = fit_geometry(room.camera_alone(), observations, {}, {}, progress);
  ASSERT_TRUE(fit) << fit.error().message;
  ASSERT_EQ(fit->screen.creases.size(), 1u);
  // The left projector sees both walls; its column has the prior of 2 % of the width: .2 degrees per pixel (PHYSICS 6).
  EXPECT_NEAR(fit->screen.creases[0].angle / kDegree, room.angle / kDegree, 2.5);
  EXPECT_LT(fit->projectors[1].rms_px, 0.3);
}

TEST(GeometryFit, OnePlanePerProjectorIsRefusedWithThePriorThatIsMissing) {
  const Room room(0.1);
  // Only what each projector puts on its own wall.
  std::vector<Image> x = room.x;
  for (int row = 0; row < 150; ++row)
    for (int column = 0; column < 240; ++column) {
      const ChartPoint at = room.screen.intersect(room.camera.ray({column, row}));
      for (int q = 0; q < 2; ++q)
        if (at.surface != q) x[q].at(column, row) = std::numeric_limits<float>::quiet_NaN();
    }
  std::vector<ProjectorObservation> observations = room.observations();
  for (int q = 0; q < 2; ++q) observations[q].x = &x[q];
  SilentProgress progress;
  const auto fit = fit_geometry(room.camera_alone(), observations, {}, {}, progress);
  ASSERT_FALSE(fit);
  EXPECT_EQ(fit.error().code, ErrorCode::kRefused);
  EXPECT_NE(fit.error().message.find("throw_ratio"), std::string::npos) << fit.error().message;
  EXPECT_NE(fit.error().message.find("30 cm"), std::string::npos) << fit.error().message;
}

TEST(GeometryFit, TooFewPixelsAreRefusedByNumber) {
  Room room(0.1);
  for (float& v : room.x[1].data()) v = std::numeric_limits<float>::quiet_NaN();
  SilentProgress progress;
  const auto fit = fit_geometry(room.camera_alone(), room.observations(), {}, {}, progress);
  ASSERT_FALSE(fit);
  EXPECT_NE(fit.error().message.find("'right': 0 camera pixels"), std::string::npos) << fit.error().message;
}

TEST(GeometryFit, KnownLengthGivesMetres) {
  const Room room(0.0);
  ScreenSpec spec;
  const Eigen::Vector2d a(70, 60), b(180, 90);
  const auto at = [&](const Eigen::Vector2d& q) {
    return room.screen.point(room.screen.intersect(room.camera.ray(q)));
  };
  spec.known_length = ScreenSpec::KnownLength{{a.x(), a.y()}, {b.x(), b.y()}, (at(a) - at(b)).norm()};
  SilentProgress progress;
  const auto fit = fit_geometry(room.camera_alone(), room.observations(), spec, {}, progress);
  ASSERT_TRUE(fit) << fit.error().message;
  const double distance = (fit->projectors[0].device.position()).norm();
  const double truth = (room.projectors[0].position() - room.camera.position()).norm();
  EXPECT_NEAR(distance / truth, 1.0, 0.005);
}

TEST(Adjust, APlaneThatIsNowhereCostsEverythingAndSaysNothing) {
  parts::Bundle bundle;
  bundle.projectors = {{800, 319.5, 239.5, {}}};
  bundle.planes = {{0, 0, 0.5}, Eigen::Vector3d::Zero()};
  parts::Matches matches;
  for (int i = 0; i < 20; ++i)
    matches.push_back({{0.02 * i, 0.01 * i}, {319.5 + 16 * i, 239.5 + 8 * i}, 0.3, i, i % 2});
  ProjectorSpec spec;
  spec.id = "p", spec.resolution = {640, 480};
  ::testing::internal::CaptureStderr();
  const parts::BundleResult result = parts::adjust({matches}, {spec}, {}, bundle);
  EXPECT_EQ(::testing::internal::GetCapturedStderr(), "");
  EXPECT_EQ(result.cost, HUGE_VAL);
  EXPECT_EQ(result.rms_px, std::vector<double>{HUGE_VAL});
  EXPECT_EQ(bundle.projectors[0].focal, 800);
}

}  // namespace
}  // namespace countershade::solver
