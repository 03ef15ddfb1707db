// Pixels whose light comes from one side of them: at the border of the picture, beside brighter surfaces.
#pragma once

#include "capture/pattern/read/refine.h"

namespace countershade::capture {

// How far [camera px] light of brighter surroundings may pull a pixel's reading toward them: lens blur mixes
// neighbours, and of a pixel beside a surface `ratio` times as bright up to 1 - 1 / ratio of the light is foreign, from
// about half a pixel off. Ratios below 1.1 are noise and shading. contrast: white - black.
float pull_of_surroundings(const Image& contrast, int x, int y);

// Pixels with one that is not lit within four of them, (height, width, 1).
Mask beside_darkness(const Mask& reason);

// The same where light ends. Blur of sigma b leaves a pixel the share f of its light, from the lit side, and contrast
// that falls there by g per pixel of its full value: f = Phi(z), g = phi(z) / b, and the light's middle is
// b phi(z) / f off. Both are measured, so blur of projector and camera need not be known. At least
// pull_of_surroundings; that alone where the fall is too slow to be blur (shading).
// The fall is taken over two pixels, so of a blur below one pixel the pull comes out up to twice too large; where a
// camera pixel is many projector pixels that proved better than the exact one.
float pull_beside_darkness(const Image& contrast, int x, int y);

// Accepted readings beside pixels that are not lit, pulled (as their sigma says already) because half of their light is
// missing, are joined with the plane through their accepted neighbours (9 x 9) that are not pulled, each with its own
// weight: the two are independent measurements of the same pixel. A reading that the plane contradicts stays as it is.
void join_half_lit(AxisReading& reading);

}  // namespace countershade::capture
