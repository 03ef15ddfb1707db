#include <ceres/ceres.h>
#include <ceres/rotation.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>

#include "calib/base/check.h"
#include "solver/fit/geometry_parts.h"

namespace countershade::solver::parts {

namespace {

// intrinsics: focal, cx, cy; pose: Rodrigues vector and translation of projector_from_camera; plane: w with w . x = 1.
struct Reprojection {
  Eigen::Vector2d ray, q;
  double inverse_sigma;

  template <class T>
  bool operator()(const T* intrinsics, const T* pose, const T* plane, T* residual) const {
    const T inverse_depth = plane[0] * ray.x() + plane[1] * ray.y() + plane[2];
    const T x[3] = {T(ray.x()) / inverse_depth, T(ray.y()) / inverse_depth, T(1) / inverse_depth};
    T p[3];
    ceres::AngleAxisRotatePoint(pose, x, p);
    for (int i = 0; i < 3; ++i) p[i] += pose[3 + i];
    residual[0] = (intrinsics[0] * p[0] / p[2] + intrinsics[1] - q.x()) * inverse_sigma;
    residual[1] = (intrinsics[0] * p[1] / p[2] + intrinsics[2] - q.y()) * inverse_sigma;
    return true;
  }
};

// What rig.toml says of the lens. The principal column always has a prior: without one the dihedral angles would drift
// along a direction that reprojection does not see (PHYSICS 6).
struct IntrinsicPrior {
  Eigen::Vector3d mean, inverse_sigma;

  template <class T>
  bool operator()(const T* intrinsics, T* residual) const {
    residual[0] = ceres::log(intrinsics[0] / mean[0]) * inverse_sigma[0];
    residual[1] = (intrinsics[1] - mean[1]) * inverse_sigma[1];
    residual[2] = (intrinsics[2] - mean[2]) * inverse_sigma[2];
    return true;
  }
};

IntrinsicPrior prior_of(const ProjectorSpec& spec, double focal) {
  const double width = spec.resolution[0], height = spec.resolution[1];
  const std::array<double, 2> shift = spec.lens_shift.value_or(std::array<double, 2>{0, 0});
  IntrinsicPrior prior;
  prior.mean = {spec.throw_ratio ? *spec.throw_ratio * width : focal, (width - 1) / 2 - shift[0] * width,
                (height - 1) / 2 - shift[1] * height};
  prior.inverse_sigma = {spec.throw_ratio ? 1 / spec.throw_ratio_sigma : 0, 1 / (spec.lens_shift_sigma * width),
                         spec.lens_shift ? 1 / (spec.lens_shift_sigma * height) : 0};
  return prior;
}

using Intrinsics = std::array<double, 3>;
using PoseBlock = std::array<double, 6>;

struct Blocks {
  std::vector<Intrinsics> intrinsics;
  std::vector<PoseBlock> poses;
  std::vector<std::array<double, 3>> planes;
};

Blocks pack(const Bundle& bundle) {
  Blocks blocks;
  for (const Bundle::Projector& p : bundle.projectors) {
    blocks.intrinsics.push_back({p.focal, p.cx, p.cy});
    const Eigen::Vector3d r = vector_from_rotation(p.projector_from_camera.rotation);
    const Eigen::Vector3d& t = p.projector_from_camera.translation;
    blocks.poses.push_back({r[0], r[1], r[2], t[0], t[1], t[2]});
  }
  for (const Eigen::Vector3d& w : bundle.planes) blocks.planes.push_back({w[0], w[1], w[2]});
  return blocks;
}

void unpack(const Blocks& blocks, Bundle& bundle) {
  for (std::size_t i = 0; i < blocks.intrinsics.size(); ++i) {
    const Intrinsics& k = blocks.intrinsics[i];
    const PoseBlock& p = blocks.poses[i];
    bundle.projectors[i] = {k[0], k[1], k[2], {rotation_from_vector({p[0], p[1], p[2]}), {p[3], p[4], p[5]}}};
  }
  for (std::size_t i = 0; i < blocks.planes.size(); ++i)
    bundle.planes[i] = {blocks.planes[i][0], blocks.planes[i][1], blocks.planes[i][2]};
}

std::vector<double> residual_rms(const std::vector<Matches>& matches, const Blocks& blocks) {
  std::vector<double> rms;
  for (std::size_t q = 0; q < matches.size(); ++q) {
    std::vector<double> squares;
    for (const Match& m : matches[q]) {
      if (m.plane < 0) continue;
      double r[2];
      Reprojection{m.ray, m.q, 1.0}(blocks.intrinsics[q].data(), blocks.poses[q].data(), blocks.planes[m.plane].data(),
                                    r);
      squares.push_back(r[0] * r[0] + r[1] * r[1]);
    }
    std::sort(squares.begin(), squares.end());
    const std::size_t kept = squares.size() * 98 / 100;  // the worst 2 % are what the robust loss ignores
    double sum = 0;
    for (std::size_t i = 0; i < kept; ++i) sum += squares[i];
    rms.push_back(kept ? std::sqrt(sum / kept) : 0);
  }
  return rms;
}

void add_covariance(ceres::Problem& problem, Blocks& blocks, BundleResult& result) {
  ceres::Covariance::Options options;
  options.algorithm_type = ceres::DENSE_SVD;
  options.null_space_rank = -1;  // a degenerate direction must not hide the others
  ceres::Covariance covariance(options);
  std::vector<std::pair<const double*, const double*>> wanted;
  for (std::size_t i = 0; i < blocks.intrinsics.size(); ++i) {
    wanted.emplace_back(blocks.intrinsics[i].data(), blocks.intrinsics[i].data());
    wanted.emplace_back(blocks.poses[i].data(), blocks.poses[i].data());
  }
  for (auto& a : blocks.planes)
    for (auto& b : blocks.planes) wanted.emplace_back(a.data(), b.data());
  if (!covariance.Compute(wanted, &problem)) return;
  for (std::size_t i = 0; i < blocks.intrinsics.size(); ++i) {
    Eigen::Matrix<double, 3, 3, Eigen::RowMajor> k;
    Eigen::Matrix<double, 6, 6, Eigen::RowMajor> p;
    covariance.GetCovarianceBlock(blocks.intrinsics[i].data(), blocks.intrinsics[i].data(), k.data());
    covariance.GetCovarianceBlock(blocks.poses[i].data(), blocks.poses[i].data(), p.data());
    const Eigen::Vector3d t(blocks.poses[i][3], blocks.poses[i][4], blocks.poses[i][5]);
    const double distance = std::sqrt(t.transpose() * p.bottomRightCorner<3, 3>() * t) / t.squaredNorm();
    result.sigma.emplace_back(std::sqrt(k(0, 0)), std::sqrt(k(1, 1)), std::sqrt(k(2, 2)), distance);
  }
  const int n = static_cast<int>(blocks.planes.size());
  result.plane_covariance.resize(3 * n, 3 * n);
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < n; ++j) {
      Eigen::Matrix<double, 3, 3, Eigen::RowMajor> c;
      covariance.GetCovarianceBlock(blocks.planes[i].data(), blocks.planes[j].data(), c.data());
      result.plane_covariance.block<3, 3>(3 * i, 3 * j) = c;
    }
}

}  // namespace

