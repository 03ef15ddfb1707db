// The exchange integral behind a form factor.
#pragma once

#include "solver/transport/form_factor.h"

namespace countershade::solver {

// A_a F_ab = A_b F_ba [screen unit^2], to about the relative tolerance asked for.
double patch_flow(Polygon a, Polygon b, double tolerance);

}  // namespace countershade::solver
