// Form factors of whole screens.
#include "calib/base/check.h"
#include "calib/base/parallel.h"
#include "solver/transport/form_factor.h"
#include "solver/transport/patch_flow.h"

namespace countershade::solver {

namespace {

std::vector<std::array<Eigen::Vector3d, 4>> all_corners(const Screen& screen, const Patches& patches) {
  std::vector<std::array<Eigen::Vector3d, 4>> corners(patches.size());
  for (int s = 0; s < screen.size(); ++s)
    CS_CHECK(dynamic_cast<const PlaneSurface*>(screen.surfaces[s].get()), "form factors of planes only");
  for (int i = 0; i < patches.size(); ++i) corners[i] = patch_corners(screen, patches, i);
  return corners;
}

// Relative error to aim at for entries that are stored as floats.
constexpr double kMatrixTolerance = 1e-8;

}  // namespace

Eigen::MatrixXf form_factors(const Screen& screen, const Patches& patches, FormFactorMethod method, Progress& progress) {
  const auto corners = all_corners(screen, patches);
  const Eigen::VectorXd areas = patch_areas(screen, patches);
  Eigen::MatrixXf F = Eigen::MatrixXf::Zero(patches.size(), patches.size());
  progress.step("form factors", 0, 1);
  parallel_for(patches.size(), [&](int i) {
    const int s = patches.surface_of(i);
    for (int t = s + 1; t < patches.surfaces(); ++t)
      for (int j = patches.offset(t); j < patches.offset(t) + patches.count(t); ++j) {
        const double exchange = method == FormFactorMethod::kExact ? patch_flow(corners[i], corners[j], kMatrixTolerance) : areas[i] * centre_form_factor(corners[i], corners[j]);
        F(i, j) = static_cast<float>(exchange / areas[i]);
        F(j, i) = static_cast<float>(exchange / areas[j]);
      }
  });
  progress.step("form factors", 1, 1);
  return F;
}

Eigen::MatrixXf receiver_form_factors(const Screen& screen, const Patches& patches, const std::vector<ChartPoint>& receivers, Progress& progress) {
  const auto corners = all_corners(screen, patches);
  Eigen::MatrixXf G = Eigen::MatrixXf::Zero(receivers.size(), patches.size());
  progress.step("receivers", 0, 1);
  // Column by column, as the matrix is stored.
  parallel_for(patches.size(), [&](int j) {
    const int t = patches.surface_of(j);
    for (std::size_t r = 0; r < receivers.size(); ++r)
      if (receivers[r].surface != t) G(r, j) = static_cast<float>(point_form_factor(screen.point(receivers[r]), screen.normal(receivers[r]), corners[j]));
  });
  progress.step("receivers", 1, 1);
  return G;
}

}  // namespace countershade::solver
