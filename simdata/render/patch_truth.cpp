#include "simdata/render/patch_truth.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "calib/base/check.h"
#include "calib/base/parallel.h"
#include "calib/base/random.h"
#include "simdata/render/simulator_state.h"

namespace countershade::simdata {

namespace {

int cell_of(double u, int n) {
  return std::clamp(static_cast<int>(u * n), 0, n - 1);
}

struct Caster {
  const Scene& scene;
  const std::vector<Emitter>& emitters;
  const Paint& paint;
  int nu, nv, rays;

  int patch_of(const SurfacePoint& p) const { return (p.surface * nv + cell_of(p.v, nv)) * nu + cell_of(p.u, nu); }

  // Points of a patch that has a chart, each standing for an area.
  std::vector<std::pair<SurfacePoint, double>> points(int surface, int iu, int iv, Random& random) const {
    const int side = std::max(2, static_cast<int>(std::lround(std::sqrt(rays))));
    std::vector<std::pair<SurfacePoint, double>> all;
    for (int k = 0; k < side * side; ++k) {
      const double u = (iu + (k % side + random.uniform()) / side) / nu;
      const double v = (iv + (k / side + random.uniform()) / side) / nv;
      all.emplace_back(scene.point(surface, u, v),
                       scene.shape(surface).area_element(u, v) / (static_cast<double>(nu) * nv * side * side));
    }
    return all;
  }

  // Points of a whole mesh, by area, sorted into its patches.
  std::vector<std::vector<std::pair<SurfacePoint, double>>> mesh_points(int surface, Random& random) const {
    const auto& mesh = static_cast<const MeshShape&>(scene.shape(surface));
    const auto& [corners, normals, faces] = mesh.triangles();
    std::vector<double> areas;
    for (const Eigen::Vector3i& f : faces)
      areas.push_back((corners[f[1]] - corners[f[0]]).cross(corners[f[2]] - corners[f[0]]).norm() / 2);
    const double total = std::accumulate(areas.begin(), areas.end(), 0.0);
    const double wanted = static_cast<double>(rays) * nu * nv;
    std::vector<std::vector<std::pair<SurfacePoint, double>>> sorted(static_cast<std::size_t>(nu) * nv);
    for (std::size_t f = 0; f < faces.size(); ++f) {
      const int count = static_cast<int>(std::ceil(wanted * areas[f] / total));
      for (int k = 0; k < count; ++k) {
        double s = random.uniform(), t = random.uniform();
        if (s + t > 1) s = 1 - s, t = 1 - t;
        SurfacePoint p = mesh.at(static_cast<int>(f), s, t);
        p.surface = surface;
        sorted[cell_of(p.v, nv) * nu + cell_of(p.u, nu)].emplace_back(p, areas[f] / count);
      }
    }
    return sorted;
  }

  void fill(PatchTruth& out, int patch, const std::vector<std::pair<SurfacePoint, double>>& points,
            Random& random) const {
    if (points.empty()) return;
    const double n = static_cast<double>(points.size());
    double area = 0;
    for (const auto& [p, a] : points) area += a;
    out.area[patch] = area;
    Eigen::VectorXd squares = Eigen::VectorXd::Zero(out.area.size());
    Eigen::VectorXd lit = Eigen::VectorXd::Zero(out.irradiance.cols()), lit2 = lit;
    for (const auto& [p, a] : points) {
      const double weight = a / area;  // about 1 / n
      const double x = random.uniform(), y = random.uniform();
      const SceneHit hit = scene.hit(p, cosine_direction(p.normal, p.along_u, x, y));
      if (hit.at.surface >= 0 && hit.front) {
        const int to = patch_of(hit.at);
        out.form_factor(patch, to) += static_cast<float>(weight);
        squares[to] += weight * weight * n;
      }
      for (int c = 0; c < 3; ++c) out.albedo(patch, c) += weight * paint.base()[p.surface][c] * paint.texture(p);
      for (std::size_t q = 0; q < emitters.size(); ++q)
        if (const auto beam = emitters[q].beam(scene, p)) {
          lit[q] += weight * beam->irradiance;
          lit2[q] += weight * beam->irradiance * beam->irradiance;
        }
    }
    for (int j = 0; j < squares.size(); ++j) {
      const double f = out.form_factor(patch, j);
      // Where no ray or every ray met j, one ray's worth is not known.
      out.form_factor_sigma(patch, j) =
          static_cast<float>(std::max(std::sqrt(std::max(0.0, squares[j] - f * f) / n), 1 / n));
    }
    for (int q = 0; q < lit.size(); ++q) {
      out.irradiance(patch, q) = lit[q];
      out.irradiance_sigma(patch, q) = std::sqrt(std::max(0.0, lit2[q] - lit[q] * lit[q]) / n);
    }
  }
};

}  // namespace

PatchTruth Simulator::patch_truth(int nu, int nv, int rays, Progress& progress) const {
  CS_CHECK(nu >= 1 && nv >= 1 && rays >= 100, "patches and at least 100 rays each");
  const State& state = *state_;
  const Caster caster{*state.scene, state.emitters, state.paint, nu, nv, rays};
  const int surfaces = state.scene->size(), each = nu * nv, n = surfaces * each;
  PatchTruth out;
  out.nu = nu, out.nv = nv;
  out.area = Eigen::VectorXd::Zero(n);
  out.form_factor = out.form_factor_sigma = Eigen::MatrixXf::Zero(n, n);
  out.albedo = Eigen::MatrixXd::Zero(n, 3);
  out.irradiance = out.irradiance_sigma = Eigen::MatrixXd::Zero(n, static_cast<int>(state.emitters.size()));
  const std::uint64_t seed = mix(state.simulation.seed ^ hash_name("patch truth"));
  for (int s = 0; s < surfaces; ++s) {
    progress.step("form factors by rays", s, surfaces);
    std::vector<std::vector<std::pair<SurfacePoint, double>>> on_mesh;
    Random mesh_random(mix(seed ^ static_cast<std::uint64_t>(s)));
    if (state.scene->shape(s).form() == Shape::Form::kMesh) on_mesh = caster.mesh_points(s, mesh_random);
    parallel_for(each, [&](int k) {
      Random random(mix(seed ^ (static_cast<std::uint64_t>(s * each + k) << 20)));
      caster.fill(out, s * each + k, on_mesh.empty() ? caster.points(s, k % nu, k / nu, random) : on_mesh[k], random);
    });
  }
  progress.step("form factors by rays", surfaces, surfaces);
  for (int c = 0; c < 3; ++c) {
    Eigen::MatrixXd system = Eigen::MatrixXd::Identity(n, n);
    system.noalias() -= out.albedo.col(c).asDiagonal() * out.form_factor.cast<double>();
    out.transport.push_back(system.partialPivLu().inverse().cast<float>());
  }
  return out;
}

}  // namespace countershade::simdata
