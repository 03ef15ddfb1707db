#include "solver/transport/model.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/support/test_model.h"

namespace countershade::solver {
namespace {

TEST(ReceiverPoints, AreCellCentresInIndexOrder) {
  Model model;
  model.patches = Patches({{3, 2}, {2, 5}});
  model.receiver_factor = 3;
  const std::vector<ChartPoint> points = receiver_points(model.patches, model.receiver_factor);
  ASSERT_EQ(static_cast<int>(points.size()), model.receivers());
  for (int s = 0; s < 2; ++s)
    for (int y = 0; y < model.receivers_v(s); ++y)
      for (int x = 0; x < model.receivers_u(s); ++x) {
        const ChartPoint& p = points[model.receiver_offset(s) + y * model.receivers_u(s) + x];
        EXPECT_EQ(p.surface, s);
        EXPECT_DOUBLE_EQ(p.u, (x + .5) / model.receivers_u(s));
        EXPECT_DOUBLE_EQ(p.v, (y + .5) / model.receivers_v(s));
        EXPECT_EQ(model.patches.index(p), model.patches.index(s, x / 3, y / 3));
      }
}

TEST(PixelMap, IsTheInverseOfTheLens) {
  const Model model = test::room();
  for (const ProjectorModel& p : model.projectors) {
    const PixelMap map = pixel_map(p.device, model.screen);
    ASSERT_EQ(map.width, p.device.lens.width());
    ASSERT_EQ(map.height, p.device.lens.height());
    std::array<int, 3> seen{};  // nothing, wall 0, wall 1
    for (int y = 0; y < map.height; ++y)
      for (int x = 0; x < map.width; ++x) {
        const std::size_t i = static_cast<std::size_t>(y) * map.width + x;
        ++seen[map.surface[i] + 1];
        if (map.surface[i] < 0) continue;
        const Eigen::Vector2d q = p.device.project(model.screen.point({map.surface[i], map.u[i], map.v[i]}));
        // (u, v) are floats: 6e-8 of a wall that is about 60 pixels wide.
        EXPECT_NEAR(q.x(), x, 1e-5);
        EXPECT_NEAR(q.y(), y, 1e-5);
      }
    EXPECT_GT(seen[0], 0);  // the picture is wider than the walls,
    EXPECT_GT(seen[1], 0);  // and lights both
    EXPECT_GT(seen[2], 0);
  }
}

TEST(PixelMap, LeavesOutWhatTheScreenDoesNotHold) {
  const Model model = test::room();
  const Device& device = model.projectors[0].device;
  const PixelMap map = pixel_map(device, model.screen);
  for (int y = 0; y < map.height; y += 3)
    for (int x = 0; x < map.width; x += 3) {
      const Ray ray = device.ray(Eigen::Vector2d(x, y));
      bool hits = false;
      for (const auto& plane : model.planes) hits |= plane->intersect(ray).has_value();
      EXPECT_EQ(map.surface[static_cast<std::size_t>(y) * map.width + x] >= 0, hits) << x << ' ' << y;
    }
}

TEST(SampleChart, ReproducesALinearFunctionBetweenCellCentres) {
  Image chart(5, 3, 3);
  const auto linear = [](double u, double v, int c) { return 1 + c + (2 - c) * u - 3 * v; };
  for (int y = 0; y < 3; ++y)
    for (int x = 0; x < 5; ++x)
      for (int c = 0; c < 3; ++c) chart.at(x, y, c) = static_cast<float>(linear((x + .5) / 5, (y + .5) / 3, c));
  for (int c = 0; c < 3; ++c) {
    for (double u : {.1, .23, .5, .77, .9})
      for (double v : {1. / 6, .3, .5, 5. / 6})
        EXPECT_NEAR(sample_chart(chart, u, v, c), linear(u, v, c), 1e-6) << u << ' ' << v;  // floats
    // Clamped beyond the outermost centres.
    EXPECT_EQ(sample_chart(chart, .02, .01, c), chart.at(0, 0, c));
    EXPECT_EQ(sample_chart(chart, 1, .01, c), chart.at(4, 0, c));
    EXPECT_NEAR(sample_chart(chart, .5, 1, c), chart.at(2, 2, c), 1e-6);
  }
}

TEST(ReceiverGain, IsBilinearWithinEachSurface) {
  Model model = test::room();
  // Linear in (u, v) of each wall, and ten times as much on the second.
  const auto linear = [](const ChartPoint& p, int c) {
    return (p.surface ? 10 : 1) * (1 + .3 * c + (.5 - .1 * c) * p.u + .2 * p.v);
  };
  for (int i = 0; i < model.patches.size(); ++i)
    for (int c = 0; c < 3; ++c) model.k(i, c) = static_cast<float>(linear(model.patches.centre(i), c));
  const Radiosity gain = receiver_gain(model);
  const std::vector<ChartPoint> points = receiver_points(model.patches, model.receiver_factor);
  ASSERT_EQ(gain.rows(), static_cast<int>(points.size()));
  for (int r = 0; r < gain.rows(); ++r) {
    const ChartPoint& p = points[r];
    // The outermost receivers lie beyond the outermost patch centres: clamped there.
    const double lu = .5 / model.patches.nu(p.surface), lv = .5 / model.patches.nv(p.surface);
    const ChartPoint clamped{p.surface, std::clamp(p.u, lu, 1 - lu), std::clamp(p.v, lv, 1 - lv)};
    for (int c = 0; c < 3; ++c) EXPECT_NEAR(gain(r, c), linear(clamped, c), 3e-6) << r;  // floats up to 20
  }
}

}  // namespace
}  // namespace countershade::solver
