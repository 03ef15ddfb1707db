// A lens from photos of a board: mrcal's optimiser finds the lens and where the board stood in each photo.
#pragma once

#include <Eigen/Dense>
#include <optional>
#include <string>
#include <vector>

#include "calib/base/result.h"
#include "calib/geometry/board.h"
#include "calib/geometry/lens.h"

namespace countershade::solver {

// Where one photo shows the points of the board: one per point, NaN where it was not seen [px].
using BoardView = std::vector<Eigen::Vector2d>;

struct BoardViews {
  Board board;
  int width = 0, height = 0;  // of all photos
  std::vector<BoardView> views;
};

struct LensFit {
  Lens lens = Lens::pinhole(1, 0, 0, 1, 1);
  std::vector<Pose> camera_from_board;  // per view
  std::vector<std::vector<bool>> used;  // per view and point: seen and no outlier
  std::vector<BoardView> residual_px;   // per view and point: model - seen; NaN where not used
  int observations = 0;                 // coordinates used, two a point
  int outliers = 0;                     // points
  double freedom = 0;                   // observations - what the fit has adapted to
  double squares = 0;                   // sum of squared residuals [px^2]
  double rms_px = 0;                    // of a coordinate
  // Standard deviation of a seen coordinate, from what the fit leaves [px]: sqrt(squares / freedom). Includes what the
  // model cannot describe, as if it were noise.
  double sigma_px = 0;
};

struct LensFitOptions {
  std::string model = "LENSMODEL_OPENCV5";  // mrcal's name; splined_model() makes one
  const LensFit* start = nullptr;           // of the same views; its outliers stay out
  bool find_outliers = false;               // beyond 4.5 sigma; mrcal's own rejection would print
};

// Minimises the squared reprojection error over lens and poses, from a start of its own (the focal length with which
// planar poses fit best, Collins & Bartoli 2014) or the given one. Errors: kRefused where no start or no optimum is
// found, with the reason.
Result<LensFit> fit_lens(const BoardViews& data, const LensFitOptions& options);

// The board's pose in one view of a known lens, from the points with use[i] (all that are seen where empty); nothing
// where fewer than four are seen or the pose is not found.
std::optional<Pose> fit_pose(const BoardViews& data, const BoardView& view, const Lens& lens,
                             const std::vector<bool>& use);

// Cubic spline (LENSMODEL_SPLINED_STEREOGRAPHIC) with `columns` control points along the picture's width, for a field
// of view as this lens has it.
std::string splined_model(const Lens& lens, int columns);

// Some of the views, in that order.
BoardViews subset(const BoardViews& data, const std::vector<int>& views);
LensFit subset(const LensFit& fit, const std::vector<int>& views);

}  // namespace countershade::solver
