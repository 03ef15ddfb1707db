// From photos of a board to a camera model, with a page that says how good it is.
#pragma once

#include <filesystem>
#include <optional>
#include <vector>

#include "calib/base/progress.h"
#include "tools/report/lens_page.h"

namespace countershade::tools {

struct LensOptions {
  std::optional<Board> board;  // recognised in the photos where nobody says
  solver::LadderOptions ladder;
};

// Where the files of a model lie.
struct LensFiles {
  std::filesystem::path model;    // camera.cameramodel
  std::filesystem::path folder;   // camera.lens/: lens.html, lens.json, coverage.svg, residuals.svg,
                                  // uncertainty_near.svg, uncertainty_far.svg, halves.svg
  std::filesystem::path refused;  // camera.refused.html: photos without a board, where nothing was fitted
};
LensFiles lens_files(const std::filesystem::path& model);

// Detects, chooses and fits a model, checks it, and writes it. A former model and its folder are kept beside the new
// ones as camera.former.cameramodel, camera.former.lens/ (camera.former2... where these exist), and compared: a warning
// says when the former one fits these photos better. Errors: kBadValue, kBadFile; kRefused where the views do not hold
// a lens, with the view to add: `refused` is then written, nothing else is touched.
Result<LensReport> calibrate_lens(const std::vector<std::filesystem::path>& inputs, const std::filesystem::path& model,
                                  const LensOptions& options, Progress& progress);

// lens.json.
std::string lens_json(const LensReport& report);

}  // namespace countershade::tools
