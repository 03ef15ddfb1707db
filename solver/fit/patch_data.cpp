#include "solver/fit/patch_data.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "calib/base/parallel.h"

namespace countershade::solver {

namespace {

constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();

int channel_of(const Photo& photo, int c) {
  return photo.value.channels() == 1 ? 0 : c;
}

// Value between pixel centres; the caller has checked that (x, y) lies inside the picture.
float light_at(const Image& light, const Eigen::Vector2f& q, int c) {
  return sample_bilinear(light, q.x(), q.y(), c);
}

// Sums over the pixels of each patch, filled by one pass over the picture.
struct Sums {
  Radiosity value;
  std::vector<Radiosity> light;
  Eigen::VectorXf valid, all;
};

Sums sum_over_patches(const PixelGeometry& pixels, int patches, const Photo& photo, std::span<const Image> lights) {
  const int bands = 16;  // fixed, so that sums do not depend on the number of threads
  std::vector<Sums> partial(bands);
  parallel_for(bands, [&](int band) {
    Sums& s = partial[band];
    s.value = Radiosity::Zero(patches, 3);
    s.light.assign(lights.size(), Radiosity::Zero(patches, 3));
    s.valid = s.all = Eigen::VectorXf::Zero(patches);
    for (int y = pixels.height * band / bands; y < pixels.height * (band + 1) / bands; ++y) {
      for (int x = 0; x < pixels.width; ++x) {
        const std::size_t i = static_cast<std::size_t>(y) * pixels.width + x;
        const int patch = pixels.patch[i];
        if (patch < 0) continue;
        s.all[patch] += 1;
        if (!photo.valid.at(x, y)) continue;
        s.valid[patch] += 1;
        for (int c = 0; c < 3; ++c) s.value(patch, c) += photo.value.at(x, y, channel_of(photo, c));
        for (std::size_t q = 0; q < lights.size(); ++q) {
          const Eigen::Vector2f& beam = pixels.beam[q][i];
          if (std::isnan(beam.x())) continue;
          for (int c = 0; c < 3; ++c) s.light[q](patch, c) += light_at(lights[q], beam, c);
        }
      }
    }
  });
  Sums total = std::move(partial[0]);
  for (int band = 1; band < bands; ++band) {
    total.value += partial[band].value;
    total.valid += partial[band].valid;
    total.all += partial[band].all;
    for (std::size_t q = 0; q < lights.size(); ++q) total.light[q] += partial[band].light[q];
  }
  return total;
}

// Empty cells (weight 0) next to filled ones take their mean, ring by ring.
void grow(Image& chart, Image& weight, int rings) {
  for (int ring = 0; ring < rings; ++ring) {
    const Image old = chart, filled = weight;
    for (int y = 0; y < chart.height(); ++y)
      for (int x = 0; x < chart.width(); ++x) {
        if (filled.at(x, y) > 0) continue;
        float sum[3] = {0, 0, 0}, count = 0;
        for (int dy = -1; dy <= 1; ++dy)
          for (int dx = -1; dx <= 1; ++dx) {
            const int nx = x + dx, ny = y + dy;
            if (nx < 0 || ny < 0 || nx >= chart.width() || ny >= chart.height() || filled.at(nx, ny) <= 0) continue;
            for (int c = 0; c < 3; ++c) sum[c] += old.at(nx, ny, c);
            ++count;
          }
        if (count == 0) continue;
        for (int c = 0; c < 3; ++c) chart.at(x, y, c) = sum[c] / count;
        weight.at(x, y) = 1;
      }
  }
}

// Values at the receivers as a chart per surface.
std::vector<Image> receiver_charts(const Model& model, const Radiosity& values) {
  std::vector<Image> charts;
  for (int s = 0; s < model.screen.size(); ++s) {
    Image chart(model.receivers_u(s), model.receivers_v(s), 3);
    for (int r = 0; r < static_cast<int>(chart.pixels()); ++r)
      for (int c = 0; c < 3; ++c) chart.data()[3 * r + c] = values(model.receiver_offset(s) + r, c);
    charts.push_back(std::move(chart));
  }
  return charts;
}

// Gives each channel of a chart, whose channels are all the primaries' mean, its own share, patch by patch; patches
// that no light was measured on take the surface's.
void share_out(const Radiosity& mix, const Patches& patches, int surface, int cells, Image& chart) {
  Eigen::RowVector3f all = Eigen::RowVector3f::Zero();
  for (int i = 0; i < patches.count(surface); ++i) all += mix.row(patches.offset(surface) + i);
  if (!(all.sum() > 0)) return;
  for (int y = 0; y < chart.height(); ++y)
    for (int x = 0; x < chart.width(); ++x) {
      const Eigen::RowVector3f own = mix.row(patches.index(surface, x / cells, y / cells));
      const Eigen::RowVector3f& shares = own.sum() > 0 ? own : all;
      for (int c = 0; c < 3; ++c) chart.at(x, y, c) *= 3 * shares[c] / shares.sum();
    }
}

}  // namespace

PixelGeometry pixel_geometry(const Device& camera, const GeometryFit& geometry, const Patches& patches) {
  PixelGeometry pixels;
  pixels.width = camera.lens.width();
  pixels.height = camera.lens.height();
  const std::size_t count = static_cast<std::size_t>(pixels.width) * pixels.height;
  pixels.chart.resize(count);
  pixels.patch.assign(count, -1);
  pixels.beam.assign(geometry.projectors.size(), std::vector<Eigen::Vector2f>(count, Eigen::Vector2f(kNaN, kNaN)));
  parallel_for(pixels.height, [&](int y) {
    for (int x = 0; x < pixels.width; ++x) {
      const std::size_t i = static_cast<std::size_t>(y) * pixels.width + x;
      const Ray ray{Eigen::Vector3d::Zero(), camera.lens.unproject({x, y})};
      const ChartPoint chart = geometry.screen.intersect(ray);
      pixels.chart[i] = chart;
      if (chart.surface < 0) continue;
      pixels.patch[i] = patches.index(chart);
      const Eigen::Vector3d point = geometry.screen.point(chart), normal = geometry.screen.normal(chart);
      for (std::size_t q = 0; q < geometry.projectors.size(); ++q) {
        const Device& projector = geometry.projectors[q].device;
        const Eigen::Vector2d pixel = projector.project(point);
        if (projector.lens.contains(pixel) && normal.dot(projector.position() - point) > 0)
          pixels.beam[q][i] = pixel.cast<float>();
      }
    }
  });
  return pixels;
}

Eigen::VectorXf pixels_per_patch(const PixelGeometry& pixels, int patches) {
  Eigen::VectorXf count = Eigen::VectorXf::Zero(patches);
  for (int patch : pixels.patch)
    if (patch >= 0) count[patch] += 1;
  return count;
}

PatchFrame reduce_frame(const PixelGeometry& pixels, int patches, const Photo& photo, const NoiseModel& noise,
                        std::span<const Image> lights) {
  CS_CHECK(photo.value.same_size(pixels.width, pixels.height), "photo and camera differ in size");
  CS_CHECK(lights.size() == pixels.beam.size(), "one light per projector");
  Sums sums = sum_over_patches(pixels, patches, photo, lights);
  PatchFrame frame;
  frame.mean = channel_means(photo.value);
  for (const Image& light : lights) frame.shown.push_back(channel_means(light));
  frame.m = Radiosity::Zero(patches, 3);
  frame.sigma = Radiosity::Constant(patches, 3, std::numeric_limits<float>::infinity());
  frame.p.assign(lights.size(), Radiosity::Zero(patches, 3));
  for (int i = 0; i < patches; ++i) {
    const float n = sums.valid[i];
    if (n == 0) continue;
    frame.m.row(i) = sums.value.row(i) / n;
    for (std::size_t q = 0; q < lights.size(); ++q) frame.p[q].row(i) = sums.light[q].row(i) / n;
    if (n < 0.8f * sums.all[i]) continue;
    for (int c = 0; c < 3; ++c)
      frame.sigma(i, c) = static_cast<float>(noise.sigma(std::max(0.0f, frame.m(i, c))) / std::sqrt(n));
  }
  return frame;
}

Image bounced_light(const PixelGeometry& pixels, const Model& model, const Image& photo) {
  CS_CHECK(photo.same_size(pixels.width, pixels.height), "photo and camera differ in size");
  const int patches = model.patches.size();
  const Sums sums = sum_over_patches(pixels, patches, {photo, Mask(photo.width(), photo.height(), 1, 1), 0}, {});
  Radiosity shines(patches, 3);
  for (int s = 0; s < model.screen.size(); ++s) {
    const int first = model.patches.offset(s), count = model.patches.count(s);
    const Eigen::RowVector3f all =
        sums.value.middleRows(first, count).colwise().sum() / std::max(1.0f, sums.valid.segment(first, count).sum());
    for (int i = first; i < first + count; ++i)
      shines.row(i) = sums.valid[i] > 0 ? Eigen::RowVector3f(sums.value.row(i) / sums.valid[i]) : all;
  }
  Radiosity gain = receiver_gain(model);
  if (photo.channels() == 1) gain.colwise() = gain.rowwise().mean().eval();
  const std::vector<Image> charts = receiver_charts(model, gain.cwiseProduct(Radiosity(model.G * shines)));
  Image bounced(photo.width(), photo.height(), photo.channels());
  parallel_for(photo.height(), [&](int y) {
    for (int x = 0; x < photo.width(); ++x) {
      const ChartPoint& at = pixels.chart[static_cast<std::size_t>(y) * photo.width() + x];
      for (int c = 0; at.surface >= 0 && c < photo.channels(); ++c)
        bounced.at(x, y, c) = sample_chart(charts[at.surface], at.u, at.v, c);
    }
  });
  return bounced;
}

std::vector<Image> gain_charts(const PixelGeometry& pixels, const Model& model, int q, const Photo& white,
                               const Photo& black, const PatchFrame& white_patches, const PatchFrame& black_patches,
                               const Radiosity& mix) {
  const Radiosity difference = white_patches.m - black_patches.m;
  Radiosity gain = receiver_gain(model);
  const bool grey = mix.rows() > 0;
  if (grey) gain.colwise() = gain.rowwise().mean().eval();
  const Radiosity indirect = gain.cwiseProduct(Radiosity(model.G * difference));
  const double swing = 1 - model.projectors[q].response.black_level;
  const Lens& lens = model.projectors[q].device.lens;
  const std::vector<Image> shade = receiver_charts(model, indirect);
  std::vector<Image> charts, weights;
  for (int s = 0; s < model.screen.size(); ++s) {
    const int width = model.patches.nu(s) * model.gain_factor, height = model.patches.nv(s) * model.gain_factor;
    charts.emplace_back(width, height, 3);
    weights.emplace_back(width, height, 1);
  }
  for (int y = 0; y < pixels.height; ++y)
    for (int x = 0; x < pixels.width; ++x) {
      const std::size_t i = static_cast<std::size_t>(y) * pixels.width + x;
      const ChartPoint& at = pixels.chart[i];
      const Eigen::Vector2f& beam = pixels.beam[q][i];
      if (at.surface < 0 || std::isnan(beam.x()) || !white.valid.at(x, y) || !black.valid.at(x, y)) continue;
      // Two pixels of the picture's border are dimmed by blur.
      if (beam.x() < 2 || beam.y() < 2 || beam.x() > lens.width() - 3 || beam.y() > lens.height() - 3) continue;
      Image& chart = charts[at.surface];
      const int cx = std::clamp(static_cast<int>(at.u * chart.width()), 0, chart.width() - 1);
      const int cy = std::clamp(static_cast<int>(at.v * chart.height()), 0, chart.height() - 1);
      for (int c = 0; c < 3; ++c) {
        const float light = white.value.at(x, y, channel_of(white, c)) - black.value.at(x, y, channel_of(black, c));
        chart.at(cx, cy, c) += static_cast<float>((light - sample_chart(shade[at.surface], at.u, at.v, c)) / swing);
      }
      weights[at.surface].at(cx, cy) += 1;
    }
  for (std::size_t s = 0; s < charts.size(); ++s) {
    for (std::size_t i = 0; i < charts[s].pixels(); ++i)
      for (int c = 0; c < 3; ++c)
        charts[s].data()[3 * i + c] =
            weights[s].data()[i] > 0 ? std::max(0.0f, charts[s].data()[3 * i + c] / weights[s].data()[i]) : 0.0f;
    if (grey) share_out(mix, model.patches, static_cast<int>(s), model.gain_factor, charts[s]);
    grow(charts[s], weights[s], model.gain_factor);
  }
  return charts;
}

}  // namespace countershade::solver
