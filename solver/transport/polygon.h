// Small operations on planar polygons.
#pragma once

#include <vector>

#include "solver/transport/form_factor.h"

namespace countershade::solver {

using Corners = std::vector<Eigen::Vector3d>;

// Normal times twice the area; zero for fewer than three corners.
Eigen::Vector3d area_vector(Polygon p);

// Largest distance between two corners.
double diameter(Polygon p);

// Mean of the corners.
Eigen::Vector3d centre(Polygon p);

// The part of a polygon on the side of a plane through `origin` that the unit vector `normal` points to (Sutherland &
// Hodgman 1974, one plane). Corners nearer to the plane than `slack` count as lying in it. May have < 3 corners:
// nothing.
Corners clip(Polygon p, const Eigen::Vector3d& origin, const Eigen::Vector3d& normal, double slack);

}  // namespace countershade::solver
