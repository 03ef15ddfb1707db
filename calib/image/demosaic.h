// Colour from sensors that measure one colour per pixel.
#pragma once

#include <string>

#include "calib/image/image.h"

namespace countershade {

// Each missing colour as the mean of the pixels of that colour among the eight around (mirrored at the rim), rounded; a
// colour that was measured stays. mosaic: (height, width, 1), at least 2 x 2; pattern: colours of its first 2 x 2
// pixels, row by row: "RGGB", "BGGR", "GRBG" or "GBRG". Returns (height, width, 3).
Image demosaiced(const Image& mosaic, const std::string& pattern);

}  // namespace countershade
