// Colour for reports: sRGB, CIE L*a*b*, dE2000, and one diverging scale for signed differences.
#pragma once

#include <array>

namespace countershade::tools {

using Rgb = std::array<double, 3>;
using Lab = std::array<double, 3>;  // L*, a*, b* under D65

// Linear 0..1 to sRGB 0..1 (IEC 61966-2-1) and back; arguments outside 0..1 are clamped.
double srgb_encode(double linear);
double srgb_decode(double encoded);

// Linear sRGB (clamped to 0..1) to CIE 1976 L*a*b*, and back (the result may leave 0..1: outside the gamut).
Lab lab_of_linear(const Rgb& linear);
Rgb linear_of_lab(const Lab& lab);

// CIEDE2000 with unit weights (Sharma, Wu & Dalal 2005, Color Res. Appl. 30).
double delta_e_2000(const Lab& a, const Lab& b);

// -1 blue over 0 near-white to +1 red, sRGB 0..1: L* falls by 60 |t| on both sides, so that equal amounts of either
// sign stand out alike and equal steps look equal. Clamped; NaN is grey.
Rgb diverging(double t);

}  // namespace countershade::tools
