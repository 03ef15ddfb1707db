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

  // Direct light that leaves a point towards `out`, times pi / albedo.
  Eigen::Array3d direct(const SurfacePoint& at, const Eigen::Vector3d& out) const {
    Eigen::Array3d sum = Eigen::Array3d::Constant(paint.daylight(at) * paint.evenly_lit(at, out));
    for (std::size_t q = 0; q < emitters.size(); ++q)
      if (const auto beam = emitters[q].beam(scene, at, emitters[q].margin())) {
        const double lobe = beam->from_behind ? paint.evenly_lit(at, out) : paint.lobe(at, beam->to_projector, out);
        const Light4 sent = light[q].at(static_cast<float>(beam->pixel.x()), static_cast<float>(beam->pixel.y()),
                                        static_cast<float>(beam->level));
        sum += lobe * beam->irradiance * sent.head<3>().cast<double>();
      }
    return sum;
  }

  // Light that arrives at `start` after at least one reflection and leaves it towards `out`, times pi / albedo: one
  // sample.
  Eigen::Array3d path(const SurfacePoint& start, Eigen::Vector3d out, Random& random) const {
    Eigen::Array3d sum = Eigen::Array3d::Zero(), throughput = Eigen::Array3d::Ones();
    SurfacePoint at = start;
    for (int vertex = 0;; ++vertex) {
      const double a = random.uniform(), b = random.uniform();
      const Eigen::Vector3d in = cosine_direction(at.normal, at.along_u, a, b);
      throughput *= paint.lobe(at, in, out);
      const SceneHit hit = scene.hit(at, in);
      if (hit.at.surface < 0) return vertex == 0 ? sum : sum + throughput * ambient;
      if (!hit.front) return sum;
      at = hit.at, out = -in;
      throughput *= paint.base()[at.surface].head<3>().cast<double>() * paint.texture(at);
      sum += throughput * direct(at, out);
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
    const Ray ray = view.device().ray(pixels[i]);
    const SceneHit seen = state_->scene->look(ray);
    if (seen.at.surface < 0 || !seen.front) return;
    const Eigen::Vector3d to_camera = -ray.direction.normalized();
    const Eigen::Array3d reflected = state_->paint.base()[seen.at.surface].head<3>().cast<double>() *
                                     state_->paint.texture(seen.at) * view.scale() *
                                     view.transmission(pixels[i].x(), pixels[i].y());
    Random random(mix(state_->simulation.seed ^ hash_name("trace")) ^ mix(static_cast<std::uint64_t>(i)));
    Eigen::Array3d sum = Eigen::Array3d::Zero(), squares = Eigen::Array3d::Zero();
    for (int k = 0; k < paths; ++k) {
      Eigen::Array3d sample = reflected * tracer.path(seen.at, to_camera, random);
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
