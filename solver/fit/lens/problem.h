// mrcal's optimisation problem for one camera that sees one board, in plain arrays; inside the fit only.
#pragma once

#include <Eigen/Dense>
#include <array>
#include <string>
#include <vector>

namespace countershade::solver::lens_parts {

struct Problem {
  std::string model;
  std::vector<double> intrinsics;
  std::vector<std::array<double, 6>> poses;         // per view, camera_from_board: Rodrigues vector, translation
  std::vector<std::array<double, 3>> observations;  // (views, rows, columns): q [px] and a weight; < 0 = not used
  int columns = 0, rows = 0, width = 0, height = 0;
  double spacing = 0;
  bool lens_moves = true;  // false: only the poses are found
  bool core_moves = true;  // focal lengths and principal point; never for splined models, whose spline holds them
  // mrcal's regularisation (Kogan, mrcal.secretsauce.net/formulation.html), for what points do not hold. Its weight
  // supposes errors of a pixel; against a fiftieth of a pixel it would bend a lens that points do hold.
  bool regularised = false;

  int views() const { return static_cast<int>(poses.size()); }
};

// Moves intrinsics and poses to the optimum. False where the solver does not end at finite numbers.
bool optimise(Problem& problem);

// The problem around its optimum, with the state scaled as mrcal scales it: b = scale * b_packed.
struct Linearisation {
  std::vector<double> x;       // residuals q_model - q_seen [px] of all points (0 where not used), then regularisation
  int board_measurements = 0;  // that belong to points
  int used = 0;                // of those, what is not an outlier
  Eigen::VectorXd scale;
  Eigen::MatrixXd N, N_board;  // J^T J of all measurements, and of the points alone
  int states = 0, lens_at = 0, lens_states = 0, first_intrinsic = 0, poses_at = 0;
};
Linearisation linearise(const Problem& problem);

// Number of parameters of a lens model; a Bug for a name that mrcal does not know.
int parameters(const std::string& model);

// Pixel of x_in_camera and its derivatives by the point (2, 3) and by all intrinsics (2, n), by mrcal.
struct Projection {
  Eigen::Vector2d q;
  Eigen::Matrix<double, 2, 3> by_point;
  Eigen::Matrix<double, 2, Eigen::Dynamic> by_intrinsics;
};
Projection project(const std::string& model, const std::vector<double>& intrinsics, const Eigen::Vector3d& x_in_camera);

// x' = R(r) x + t and its derivative by (r, t).
Eigen::Matrix<double, 3, 6> transform_derivative(const std::array<double, 6>& pose, const Eigen::Vector3d& x);

}  // namespace countershade::solver::lens_parts
