#include "solver/fit/lens/uncertainty.h"

#include <cmath>

#include "solver/fit/lens/lens_parts.h"

namespace countershade::solver {

LensUncertainty::LensUncertainty(const BoardViews& data, const LensFit& fit) : fit_(fit) {
  const lens_parts::Linearisation l = lens_parts::linearise(lens_parts::problem_of(data, fit));
  lens_at_ = l.lens_at, lens_states_ = l.lens_states, first_intrinsic_ = l.first_intrinsic, poses_at_ = l.poses_at;
  const Eigen::LDLT<Eigen::MatrixXd> N(l.N);
  const Eigen::MatrixXd half = N.solve(l.N_board);           // N^-1 N_board
  const Eigen::MatrixXd packed = N.solve(half.transpose());  // N^-1 (N^-1 N_board)^T
  covariance_ = fit.sigma_px * fit.sigma_px * l.scale.asDiagonal() * packed * l.scale.asDiagonal();
}

Eigen::Matrix<double, 2, Eigen::Dynamic> LensUncertainty::derivative(const Eigen::Vector3d& x, bool at_infinity) const {
  const lens_parts::Projection p = lens_parts::project(fit_.lens.model(), fit_.lens.intrinsics(), x);
  Eigen::Matrix<double, 2, Eigen::Dynamic> by_state = Eigen::MatrixXd::Zero(2, covariance_.rows());
  by_state.middleCols(lens_at_, lens_states_) = p.by_intrinsics.middleCols(first_intrinsic_, lens_states_);
  const int boards = static_cast<int>(fit_.camera_from_board.size());
  for (int f = 0; f < boards; ++f) {
    const Pose& pose = fit_.camera_from_board[f];
    const Eigen::Vector3d r = vector_from_rotation(pose.rotation);
    const Eigen::Vector3d t = at_infinity ? Eigen::Vector3d::Zero() : pose.translation;
    const Eigen::Vector3d on_board = pose.rotation.transpose() * (x - t);
    Eigen::Matrix<double, 3, 6> J =
        lens_parts::transform_derivative({r.x(), r.y(), r.z(), t.x(), t.y(), t.z()}, on_board);
    if (at_infinity) J.rightCols<3>().setZero();
    by_state.middleCols<6>(poses_at_ + 6 * f) = p.by_point * J / boards;
  }
  return by_state;
}

Eigen::Matrix2d LensUncertainty::covariance_of_point(const Eigen::Vector3d& x, bool at_infinity) const {
  const auto J = derivative(x, at_infinity);
  return J * covariance_ * J.transpose();
}

Eigen::Matrix2d LensUncertainty::covariance(const Eigen::Vector2d& q, double distance) const {
  const bool far = std::isinf(distance);
  return covariance_of_point(fit_.lens.unproject(q) * (far ? 1 : distance), far);
}

double LensUncertainty::focal_sigma() const {
  if (first_intrinsic_ != 0) return 0;
  Eigen::Vector2d mean(0.5, 0.5);
  const double variance = mean.dot(covariance_.block<2, 2>(lens_at_, lens_at_) * mean);
  if (!(variance >= 0)) return kInfinity;  // no optimum in that direction: rounding decides the sign
  return std::sqrt(variance) / ((fit_.lens.intrinsics()[0] + fit_.lens.intrinsics()[1]) / 2);
}

double worst_sigma(const Eigen::Matrix2d& covariance) {
  return std::sqrt(std::max(0.0, Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d>(covariance).eigenvalues()[1]));
}

std::vector<Eigen::Vector2d> lens_difference(const Lens& a, const Lens& b, const std::vector<Eigen::Vector2d>& q_px) {
  // Rotation b_from_a between bundles of rays: Kabsch 1976.
  Eigen::Matrix3d correlation = Eigen::Matrix3d::Zero();
  std::vector<Eigen::Vector3d> rays;
  for (const Eigen::Vector2d& q : q_px) {
    const Eigen::Vector3d in_a = a.unproject(q), in_b = b.unproject(q);
    rays.push_back(in_a);
    if (in_a.allFinite() && in_b.allFinite()) correlation += in_b * in_a.transpose();
  }
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(correlation, Eigen::ComputeFullU | Eigen::ComputeFullV);
  const double sign = (svd.matrixU() * svd.matrixV().transpose()).determinant();
  const Eigen::Matrix3d b_from_a = svd.matrixU() * Eigen::Vector3d(1, 1, sign).asDiagonal() * svd.matrixV().transpose();
  std::vector<Eigen::Vector2d> difference;
  for (std::size_t i = 0; i < q_px.size(); ++i) difference.push_back(b.project(b_from_a * rays[i]) - q_px[i]);
  return difference;
}

double predicted_difference_rms(const LensUncertainty& a, const LensUncertainty& b,
                                const std::vector<Eigen::Vector2d>& q_px) {
  const Lens& lens = a.fit().lens;
  const int n = static_cast<int>(q_px.size()), states = a.lens_states();
  Eigen::MatrixXd G(2 * n, states), B(2 * n, 3);  // pixels by lens, and by a rotation of the camera
  for (int i = 0; i < n; ++i) {
    const Eigen::Vector3d ray = lens.unproject(q_px[i]);
    const lens_parts::Projection p = lens_parts::project(lens.model(), lens.intrinsics(), ray);
    G.middleRows<2>(2 * i) = p.by_intrinsics.middleCols(a.first_intrinsic(), states);
    Eigen::Matrix3d cross;
    cross << 0, -ray.z(), ray.y(), ray.z(), 0, -ray.x(), -ray.y(), ray.x(), 0;
    B.middleRows<2>(2 * i) = -p.by_point * cross;
  }
  const Eigen::MatrixXd left =
      G - B * (B.transpose() * B).ldlt().solve(B.transpose() * G);                // what no rotation explains
  const Eigen::MatrixXd V = a.state_covariance().topLeftCorner(states, states) +  // the lens stands first in the state
                            b.state_covariance().topLeftCorner(states, states);
  return std::sqrt((left * V).cwiseProduct(left).sum() / (2 * n));
}

std::vector<Eigen::Vector2d> pixel_grid(int width, int height, int columns, int rows) {
  std::vector<Eigen::Vector2d> q;
  for (int j = 0; j < rows; ++j)
    for (int i = 0; i < columns; ++i)
      q.emplace_back(i * (width - 1.0) / (columns - 1), j * (height - 1.0) / (rows - 1));
  return q;
}

}  // namespace countershade::solver
