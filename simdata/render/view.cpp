#include "simdata/render/view.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "calib/base/parallel.h"

namespace countershade::simdata {

namespace {

constexpr int kSub = 2;  // rays per pixel along each axis

Light4 interpolated(const Rgb& field, const Receivers::Stencil& s) {
  Light4 sum = Light4::Zero();
  for (int i = 0; i < 4; ++i) sum += s.weight[i] * field.row(s.index[i]).transpose().array();
  return sum;
}

}  // namespace

View::View(const SimulatedCamera& spec, const Device& device, const Scene& scene, const std::vector<Emitter>& emitters,
           const Paint& paint, const IndirectLight& indirect, int viewer, double ambient)
    : spec_(spec),
      device_(device),
      base_(paint.base()),
      surfaces_(scene.size()),
      viewer_(viewer),
      paint_(paint),
      ambient_(static_cast<float>(ambient)) {
  base_.insert(base_.end(), paint.base().begin(), paint.base().end());
  const int height = spec.resolution[1];
  walls_.resize(height);
  beams_.assign(emitters.size() + 1, std::vector<std::vector<BeamSample>>(height));
  parallel_for(height, [&](int y) { sample_row(y, {scene, emitters, indirect}); });
  std::size_t seen = 0;
  for (const auto& row : walls_)
    for (const WallSample& w : row) seen += w.field < surfaces_;
  coverage_ = static_cast<double>(seen) / (static_cast<double>(spec.resolution[0]) * height);
}

double View::transmission(double x, double y) const {
  const double width = spec_.resolution[0], height = spec_.resolution[1];
  const double dx = x - (width - 1) / 2, dy = y - (height - 1) / 2;
  return 1 - spec_.vignetting * 4 * (dx * dx + dy * dy) / (width * width + height * height);
}

void View::sample_row(int y, const Traced& traced) {
  const Pose world_from_device = device_.device_from_world.inverse();
  for (int x = 0; x < spec_.resolution[0]; ++x) {
    const double kept = transmission(x, y) / (kSub * kSub);
    const auto column = static_cast<std::uint16_t>(x);
    std::vector<Seen> seen;
    double surround = 0;
    for (int k = 0; k < kSub * kSub; ++k) {
      const Eigen::Vector2d q(x + (k % kSub + 0.5) / kSub - 0.5, y + (k / kSub + 0.5) / kSub - 0.5);
      const SceneHit hit =
          traced.scene.look({world_from_device.translation, world_from_device.rotation * device_.lens.unproject(q)});
      if (hit.at.surface < 0) surround += kept;
      if (hit.at.surface < 0 || !hit.front) continue;  // the back of a surface is black
      const double factor = kept * paint_.texture(hit.at);
      add_seen(seen, traced, hit.at, factor);
      sample_beams(y, column, traced, hit.at, factor);
    }
    if (surround > 0) walls_[y].push_back({{}, static_cast<float>(surround), column, kNone});
    for (const Seen& s : seen) sample_wall(y, column, traced, s);
  }
  for (auto& rows : beams_) rows[y].shrink_to_fit();
}

void View::add_seen(std::vector<Seen>& seen, const Traced& traced, const SurfacePoint& at, double factor) const {
  const bool averaged = traced.scene.shape(at.surface).form() != Shape::Form::kMesh;
  for (Seen& s : seen)
    if (averaged && s.at.surface == at.surface && std::abs(s.at.u / s.count - at.u) < 0.5) {  // not across a seam
      s.at.u += at.u, s.at.v += at.v, s.at.x += at.x;
      s.factor += factor, ++s.count;
      return;
    }
  seen.push_back({at, factor, 1});
}

void View::sample_beams(int y, std::uint16_t column, const Traced& traced, const SurfacePoint& at, double factor) {
  const auto surface = static_cast<std::uint16_t>(at.surface);
  const Eigen::Vector3d to_camera = (device_.position() - at.x).normalized();
  for (std::size_t p = 0; p < traced.emitters.size(); ++p)
    if (const auto beam = traced.emitters[p].beam(traced.scene, at, traced.emitters[p].margin())) {
      const double lobe =
          beam->from_behind ? paint_.evenly_lit(at, to_camera) : paint_.lobe(at, beam->to_projector, to_camera);
      beams_[p][y].push_back({static_cast<float>(beam->pixel.x()), static_cast<float>(beam->pixel.y()),
                              static_cast<float>(beam->level), static_cast<float>(factor * lobe * beam->irradiance),
                              column, surface});
    }
  if (const double daylight = paint_.daylight(at); daylight > 0)
    beams_.back()[y].push_back(
        {0, 0, 0, static_cast<float>(factor * daylight * paint_.evenly_lit(at, to_camera)), column, surface});
}

void View::sample_wall(int y, std::uint16_t column, const Traced& traced, const Seen& seen) {
  SurfacePoint at = seen.at;
  at.u /= seen.count, at.v /= seen.count, at.x /= seen.count;
  const Receivers::Stencil stencil = traced.indirect.receivers(at.surface).stencil(at);
  const Eigen::Vector3d to_camera = (device_.position() - at.x).normalized();
  walls_[y].push_back({stencil, static_cast<float>(seen.factor * paint_.directed(at, to_camera)), column,
                       static_cast<std::uint16_t>(at.surface)});
  if (paint_.is_glossy(at.surface))
    walls_[y].push_back(
        {stencil, static_cast<float>(seen.factor), column, static_cast<std::uint16_t>(surfaces_ + at.surface)});
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
  for (std::size_t p = 0; p < light.size(); ++p)
    for (const BeamSample& s : beams_[p][y])
      row[s.column] += base_[s.surface] * s.factor * light[p].at(s.x, s.y, s.level);
  for (const BeamSample& s : beams_.back()[y]) row[s.column] += base_[s.surface] * s.factor;
  if (ambient_ > 0)
    for (const WallSample& w : walls_[y]) {
      if (w.field == kNone) {
        row[w.column] += ambient_ * w.factor;
        continue;
      }
      const Eigen::VectorXf& escape =
          w.field < surfaces_ ? indirect.escape(w.field) : indirect.mirrored_escape(w.field - surfaces_, viewer_);
      float open = 0;
      for (int i = 0; i < 4; ++i) open += w.stencil.weight[i] * escape[w.stencil.index[i]];
      row[w.column] += base_[w.field] * (w.factor * ambient_ * open);
    }
}

void View::add_reflected(int y, const std::vector<Rgb>& field, std::vector<Light4>& row) const {
  for (const WallSample& w : walls_[y])
    if (w.field != kNone) row[w.column] += base_[w.field] * w.factor * interpolated(field[w.field], w.stencil);
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

Image View::reflected(const std::vector<Rgb>& field) const {
  return image_of([&](int y, std::vector<Light4>& row) { add_reflected(y, field, row); });
}

Image View::total(std::span<const PictureLight> light, const std::vector<Rgb>& field,
                  const IndirectLight& indirect) const {
  return image_of([&](int y, std::vector<Light4>& row) {
    add_direct(y, light, indirect, row);
    add_reflected(y, field, row);
  });
}

}  // namespace countershade::simdata
