// Are the views of a board enough for a lens, and which one is missing.
#pragma once

#include <string>
#include <vector>

#include "solver/fit/lens/lens_fit.h"
#include "solver/fit/lens/uncertainty.h"

namespace countershade::solver {

// A view has 8 numbers that do not depend on how far a plane is described (a homography); its pose takes 6. What is
// left, 2 a view, must hold focal lengths and principal point (4) with something over for distortion and for holding a
// view out.
inline constexpr int kLeastViews = 4;
// A focal length that is less certain than this is no calibration [relative].
inline constexpr double kWorstFocalSigma = 0.01;

// A number per view: views that differ by less than 1 % of the picture's diagonal (rms over the points that both show)
// share it. Copies and bursts from a tripod are one view, not many.
std::vector<int> group_alike(const BoardViews& data);

struct ViewSummary {
  std::vector<double> tilt_deg;     // per view, between the board's normal and the line of sight
  std::vector<double> distance_m;   // per view, to the middle of the board
  double covered = 0;               // share of 8 x 6 cells of the picture that have a point
  std::vector<std::string> advice;  // views to add, the most useful first; empty = none is missing
};
ViewSummary summarise(const BoardViews& data, const LensFit& fit);

// Errors: kRefused. Before a fit: fewer than kLeastViews views that differ, with what was found. After it: the focal
// length is not held, with the view to add.
Result<void> check_enough(const std::vector<int>& group);
Result<void> check_held(const LensUncertainty& uncertainty, const ViewSummary& views);

}  // namespace countershade::solver
