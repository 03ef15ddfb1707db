// What a frame leaves undone because nobody would see it; the same on the CPU and in GL.
#pragma once

namespace countershade::solver {

// Indirect light below this share of white is left alone: at mid grey half of an 8-bit sRGB code is 1/550 of white, and
// even where the curve is steepest it is 1/6600.
inline constexpr float kInvisible = 1.f / 2000;
// The clipped solution is done when no patch moves by more than this share of white: a quarter of a 10-bit step.
inline constexpr float kClipTolerance = .25f / 1020;

}  // namespace countershade::solver
