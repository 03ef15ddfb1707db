// A fitted lens as mrcal writes one: with what it was fitted from, so that mrcal's own tools can show its residuals and
// uncertainty (mrcal-show-projection-uncertainty, mrcal-show-residuals) and fit it again.
#pragma once

#include <filesystem>

#include "solver/fit/lens/lens_fit.h"

namespace countershade::solver {

// A .cameramodel with 'optimization_inputs'; numbers have all their digits. read_cameramodel (calib/geometry/lens.h)
// reads it as any other.
Result<void> write_fitted_cameramodel(const std::filesystem::path& path, const BoardViews& data, const LensFit& fit);

}  // namespace countershade::solver
