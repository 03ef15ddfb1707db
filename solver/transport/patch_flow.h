// The exchange integral behind a form factor.
#pragma once

#include "solver/transport/form_factor.h"

namespace countershade::solver {

// A_a F_ab = A_b F_ba [screen unit^2], to about the relative tolerance asked for, in [1e-13, 1e-2].
// Zero for polygons of no area, of one plane, or turned away from each other.
//
// Pairs that are far apart for their size: Gauss-Legendre of cos cos / (pi r^2) over both areas, of the order that
// their distance asks for (the error falls by (size / distance)^2 per point and axis, and nothing cancels). Near pairs:
// the contour integral, whose inner integral is in closed form; the outer one is Gauss-Legendre, or tanh-sinh between
// the points where the integrand is not smooth.
double patch_flow(Polygon a, Polygon b, double tolerance);

}  // namespace countershade::solver
