// Parts of the lens fit that its files share.
#pragma once

#include "solver/fit/lens/lens_fit.h"
#include "solver/fit/lens/problem.h"

namespace countershade::solver::lens_parts {

// The fit as mrcal's problem; points that are not used stay out.
Problem problem_of(const BoardViews& data, const LensFit& fit);

}  // namespace countershade::solver::lens_parts
