// How well a fitted lens is known: the noise of the seen points, carried through the fit to the pixel where a point
// lands.
//
// The fit makes small J b of its residuals; with noise sigma in each seen coordinate its state has the covariance
//   Var(b) = sigma^2 N^-1 N_board N^-1,   N = J^T J,   N_board = J_board^T J_board
// (N holds the regularisation too, which is no observation). A lens alone has no frame to compare in: rotating the
// camera and all boards together changes nothing. So a point is held by the boards, x_f = T_f^-1 x for each board pose
// T_f, and seen again where the mean of T_f x_f lands; for its pixel q
//   dq = (dq/dlens) dlens + (dq/dx) mean_f (d(T_f x_f)/dT_f) dT_f
// and Var(q) = (dq/db) Var(b) (dq/db)^T. Kogan, "Projection uncertainty", mrcal.secretsauce.net/uncertainty.html ("mean
// frames"); mrcal computes it in Python only.
#pragma once

#include <limits>

#include "solver/fit/lens/lens_fit.h"

namespace countershade::solver {

class LensUncertainty {
 public:
  // fit: an optimum of fit_lens on these views; noise: its sigma_px.
  LensUncertainty(const BoardViews& data, const LensFit& fit);

  static constexpr double kInfinity = std::numeric_limits<double>::infinity();
  // Covariance of the pixel where a point appears that is seen at q from `distance` (m; kInfinity: only directions
  // count) [px^2].
  Eigen::Matrix2d covariance(const Eigen::Vector2d& q_px, double distance) const;
  // The same of a point in camera coordinates, or of its direction.
  Eigen::Matrix2d covariance_of_point(const Eigen::Vector3d& x_in_camera, bool at_infinity) const;
  // The derivative of that pixel by the state, in mrcal's order (lens, then poses), (2, states).
  Eigen::Matrix<double, 2, Eigen::Dynamic> derivative(const Eigen::Vector3d& x_in_camera, bool at_infinity) const;
  const Eigen::MatrixXd& state_covariance() const { return covariance_; }  // of the state, full units
  // Standard deviation of the mean focal length over it. For splined models of the core, which they do not move: 0.
  double focal_sigma() const;

  const LensFit& fit() const { return fit_; }
  int lens_states() const { return lens_states_; }
  int first_intrinsic() const { return first_intrinsic_; }  // of the lens that is part of the state

 private:
  LensFit fit_;
  Eigen::MatrixXd covariance_;
  int lens_at_ = 0, lens_states_ = 0, first_intrinsic_ = 0, poses_at_ = 0;
};

// Worst direction's standard deviation of a covariance.
double worst_sigma(const Eigen::Matrix2d& covariance);

// Two lenses as one: where b puts the directions that a sees at q, after the rotation between them that fits best
// (a camera may be turned in its mount), minus q [px]; NaN where a pixel has no direction.
std::vector<Eigen::Vector2d> lens_difference(const Lens& a, const Lens& b, const std::vector<Eigen::Vector2d>& q_px);
// Its root mean square per coordinate, as two independent fits of a's model with these uncertainties predict it.
double predicted_difference_rms(const LensUncertainty& a, const LensUncertainty& b,
                                const std::vector<Eigen::Vector2d>& q_px);
// A grid of columns x rows pixels over a picture, its border included, row by row.
std::vector<Eigen::Vector2d> pixel_grid(int width, int height, int columns, int rows);

}  // namespace countershade::solver