BundleResult adjust(const std::vector<Matches>& matches, const std::vector<ProjectorSpec>& specs,
                    const Adjustment& adjustment, Bundle& bundle) {
  const auto gauge =
      std::find_if(bundle.planes.begin(), bundle.planes.end(), [](const auto& w) { return w.norm() > 0; });
  CS_CHECK(gauge != bundle.planes.end(), "a bundle without planes");
  for (const Matches& of_projector : matches)
    for (const Match& m : of_projector)
      if (m.plane >= 0 && bundle.planes[m.plane].isZero(0)) {  // a plane that no start has placed: nothing to adjust
        BundleResult none;
        none.cost = HUGE_VAL, none.rms_px.assign(matches.size(), HUGE_VAL);
        return none;
      }
  const double scale = gauge->norm();
  for (Eigen::Vector3d& w : bundle.planes) w /= scale;
  for (auto& p : bundle.projectors) p.projector_from_camera.translation *= scale;
  Blocks blocks = pack(bundle);
  ceres::Problem problem;
  // Some plane or projector may have lost all its matches; its blocks exist all the same.
  for (auto& plane : blocks.planes) problem.AddParameterBlock(plane.data(), 3);
  for (auto& pose : blocks.poses) problem.AddParameterBlock(pose.data(), 6);
  for (std::size_t q = 0; q < matches.size(); ++q) {
    for (const Match& m : matches[q]) {
      if (m.plane < 0) continue;
      auto* cost = new ceres::AutoDiffCostFunction<Reprojection, 2, 3, 6, 3>(new Reprojection{m.ray, m.q, 1 / m.sigma});
      problem.AddResidualBlock(cost, adjustment.robust ? new ceres::CauchyLoss(3.0) : nullptr,
                               blocks.intrinsics[q].data(), blocks.poses[q].data(), blocks.planes[m.plane].data());
    }
    problem.AddResidualBlock(new ceres::AutoDiffCostFunction<IntrinsicPrior, 3, 3>(
                                 new IntrinsicPrior(prior_of(specs[q], bundle.projectors[q].focal))),
                             nullptr, blocks.intrinsics[q].data());
    problem.SetParameterLowerBound(blocks.intrinsics[q].data(), 0, 0.05 * specs[q].resolution[0]);
  }
  if (adjustment.hold_columns)
    for (auto& intrinsics : blocks.intrinsics)
      problem.SetManifold(intrinsics.data(), new ceres::SubsetManifold(3, {1}));
  problem.SetManifold(blocks.planes[gauge - bundle.planes.begin()].data(), new ceres::SphereManifold<3>());
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_NORMAL_CHOLESKY;
  options.max_num_iterations = 60;
  options.function_tolerance = 1e-9;
  options.num_threads = 1;  // sums in one order: equal inputs give equal bytes
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  BundleResult result;
  result.cost = std::isfinite(summary.final_cost) && summary.IsSolutionUsable() ? summary.final_cost : HUGE_VAL;
  result.rms_px = residual_rms(matches, blocks);
  if (adjustment.covariance) add_covariance(problem, blocks, result);
  unpack(blocks, bundle);
  return result;
}

}  // namespace countershade::solver::parts
