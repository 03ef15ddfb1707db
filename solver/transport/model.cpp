#include "solver/transport/model.h"

#include "calib/base/check.h"
#include "calib/base/parallel.h"

namespace countershade::solver {

std::vector<ChartPoint> receiver_points(const Patches& patches, int receiver_factor) {
  CS_CHECK(receiver_factor >= 1, "at least one receiver per patch");
  std::vector<ChartPoint> points;
  for (int s = 0; s < patches.surfaces(); ++s) {
    const int nu = patches.nu(s) * receiver_factor, nv = patches.nv(s) * receiver_factor;
    for (int v = 0; v < nv; ++v)
      for (int u = 0; u < nu; ++u) points.push_back({s, (u + 0.5) / nu, (v + 0.5) / nv});
  }
  return points;
}

PixelMap pixel_map(const Device& projector, const Screen& screen) {
  CS_CHECK(screen.size() <= kMaxSurfaces, "a pixel map has room for fewer surfaces");
  PixelMap map;
  map.width = projector.lens.width(), map.height = projector.lens.height();
  const std::size_t count = static_cast<std::size_t>(map.width) * map.height;
  map.surface.assign(count, -1);
  map.u.assign(count, 0.0f);
  map.v.assign(count, 0.0f);
  parallel_for(map.height, [&](int y) {
    for (int x = 0; x < map.width; ++x) {
      const ChartPoint at = screen.intersect(projector.ray(Eigen::Vector2d(x, y)));
      const std::size_t i = static_cast<std::size_t>(y) * map.width + x;
      map.surface[i] = static_cast<std::int8_t>(at.surface);
      if (at.surface < 0) continue;
      map.u[i] = static_cast<float>(at.u);
      map.v[i] = static_cast<float>(at.v);
    }
  });
  return map;
}

float sample_chart(const Image& chart, double u, double v, int c) {
  return sample_bilinear(chart, u * chart.width() - 0.5, v * chart.height() - 0.5, c);
}

Radiosity receiver_gain(const Model& model) {
  Radiosity gain(model.receivers(), 3);
  int at = 0;
  for (int s = 0; s < model.patches.surfaces(); ++s) {
    Image chart(model.patches.nu(s), model.patches.nv(s), 3);
    for (int i = 0; i < model.patches.count(s); ++i)
      for (int c = 0; c < 3; ++c) chart.data()[3 * i + c] = model.k(model.patches.offset(s) + i, c);
    const int nu = model.receivers_u(s), nv = model.receivers_v(s);
    for (int y = 0; y < nv; ++y)
      for (int x = 0; x < nu; ++x, ++at)
        for (int c = 0; c < 3; ++c) gain(at, c) = sample_chart(chart, (x + 0.5) / nu, (y + 0.5) / nv, c);
  }
  return gain;
}

}  // namespace countershade::solver
