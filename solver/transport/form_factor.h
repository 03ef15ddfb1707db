// Form factors: which fraction of the diffuse light that leaves one piece of the screen arrives at another.
#pragma once

#include <Eigen/Dense>
#include <array>
#include <span>

#include "calib/base/progress.h"
#include "calib/geometry/screen.h"

namespace countershade::solver {

using Polygon = std::span<const Eigen::Vector3d>;  // planar, convex, anticlockwise seen from the lit side

// Exact form factor F_ab of two planar convex polygons: the fraction of the diffuse light leaving a that arrives at b.
// Parts behind the other's plane are clipped away; 0 for a polygon of no area. Error <= 1e-9 F + 1e-14, touching or
// not.
//
//   A_a F_ab = 1/(2 pi) closed-integral_a closed-integral_b ln r  dx_a . dx_b   (Schroeder & Hanrahan 1993; PHYSICS 7)
double form_factor(Polygon a, Polygon b);

// Form factor from a small area at x with normal n to b: the fraction of the light leaving it that arrives at b, and
// the weight of b's uniform radiosity in the irradiance at x (Lambert 1760):
//   F = 1/(2 pi) sum_edges angle_e (n . gamma_e); the part of b below the horizon of n is clipped away.
// 0 for x behind b or in b's plane (to 1e-13 of the distance), at b's edges too.
double point_form_factor(const Eigen::Vector3d& x, const Eigen::Vector3d& n, Polygon b);

// The paper's centre-to-centre formula (baseline): cos cos area_b / (pi r^2).
double centre_form_factor(Polygon a, Polygon b);

// Closed forms of Howell's catalogue, for tests and studies: C-11 opposite, C-14 adjacent rectangles.
// Two equal parallel rectangles w x h at distance d.
double opposite_rectangles(double w, double h, double d);
// Perpendicular rectangles with a common edge of length l: from the one of depth a to the one of depth b.
double adjacent_rectangles(double l, double a, double b);

// All patch-to-patch form factors of a screen of planes, (P, P): F(i, j) is the weight of B_j in the gather
// B_i = .. + M_i sum_j F_ij B_j, which is the form factor from i to j: the fraction of i's light that arrives at j. So
// row sums are <= 1, and 1 in a closed room. Both directions come from one exchange A_i F_ij = A_j F_ji: reciprocal to
// the rounding of floats. Error <= 1e-7 F, rounding included. Zero within a plane. Requires plane surfaces (a Bug
// otherwise). No occlusion: planes that hide each other are a matter of a later ladder.
enum class FormFactorMethod { kExact, kCentre };
Eigen::MatrixXf form_factors(const Screen& screen, const Patches& patches, FormFactorMethod method, Progress& progress);

// Point form factors from chart points (the receivers) to all patches: (R, P). Zero within a plane.
Eigen::MatrixXf receiver_form_factors(const Screen& screen, const Patches& patches,
                                      const std::vector<ChartPoint>& receivers, Progress& progress);

}  // namespace countershade::solver
