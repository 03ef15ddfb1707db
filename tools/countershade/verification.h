// Verification: photographs the plain show, the compensated show and the target, and reports how far apart they are.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "tools/countershade/calibration.h"
#include "tools/countershade/photographs.h"
#include "tools/countershade/show.h"
#include "tools/report/html.h"

namespace countershade::tools {

// Which camera pixels count, and how.
struct VerifyMasks {
  Mask lit;       // sees a surface that a projector lights, or is directly lit in the target
  Mask edge;      // within a sixth of the mean chart width of a crease
  Mask modelled;  // the model knows a direct gain there
  std::string edge_text;
};
VerifyMasks verify_masks(const Calibration& calibration, const solver::PixelGeometry& pixels, const Image& target);

struct Verification {
  VerifyNumbers numbers;
  Verdict verdict;
};

// Measures and writes the report; `show` is what was shown (null: photos from elsewhere). `extra` are more tables.
Result<Verification> report_verification(const Calibration& calibration,
                                         const std::filesystem::path& calibration_folder,
                                         const solver::PixelGeometry& pixels, const Photographs& photos,
                                         const Show* show, std::vector<Table> extra, const std::filesystem::path& out);

}  // namespace countershade::tools
