// Path tracing of the indirect light at single camera pixels: no blocks, no receivers, no interpolation.
#include <algorithm>
#include <cmath>

#include "calib/base/parallel.h"
#include "calib/base/random.h"
#include "simdata/render/simulator_state.h"

namespace countershade::simdata {

namespace {

struct PathTracer {
  const Scene& scene;
  const std::vector<Emitter>& emitters;
  const Paint& paint;
  const std::vector<PictureLight>& light;
  double ambient;

  Eigen::Vector3d bounce(const ChartPoint& from, Random& random) const {
    const double a = random.uniform(), b = random.uniform();
    return cosine_direction(scene.screen().normal(from), scene.plane(from.surface).along_u(), a, b);
  }

  // Irradiance that arrives at `start` after at least one reflection: one sample.
  Eigen::Array3d path(const ChartPoint& start, Random& random) const {
    Eigen::Array3d sum = Eigen::Array3d::Zero(), throughput = Eigen::Array3d::Ones();
    ChartPoint at = start;
    for (int vertex = 0;; ++vertex) {
      const SceneHit hit = scene.hit(at.surface, scene.screen().point(at), bounce(at, random));
      if (hit.at.surface < 0) return vertex == 0 ? sum : sum + throughput * ambient;
      if (!hit.front) return sum;
      at = hit.at;
      throughput *= paint.base[at.surface].head<3>().cast<double>() * paint.texture(at.surface, at.u, at.v);
      for (std::size_t q = 0; q < emitters.size(); ++q)
        if (const auto beam = emitters[q].beam(scene, at.surface, scene.screen().point(at), emitters[q].margin()))
          sum += throughput * beam->irradiance *
                 light[q]
                     .at(static_cast<float>(beam->pixel.x()), static_cast<float>(beam->pixel.y()))
                     .head<3>()
                     .cast<double>();
      const double survives = std::min(1.0, throughput.maxCoeff());  // Russian roulette
      if (random.uniform() >= survives) return sum;
      throughput /= survives;
    }
  }
};

}  // namespace

Simulator::Traced Simulator::trace_indirect(int camera, std::span<const Picture> pictures,
                                            std::span<const Eigen::Vector2d> pixels, int paths) const {
  CS_CHECK(paths >= 2, "a standard error takes two paths");
  const View& view = *state_->views.at(camera);
  const std::vector<PictureLight> light = state_->light_of(pictures);
  const PathTracer tracer{*state_->scene, state_->emitters, state_->paint, light, state_->simulation.ambient};
  const int channels = view.spec().channels;
  Traced traced{std::vector<double>(pixels.size() * channels, 0), std::vector<double>(pixels.size() * channels, 0)};
  parallel_for(static_cast<int>(pixels.size()), [&](int i) {
    const ChartPoint at = screen().intersect(view.device().ray(pixels[i]));
    if (at.surface < 0) return;
    const Eigen::Array3d reflected = state_->paint.base[at.surface].head<3>().cast<double>() *
                                     state_->paint.texture(at.surface, at.u, at.v) * view.scale() *
                                     view.transmission(pixels[i].x(), pixels[i].y());
    Random random(mix(state_->simulation.seed ^ hash_name("trace")) ^ mix(static_cast<std::uint64_t>(i)));
    Eigen::Array3d sum = Eigen::Array3d::Zero(), squares = Eigen::Array3d::Zero();
    for (int k = 0; k < paths; ++k) {
      Eigen::Array3d sample = reflected * tracer.path(at, random);
      if (channels == 1) sample.setConstant(sample.mean());
      sum += sample, squares += sample * sample;
    }
    const Eigen::Array3d mean = sum / paths;
    const Eigen::Array3d variance = (squares / paths - mean * mean) / (paths - 1);
    for (int c = 0; c < channels; ++c) {
      traced.mean[i * channels + c] = mean[c];
      traced.standard_error[i * channels + c] = std::sqrt(std::max(0.0, variance[c]));
    }
  });
  return traced;
}

}  // namespace countershade::simdata
