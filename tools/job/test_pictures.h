// The fixed pictures that every study and the demo show; functions of (name, projector, pixel) alone.
#pragma once

#include <string>
#include <vector>

#include "calib/base/result.h"
#include "calib/image/image.h"

namespace countershade::tools {

// flat | gradient | photo (linear .25 to .6: in range) | window (bright window, dark room) | text (white on black) |
// saturated | table-1 (the areas of Bimber et al. 2006).
const std::vector<std::string>& test_picture_names();

// Picture of projector `index` (0 = left ...), encoded with gamma 2.2, 8-bit values in 16-bit range.
// Errors: kBadValue for an unknown name.
Result<Picture> test_picture(const std::string& name, int index, int width, int height);

}  // namespace countershade::tools
