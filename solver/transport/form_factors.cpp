// Form factors of whole screens.
#include <algorithm>

#include "calib/base/check.h"
#include "calib/base/parallel.h"
#include "solver/transport/form_factor.h"
#include "solver/transport/patch_flow.h"

namespace countershade::solver {

namespace {

using Quad = std::array<Eigen::Vector3d, 4>;

// Relative error to aim at for entries that are stored as floats.
constexpr double kMatrixTolerance = 1e-8;

std::vector<Quad> all_corners(const Screen& screen, const Patches& patches) {
  CS_CHECK(patches.surfaces() == screen.size(), "the patches belong to another screen");
  for (const auto& surface : screen.surfaces)
    CS_CHECK(dynamic_cast<const PlaneSurface*>(surface.get()), "form factors of planes only");
  std::vector<Quad> corners(patches.size());
  for (int i = 0; i < patches.size(); ++i) corners[i] = patch_corners(screen, patches, i);
  return corners;
}

// body(i) for all i in [0, count), from several threads, in as many bands as `progress` hears of.
void parallel_bands(int count, std::string_view stage, Progress& progress, const std::function<void(int)>& body) {
  constexpr int kBands = 16;
  const int band = std::max(1, (count + kBands - 1) / kBands);
  progress.step(stage, 0, count);
  for (int first = 0; first < count; first += band) {
    const int rows = std::min(band, count - first);
    parallel_for(rows, [&](int i) { body(first + i); });
    progress.step(stage, first + rows, count);
  }
}

}  // namespace

Eigen::MatrixXf form_factors(const Screen& screen, const Patches& patches, FormFactorMethod method,
                             Progress& progress) {
  const std::vector<Quad> corners = all_corners(screen, patches);
  const Eigen::VectorXd areas = patch_areas(screen, patches);
  Eigen::MatrixXf F = Eigen::MatrixXf::Zero(patches.size(), patches.size());
  // Both directions from one exchange, so that reciprocity is exact before rounding to floats.
  parallel_bands(patches.size(), "form factors", progress, [&](int i) {
    const int s = patches.surface_of(i);
    for (int j = patches.offset(s) + patches.count(s); j < patches.size(); ++j) {
      const double exchange = method == FormFactorMethod::kExact
                                  ? patch_flow(corners[i], corners[j], kMatrixTolerance)
                                  : areas[i] * centre_form_factor(corners[i], corners[j]);
      F(i, j) = static_cast<float>(exchange / areas[i]);
      F(j, i) = static_cast<float>(exchange / areas[j]);
    }
  });
  return F;
}

Eigen::MatrixXf receiver_form_factors(const Screen& screen, const Patches& patches,
                                      const std::vector<ChartPoint>& receivers, Progress& progress) {
  const std::vector<Quad> corners = all_corners(screen, patches);
  for (const ChartPoint& r : receivers)
    CS_CHECK(r.surface >= 0 && r.surface < screen.size(), "a receiver on no surface");
  const int count = static_cast<int>(receivers.size());
  Eigen::MatrixXf G = Eigen::MatrixXf::Zero(count, patches.size());
  // Column by column, as the matrix is stored.
  parallel_bands(patches.size(), "receivers", progress, [&](int j) {
    const int surface = patches.surface_of(j);
    for (int r = 0; r < count; ++r)
      if (receivers[r].surface != surface)
        G(r, j) =
            static_cast<float>(point_form_factor(screen.point(receivers[r]), screen.normal(receivers[r]), corners[j]));
  });
  return G;
}

}  // namespace countershade::solver
