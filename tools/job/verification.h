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
  Mask lit;       // the model knows that a projector lights it, or it is lit by one
  Mask edge;      // within a sixth of the mean chart width of a crease
  Mask modelled;  // the model knows a direct gain there
  std::string edge_text;
};
// projected: the target without black, so that the room's own light lights nothing.
VerifyMasks verify_masks(const Calibration& calibration, const solver::PixelGeometry& pixels, const Image& projected);

// The target without what has bounced of the room's own light and of the projectors' black, which the compensation
// removes, too: that share of the black photo is computed, by the calibration's form factors. In a dark room it is next
// to nothing.
Image direct_target(const solver::Model& model, const solver::PixelGeometry& pixels, const Photographs& photos);

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
