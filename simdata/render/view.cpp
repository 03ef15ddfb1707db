#include "simdata/render/view.h"

#include <algorithm>
#include <cmath>

#include "calib/base/parallel.h"

namespace countershade::simdata {

namespace {

constexpr int kSub = 2;  // rays per pixel along each axis

Light4 interpolated(const Rgb& field, const ReceiverGrid::Stencil& s) {
  Light4 sum = Light4::Zero();
  for (int i = 0; i < 4; ++i) sum += s.weight[i] * field.row(s.index[i]).transpose().array();
  return sum.max(0.0f);  // continued beyond the outermost receivers it may fall below
}

}  // namespace

View::View(const SimulatedCamera& spec, const Device& device, const Scene& scene, const std::vector<Emitter>& emitters,
           const Paint& paint, double ambient)
    : spec_(spec), device_(device), base_(paint.base), paint_(paint), ambient_(static_cast<float>(ambient)) {
  const int height = spec.resolution[1];
  walls_.resize(height);
  beams_.assign(emitters.size(), std::vector<std::vector<BeamSample>>(height));
  parallel_for(height, [&](int y) { sample_row(y, scene, emitters); });
  std::size_t seen = 0;
  for (const auto& row : walls_)
    for (const WallSample& w : row) seen += w.surface != kNone;
  coverage_ = static_cast<double>(seen) / (static_cast<double>(spec.resolution[0]) * height);
}

double View::transmission(double x, double y) const {
  const double width = spec_.resolution[0], height = spec_.resolution[1];
  const double dx = x - (width - 1) / 2, dy = y - (height - 1) / 2;
  return 1 - spec_.vignetting * 4 * (dx * dx + dy * dy) / (width * width + height * height);
}

void View::sample_row(int y, const Scene& scene, const std::vector<Emitter>& emitters) {
  const Pose world_from_device = device_.device_from_world.inverse();
  constexpr double kShare = 1.0 / (kSub * kSub);
  for (int x = 0; x < spec_.resolution[0]; ++x) {
    const double kept = transmission(x, y) * kShare;
    std::array<WallSample, kSub * kSub> walls;
    std::array<int, kSub * kSub> counts;
    int distinct = 0;
    for (int k = 0; k < kSub * kSub; ++k) {
      const Eigen::Vector2d q(x + (k % kSub + 0.5) / kSub - 0.5, y + (k / kSub + 0.5) / kSub - 0.5);
      const Ray ray{world_from_device.translation, world_from_device.rotation * device_.lens.unproject(q)};
      const ChartPoint at = scene.screen().intersect(ray);
      const auto surface = at.surface < 0 ? kNone : static_cast<std::uint16_t>(at.surface);
      const double painted = at.surface < 0 ? kept : kept * paint_.texture(at.surface, at.u, at.v);
      int i = 0;
      while (i < distinct && walls[i].surface != surface) ++i;
      if (i == distinct) walls[i] = {0, 0, 0, static_cast<std::uint16_t>(x), surface}, counts[i] = 0, ++distinct;
      walls[i].u += static_cast<float>(at.u), walls[i].v += static_cast<float>(at.v);
      walls[i].factor += static_cast<float>(painted), ++counts[i];
      if (at.surface < 0) continue;
      for (std::size_t p = 0; p < emitters.size(); ++p)
        if (const auto beam = emitters[p].beam(scene, at.surface, scene.screen().point(at), emitters[p].margin()))
          beams_[p][y].push_back({static_cast<float>(beam->pixel.x()), static_cast<float>(beam->pixel.y()),
                                  static_cast<float>(painted * beam->irradiance), static_cast<std::uint16_t>(x),
                                  surface});
    }
    for (int i = 0; i < distinct; ++i) {
      walls[i].u /= static_cast<float>(counts[i]), walls[i].v /= static_cast<float>(counts[i]);
      walls_[y].push_back(walls[i]);
    }
  }
  for (auto& rows : beams_) rows[y].shrink_to_fit();
}

void View::write_row(Image& image, int y, const std::vector<Light4>& row) const {
  float* to = image.row(y);
  for (int x = 0; x < image.width(); ++x) {
    const Light4 value = row[x] * scale_;
    if (spec_.channels == 1)
      to[x] = (value[0] + value[1] + value[2]) / 3;
    else
      for (int c = 0; c < 3; ++c) to[3 * x + c] = value[c];
  }
}

void View::add_direct(int y, std::span<const PictureLight> light, const IndirectLight& indirect,
                      std::vector<Light4>& row) const {
  for (std::size_t p = 0; p < beams_.size(); ++p)
    for (const BeamSample& s : beams_[p][y]) row[s.column] += base_[s.surface] * s.factor * light[p].at(s.x, s.y);
  if (ambient_ > 0)
    for (const WallSample& w : walls_[y]) {
      if (w.surface == kNone) {
        row[w.column] += ambient_ * w.factor;
        continue;
      }
      const auto stencil = indirect.grid().stencil(w.surface, w.u, w.v);
      float open = 0;
      for (int i = 0; i < 4; ++i) open += stencil.weight[i] * indirect.escape(w.surface)[stencil.index[i]];
      row[w.column] += base_[w.surface] * (w.factor * ambient_ * open);
    }
}

void View::add_reflected(int y, const std::vector<Rgb>& field, const IndirectLight& indirect,
                         std::vector<Light4>& row) const {
  for (const WallSample& w : walls_[y])
    if (w.surface != kNone)
      row[w.column] +=
          base_[w.surface] * w.factor * interpolated(field[w.surface], indirect.grid().stencil(w.surface, w.u, w.v));
}

template <class AddRow>
Image View::image_of(AddRow add_row) const {
  Image image(spec_.resolution[0], spec_.resolution[1], spec_.channels);
  parallel_for(image.height(), [&](int y) {
    std::vector<Light4> row(image.width(), Light4::Zero());
    add_row(y, row);
    write_row(image, y, row);
  });
  return image;
}

Image View::direct(std::span<const PictureLight> light, const IndirectLight& indirect) const {
  return image_of([&](int y, std::vector<Light4>& row) { add_direct(y, light, indirect, row); });
}

Image View::reflected(const std::vector<Rgb>& field, const IndirectLight& indirect) const {
  return image_of([&](int y, std::vector<Light4>& row) { add_reflected(y, field, indirect, row); });
}

Image View::total(std::span<const PictureLight> light, const std::vector<Rgb>& field,
                  const IndirectLight& indirect) const {
  return image_of([&](int y, std::vector<Light4>& row) {
    add_direct(y, light, indirect, row);
    add_reflected(y, field, indirect, row);
  });
}

}  // namespace countershade::simdata
