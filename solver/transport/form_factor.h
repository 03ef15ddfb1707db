// Form factors: which fraction of the diffuse light that leaves one piece of the screen arrives at another.
#pragma once

#include <Eigen/Dense>
#include <array>
#include <span>

#include "calib/base/progress.h"
#include "calib/geometry/screen.h"

namespace countershade::solver {

using Polygon = std::span<const Eigen::Vector3d>;  // planar, convex, anticlockwise seen from the lit side

// Exact form factor F_ab of two planar convex polygons that see each other fully; parts behind the other's plane are
// clipped away. Relative error <= 1e-8 for disjoint pairs, 1e-6 for pairs that share an edge or a corner.
//
//   A_a F_ab = 1/(2 pi) closed-integral_a closed-integral_b ln r  dx_a . dx_b        (PHYSICS 7)
double form_factor(Polygon a, Polygon b);

// Fraction of the light arriving at a small area at x with normal n that a uniform polygon b sends (Lambert 1760):
//   F = 1/(2 pi) sum_edges angle_e (n . gamma_e); the part of b below the horizon of n is clipped away.
double point_form_factor(const Eigen::Vector3d& x, const Eigen::Vector3d& n, Polygon b);

// The paper's centre-to-centre formula (baseline): cos cos area_b / (pi r^2).
double centre_form_factor(Polygon a, Polygon b);

// Closed forms of Howell's catalogue, for tests and studies: C-11 opposite, C-14 adjacent rectangles.
// Two equal parallel rectangles w x h at distance d.
double opposite_rectangles(double w, double h, double d);
// Perpendicular rectangles with a common edge of length l: from the one of depth a to the one of depth b.
double adjacent_rectangles(double l, double a, double b);

// All patch-to-patch form factors of a screen of planes: F(i, j) = share of the light gathered at i that comes from j in
// B_i = .. + M_i sum_j F_ij B_j, (P, P). Reciprocal to 1e-12: A_i F_ij = A_j F_ji. Zero within a plane.
// Requires plane surfaces (a Bug otherwise). No occlusion: planes that hide each other are a matter of a later ladder.
enum class FormFactorMethod { kExact, kCentre };
Eigen::MatrixXf form_factors(const Screen& screen, const Patches& patches, FormFactorMethod method, Progress& progress);

// Point form factors from chart points (the receivers) to all patches: (R, P).
Eigen::MatrixXf receiver_form_factors(const Screen& screen, const Patches& patches,
                                      const std::vector<ChartPoint>& receivers, Progress& progress);

}  // namespace countershade::solver
