// Verification: photographs the plain show, the compensated show and the target, and reports how far apart they are.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "tools/job/calibration.h"
#include "tools/job/photographs.h"
#include "tools/job/show.h"
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

// What the report says beside the photos.
struct ReportContext {
  std::string subtitle;
  std::vector<std::pair<std::string, std::string>> options;  // effective ones
  std::vector<Table> tables;
  std::optional<double> capture_seconds, compute_seconds;
};

// Camera pixels where all projectors that light them show black in some channel: it could not be darker.
Mask clipped_pixels(const solver::PixelGeometry& pixels, const Show& show);

// Measures and writes the report; `show` is what was shown (null: photos from elsewhere).
Result<Verification> report_verification(const Calibration& calibration,
                                         const std::filesystem::path& calibration_folder,
                                         const solver::PixelGeometry& pixels, const Photographs& photos,
                                         const Show* show, ReportContext context, const std::filesystem::path& out,
                                         const FillFolder& record = {});

}  // namespace countershade::tools
