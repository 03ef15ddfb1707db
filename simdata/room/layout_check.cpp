// Whether surfaces pass through each other, or devices stand in them.
#include <algorithm>
#include <cmath>

#include "simdata/room/mesh.h"
#include "simdata/room/room_check.h"

namespace countershade::simdata {

namespace {

constexpr int kLines = 12;     // grid lines of a chart, each way
constexpr double kRim = 2e-3;  // of a chart: surfaces may touch there

bool inner(double u) {
  return u > kRim && u < 1 - kRim;
}

// Whether a grid line of a's chart passes through b, away from the rims of both.
bool crosses(const Shape& a, const Shape& b) {
  const auto pierces = [&](double u0, double v0, double u1, double v1) {
    const Eigen::Vector3d from = a.at(u0, v0).x, line = a.at(u1, v1).x - from;
    const auto hit = b.intersect({from, line}, 0);
    if (!hit || !(hit->t < 1)) return false;
    if (b.form() != Shape::Form::kMesh && !(inner(hit->u) && inner(hit->v))) return false;
    const double u = u0 + hit->t * (u1 - u0), v = v0 + hit->t * (v1 - v0);
    return inner(u) && inner(v);
  };
  // Odd places: surfaces like to meet in the middle of each other, where a line would begin or end.
  for (int i = 0; i < kLines; ++i)
    for (int j = 0; j < kLines; ++j) {
      const double fixed = (i + 0.3819) / kLines;
      const double from = j == 0 ? 0 : (j - 0.2764) / kLines, to = j + 1 == kLines ? 1 : (j + 0.7236) / kLines;
      if (pierces(fixed, from, fixed, to) || pierces(from, fixed, to, fixed)) return true;
    }
  return false;
}

// Whether some inner point of a lies in b.
bool coincides(const Shape& a, const Shape& b) {
  for (int i = 1; i < kLines; ++i)
    for (int j = 1; j < kLines; ++j) {
      const SurfacePoint p = a.at(i / double{kLines}, j / double{kLines});
      const double near = 1e-6 * a.diagonal(0.5, 0.5, 1, 1);
      const auto hit = b.intersect({p.x + near * p.normal, -2 * near * p.normal}, 0);
      if (hit && hit->t < 1 && inner(hit->u) && inner(hit->v)) return true;
    }
  return false;
}

bool meshes_cross(const Shape& a, const Shape& b) {
  const auto *one = dynamic_cast<const MeshShape*>(&a), *other = dynamic_cast<const MeshShape*>(&b);
  return one && other &&
         crossing(one->triangles().corners, one->triangles().faces, other->triangles().corners,
                  other->triangles().faces);
}

// Along the normal of the nearest sample where that is nearer than the sample itself.
double distance(const Shape& shape, const Eigen::Vector3d& x) {
  double nearest = HUGE_VAL;
  Eigen::Vector3d normal = Eigen::Vector3d::UnitX();
  for (const SurfacePoint& p : shape.samples())
    if ((p.x - x).norm() < nearest) nearest = (p.x - x).norm(), normal = p.normal;
  for (double side : {1.0, -1.0})
    if (const auto hit = shape.intersect({x, side * normal}, -1e-12)) nearest = std::min(nearest, std::abs(hit->t));
  return nearest;
}

}  // namespace

Result<void> check_layout(const Rig& rig, const Simulation& simulation,
                          const std::vector<std::shared_ptr<const Shape>>& shapes) {
  for (std::size_t a = 0; a < shapes.size(); ++a)
    for (std::size_t b = 0; b < shapes.size(); ++b) {
      if (a == b) continue;
      const bool from_mesh = shapes[a]->form() == Shape::Form::kMesh, to_mesh = shapes[b]->form() == Shape::Form::kMesh;
      if ((a < b && meshes_cross(*shapes[a], *shapes[b])) || (!from_mesh && crosses(*shapes[a], *shapes[b])) ||
          (!from_mesh && !to_mesh && coincides(*shapes[a], *shapes[b])))
        return error(ErrorCode::kBadValue,
                     "[simulation] the surfaces '{}' and '{}' pass through each other or lie in each other; they may "
                     "touch at their edges only: move or shorten one",
                     simulation.surfaces[a].id, simulation.surfaces[b].id);
    }
  const auto stands_free = [&](const std::string& what, const std::array<double, 3>& position) -> Result<void> {
    for (std::size_t s = 0; s < shapes.size(); ++s)
      if (distance(*shapes[s], {position[0], position[1], position[2]}) < 1e-3)
        return error(ErrorCode::kBadValue, "[simulation] {} stands in the surface '{}'; move it at least 1 mm away",
                     what, simulation.surfaces[s].id);
    return {};
  };
  for (const SimulatedCamera& c : simulation.cameras)
    if (rig.camera(c.id)) CS_TRY_VOID(stands_free("camera '" + c.id + "'", c.position));
  for (const SimulatedProjector& p : simulation.projectors)
    if (rig.projector(p.id)) CS_TRY_VOID(stands_free("projector '" + p.id + "'", p.position));
  return {};
}

}  // namespace countershade::simdata
