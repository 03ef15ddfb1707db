// Pictures of a report: photos as seen, signed differences, the legend of their scale, PNG as text.
#pragma once

#include <string>

#include "calib/base/result.h"
#include "calib/image/image.h"

namespace countershade::tools {

// 255 sRGB(light / white), RGB; NaN is mid-grey.
Image as_seen(const Image& light, double white);

// Signed a - b of the channel that is farthest off, on the diverging scale whose ends are +-reach_percent of white;
// pixels outside the mask are dark grey. (height, width, 3), 0..255.
Image signed_difference(const Image& a, const Image& b, const Mask& shown, double white, double reach_percent);

// A colour bar from -reach to +reach % of white with ticks, as inline SVG.
std::string difference_legend(double reach_percent);

// Mean of square blocks so that the width is at most max_width; NaN pixels do not enter.
Image reduced_to(const Image& image, int max_width);
// The same for a mask: pixels that stand for at least half masked ones.
Mask reduced_to(const Mask& mask, int max_width);

// PNG of 8-bit values (rounded, clamped) and its data: URI. Errors: kIo.
Result<std::string> png_bytes(const Image& values);
std::string data_uri(const std::string& png);

}  // namespace countershade::tools
