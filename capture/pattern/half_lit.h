// Pixels whose light comes from one side of them: at the border of the picture, beside brighter surfaces.
#pragma once

#include "capture/pattern/refine.h"

namespace countershade::capture {

// How far [camera px] light of brighter surroundings may pull a pixel's reading toward them: lens blur mixes
// neighbours, and of a pixel beside a surface `ratio` times as bright up to 1 - 1 / ratio of the light is foreign, from
// about half a pixel off. Ratios below 1.1 are noise and shading. contrast: white - black.
float pull_of_surroundings(const Image& contrast, int x, int y);

// Accepted readings beside pixels that are not lit, pulled (as their sigma says already) because half of their light is
// missing, are joined with the plane through their accepted neighbours (9 x 9) that are not pulled, each with its own
// weight: the two are independent measurements of the same pixel. A reading that the plane contradicts stays as it is.
void join_half_lit(AxisReading& reading);

}  // namespace countershade::capture
