#include "solver/compensate/frame_plan.h"

#include <algorithm>
#include <bit>
#include <cmath>

#include "calib/base/check.h"
#include "calib/base/parallel.h"

namespace countershade::solver {
namespace {

Chart chart_of(const Image& image) {
  CS_CHECK(image.channels() == 3 && !image.empty(), "a gain chart has three channels and at least one cell");
  Chart chart{image.width(), image.height(), {}};
  chart.cells.reserve(image.pixels());
  for (int y = 0; y < image.height(); ++y)
    for (int x = 0; x < image.width(); ++x) {
      Eigen::Array4f cell = Eigen::Array4f::Zero();
      for (int c = 0; c < 3; ++c)
        if (const float a = image.at(x, y, c); std::isfinite(a) && a > 0) cell[c] = a;
      chart.cells.push_back(cell);
    }
  return chart;
}

ProjectorPlan plan_of(const ProjectorModel& projector, const Screen& screen) {
  const PixelMap& map = projector.map;
  const std::size_t pixels = static_cast<std::size_t>(map.width) * map.height;
  CS_CHECK(map.surface.size() == pixels && map.u.size() == pixels && map.v.size() == pixels,
           "the pixel map of projector " + projector.id + " is incomplete");
  CS_CHECK(static_cast<int>(projector.gain.size()) == screen.size(),
           "projector " + projector.id + " needs a gain chart per surface");
  const float black = static_cast<float>(projector.response.black_level);
  ProjectorPlan plan{map.width,
                     map.height,
                     black,
                     1 - black,
                     projector.response.curve.decode_table(65536),
                     EncodeTable(projector.response.curve),
                     {},
                     {},
                     {}};
  for (const Image& gain : projector.gain) plan.gain.push_back(chart_of(gain));
  return plan;
}

// Whether any of the four pixels around q lights the surface.
bool lights_surface(const PixelMap& map, const Eigen::Vector2d& q, int surface) {
  const int x0 = static_cast<int>(std::floor(q.x())), y0 = static_cast<int>(std::floor(q.y()));
  for (int y = std::max(y0, 0); y <= std::min(y0 + 1, map.height - 1); ++y)
    for (int x = std::max(x0, 0); x <= std::min(x0 + 1, map.width - 1); ++x)
      if (map.surface[static_cast<std::size_t>(y) * map.width + x] == surface) return true;
  return false;
}

void sample_patch(const Model& model, const ProjectorModel& projector, const Eigen::Vector3d& position, int patch,
                  const ProjectorPlan& plan, LightSample* samples) {
  const Patches& patches = model.patches;
  const int s = patches.surface_of(patch), local = patch - patches.offset(s);
  const int iu = local % patches.nu(s), iv = local / patches.nu(s);
  for (int j = 0; j < kReduceSamples; ++j)
    for (int i = 0; i < kReduceSamples; ++i) {
      const ChartPoint point{s, (iu + (i + .5) / kReduceSamples) / patches.nu(s),
                             (iv + (j + .5) / kReduceSamples) / patches.nv(s)};
      const Eigen::Vector2f q = lighting_pixel(projector, position, model.screen, point);
      if (q.x() == kNowhere) continue;
      const Eigen::Array4f a = plan.gain[s].sample(static_cast<float>(point.u), static_cast<float>(point.v));
      samples[j * kReduceSamples + i] = {
          (q.x() + .5f) / kLightReduction - .5f, (q.y() + .5f) / kLightReduction - .5f, {a[0], a[1], a[2]}};
    }
}

// Where projector r lights the pixels of projector q; empty if nowhere.
Overlap overlap_of(const Model& model, int q, int r) {
  const PixelMap& map = model.projectors[q].map;
  const ProjectorModel& other = model.projectors[r];
  const Eigen::Vector3d position = other.device.position();
  std::vector<std::array<float, 2>> pixel(static_cast<std::size_t>(map.width) * map.height, {kNowhere, kNowhere});
  std::vector<std::array<int, 2>> extent(map.height, {map.width, -1});  // first and last column, per row
  parallel_for(map.height, [&](int y) {
    for (int x = 0; x < map.width; ++x) {
      const std::size_t i = static_cast<std::size_t>(y) * map.width + x;
      if (map.surface[i] < 0) continue;
      const Eigen::Vector2f p = lighting_pixel(other, position, model.screen, {map.surface[i], map.u[i], map.v[i]});
      if (p.x() == kNowhere) continue;
      pixel[i] = {p.x(), p.y()};
      extent[y] = {std::min(extent[y][0], x), std::max(extent[y][1], x)};
    }
  });
  int x0 = map.width, x1 = -1, y0 = map.height, y1 = -1;
  for (int y = 0; y < map.height; ++y) {
    if (extent[y][1] < 0) continue;
    x0 = std::min(x0, extent[y][0]), x1 = std::max(x1, extent[y][1]);
    y0 = std::min(y0, y), y1 = y;
  }
  Overlap overlap{r, x0, y0, x1 - x0 + 1, y1 - y0 + 1, {}};
  if (x1 < 0) return {r, 0, 0, 0, 0, {}};
  for (int y = y0; y <= y1; ++y) {
    const auto* row = pixel.data() + static_cast<std::size_t>(y) * map.width;
    overlap.pixel.insert(overlap.pixel.end(), row + x0, row + x1 + 1);
  }
  return overlap;
}

// Mean gain of every patch: what it gets from a projector at full white.
Radiosity mean_gain(const ProjectorPlan& plan, int patches) {
  constexpr int kSamples = kReduceSamples * kReduceSamples;
  Radiosity mean = Radiosity::Zero(patches, 3);
  for (int i = 0; i < patches; ++i)
    for (int n = 0; n < kSamples; ++n)
      for (int c = 0; c < 3; ++c)
        mean(i, c) += plan.samples[static_cast<std::size_t>(i) * kSamples + n].gain[c] / kSamples;
  return mean;
}

}  // namespace

Taps taps(float x, float y, int width, int height) {
  x = std::clamp(x, 0.f, static_cast<float>(width - 1));
  y = std::clamp(y, 0.f, static_cast<float>(height - 1));
  const int x0 = static_cast<int>(x), y0 = static_cast<int>(y);
  const int x1 = std::min(x0 + 1, width - 1), y1 = std::min(y0 + 1, height - 1);
  const float fx = x - static_cast<float>(x0), fy = y - static_cast<float>(y0);
  return {{y0 * width + x0, y0 * width + x1, y1 * width + x0, y1 * width + x1},
          {(1 - fx) * (1 - fy), fx * (1 - fy), (1 - fx) * fy, fx * fy}};
}

Eigen::Array4f Chart::sample(float u, float v) const {
  const Taps t = taps(u * static_cast<float>(nu) - .5f, v * static_cast<float>(nv) - .5f, nu, nv);
  return t.weight[0] * cells[t.index[0]] + t.weight[1] * cells[t.index[1]] + t.weight[2] * cells[t.index[2]] +
         t.weight[3] * cells[t.index[3]];
}

EncodeTable::EncodeTable(const Response& response) {
  const std::uint32_t last = std::bit_cast<std::uint32_t>(1.f);
  for (std::uint32_t bits = kFirstBits; bits <= last; bits += 1u << kShift)
    values_.push_back(static_cast<float>(response.encode(std::bit_cast<float>(bits))));
}

float EncodeTable::operator()(float fraction) const {
  if (!(fraction > 0)) return 0;
  if (fraction >= 1) return values_.back();
  const std::uint32_t bits = std::bit_cast<std::uint32_t>(fraction);
  if (bits < kFirstBits) return values_.front() * (fraction * 0x1p32f);
  const std::uint32_t offset = bits - kFirstBits;
  const float part = static_cast<float>(offset & ((1u << kShift) - 1)) * (1.f / (1u << kShift));
  const float low = values_[offset >> kShift], high = values_[(offset >> kShift) + 1];
  return low + part * (high - low);
}

Eigen::Vector2f lighting_pixel(const ProjectorModel& projector, const Eigen::Vector3d& projector_position,
                               const Screen& screen, const ChartPoint& point) {
  Eigen::Vector2f nowhere(kNowhere, kNowhere);
  const Eigen::Vector3d x = screen.point(point);
  if (!(screen.normal(point).dot(projector_position - x) > 0)) return nowhere;
  const Eigen::Vector2d q = projector.device.project(x);
  const PixelMap& map = projector.map;
  const bool inside = q.x() > -.5 && q.y() > -.5 && q.x() < map.width - .5 && q.y() < map.height - .5;  // false for NaN
  if (!inside || !lights_surface(map, q, point.surface)) return nowhere;
  return q.cast<float>();
}

FramePlan make_frame_plan(const Model& model) {
  constexpr int kSamples = kReduceSamples * kReduceSamples;
  const int P = model.patches.size(), Q = static_cast<int>(model.projectors.size());
  CS_CHECK(model.e.rows() == P && model.e.allFinite(), "the ambient light e must be finite and have a row per patch");
  FramePlan plan;
  plan.low = plan.high = model.e;
  for (int q = 0; q < Q; ++q) {
    const ProjectorModel& projector = model.projectors[q];
    ProjectorPlan p = plan_of(projector, model.screen);
    p.samples.resize(static_cast<std::size_t>(P) * kSamples);
    const Eigen::Vector3d position = projector.device.position();
    parallel_for(P, [&](int i) {
      sample_patch(model, projector, position, i, p, p.samples.data() + static_cast<std::size_t>(i) * kSamples);
    });
    for (int r = 0; r < Q; ++r) {
      if (r == q) continue;
      if (Overlap overlap = overlap_of(model, q, r); overlap.width > 0) p.overlaps.push_back(std::move(overlap));
    }
    const Radiosity gain = mean_gain(p, P);
    plan.low += p.black * gain;
    plan.high += gain;
    plan.projectors.push_back(std::move(p));
  }
  return plan;
}

}  // namespace countershade::solver
