// Which lens model: no more than the views need (PHYSICS 9).
#pragma once

#include <string>
#include <vector>

#include "calib/base/progress.h"
#include "solver/fit/lens/lens_fit.h"

namespace countershade::solver {

struct LensRung {
  std::string model;
  int parameters = 0;
  bool fitted = false;
  std::string note;  // why not
  LensFit fit;
  double held_out_px = 0;               // rms of a coordinate in views, and at points, that the fit has not seen
  double excess = 0, excess_sigma = 0;  // mean squared held-out error above the best rung's, view by view, and its
                                        // standard error [px^2]
  double bic = 0;
  double f_p = 1;       // chance that the rung from which this one was judged leaves this much more by noise alone
  std::string verdict;  // climbed to or not, and why
};

struct LensChoice {
  std::vector<LensRung> rungs;  // LENSMODEL_PINHOLE, OPENCV4, OPENCV5, OPENCV8, SPLINED_STEREOGRAPHIC
  int chosen = -1;
  std::string reason;
  std::vector<std::string> notes;

  const LensRung& rung() const { return rungs[chosen]; }
};

struct LadderOptions {
  int folds = 6;  // at most; views that are alike stay together
  int spline_columns = 9;
  bool splined = true;
};

// Fits every rung to all views, and to all but each fold; the poses of a held-out view come from every second of its
// points, its error from the others. From the simplest rung on, a richer one is climbed to only if both agree: the
// held-out error falls, view by view, by more than one standard error; and so does the noise cost, by the F-test at 1 %
// between nested rungs, by the BIC for splines. Outliers are found once, with the richest rung that fits, and stay out
// of all: a model that is too poor would throw out what it cannot describe. group: a number per view; views that are
// nearly the same share it. Errors: kRefused.
Result<LensChoice> choose_lens(const BoardViews& data, const std::vector<int>& group, const LadderOptions& options,
                               Progress& progress);

// Mean squared residual of a coordinate in one view of a lens that has not seen it: poses from every second point,
// error at the others, both ways. NaN where no pose is found. used: which points count.
double held_out_square(const BoardViews& data, const BoardView& view, const Lens& lens, const std::vector<bool>& used);

// Chance that a quotient of two variances with these degrees of freedom is above F.
double f_test_p(double F, double freedom_above, double freedom_below);

}  // namespace countershade::solver
