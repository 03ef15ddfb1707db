// A calibrated lens as one self-contained page: table of models, coverage, uncertainty, residuals, cross-validation.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "solver/fit/lens/ladder.h"
#include "solver/fit/lens/uncertainty.h"
#include "solver/fit/lens/views.h"

namespace countershade::tools {

// What became of one photo.
struct LensPhoto {
  std::string name;
  bool found = false;
  std::string reason;     // why not
  int seen = 0;           // points
  double rms_px = 0;      // residual of a coordinate, where the view was used
  int view = -1;          // index into the views; -1 = not used
  std::string thumbnail;  // PNG
};

// Sigma of a pixel (worst direction) over a grid of the picture [px].
struct SigmaMap {
  int columns = 0, rows = 0;
  std::vector<double> value;
  double centre = 0, worst = 0;
};

// Two halves of the views, fitted apart.
struct HalvesCheck {
  SigmaMap map;                             // length of the difference where points lie; NaN elsewhere
  double rms_px = 0, predicted_rms_px = 0;  // of a coordinate, where points lie
};

struct LensReport {
  Board board;
  bool board_recognised = false;  // it was not stated: its square is not known
  std::vector<LensPhoto> photos;
  solver::BoardViews data;
  solver::LensChoice choice;
  solver::ViewSummary views;
  double distance_m = 0;  // median of the boards'
  double focal_sigma = 0;
  SigmaMap near, far;  // of points at that distance, of directions
  std::optional<HalvesCheck> halves;
  std::vector<std::string> notes, warnings;

  const solver::LensFit& fit() const { return choice.rung().fit; }
};

// Rows of the ladder: model, parameters, residual, held-out error, excess over the best, BIC, F-test, verdict.
std::vector<std::string> ladder_columns();
std::vector<std::vector<std::string>> ladder_rows(const solver::LensChoice& choice);

std::string coverage_svg(const LensReport& report);
std::string residuals_svg(const LensReport& report);  // amplified, with the factor
// A value per cell of the picture, and its scale.
std::string map_svg(const SigmaMap& map, int width, int height);

std::string lens_html(const LensReport& report);
// Photos without a board, with thumbnails and reasons, under `why` nothing was fitted.
std::string refused_html(const std::vector<LensPhoto>& photos, const std::string& why);

}  // namespace countershade::tools
