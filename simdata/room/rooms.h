// Rooms to simulate: the default ones that `countershade new` writes, and the distribution that studies draw from.
#pragma once

#include <array>
#include <string>
#include <utility>
#include <vector>

#include "calib/file/rig.h"
#include "calib/geometry/lens.h"
#include "calib/geometry/screen.h"

namespace countershade::simdata {

struct RigAndRoom {
  Rig rig;
  Simulation simulation;
  std::vector<std::pair<std::string, std::string>> files;  // that the rig refers to: name, contents
};

// Names of the rooms that `countershade new` knows, and what each is.
const std::vector<std::pair<std::string, std::string>>& room_kinds();
// The room of a kind (docs/rooms.md), asymmetric in every index, in metres. Errors: kBadValue: unknown kind (gives the
// nearest).
Result<RigAndRoom> default_room(const std::string& kind);

// Two walls that meet in the crease x = z = 0: the left one leads to the left front, the right one to the right front,
// and the plane x = 0 halves the dihedral angle.
struct TwoWalls {
  double angle_deg = 90;
  std::array<double, 2> left_size{3, 2}, right_size{3, 2};  // width, height, m
  double left_rise = 0, right_rise = 0;                     // height of each lower edge, m
  std::array<double, 3> left_albedo{0.8, 0.8, 0.8}, right_albedo{0.8, 0.8, 0.8};
};
// u runs from left to right on both, so the crease is u = 1 of the left wall and u = 0 of the right one; v is upward.
std::vector<SimulatedSurface> surfaces_of(const TwoWalls& walls);

// The two-wall room of the documentation: asymmetric in every index. Camera 1920 x 1200, projectors 1280 x 800.
// angle_deg 15 to 170.
RigAndRoom default_two_wall(double angle_deg = 97);

// The same room with devices of fewer pixels, for tests and rehearsals: the camera has 1/divisor of its resolution in
// each direction.
RigAndRoom small_two_wall(int divisor, std::array<int, 2> projector_resolution, int samples);
// Any room with devices of fewer pixels: cameras 1/divisor, projectors 1/projector_divisor in each direction.
RigAndRoom smaller(RigAndRoom room, int divisor, int projector_divisor, int samples);

// A two-wall room drawn from the study distribution (docs/rooms.md): angle 80-110 degrees, walls 2.4-3.6 m wide and
// 1.8-2.4 m high, albedo .7-.85 with a tint per wall, throw 1.0-1.6, vertical lens shift .1-.3, horizontal .01 rms;
// each projector covers its wall and spills >= 30 cm over the edge. Every draw is asymmetric in every index.
RigAndRoom random_two_wall(std::uint64_t seed);

// The rectangles of a simulated room as planes, in their order; no surfaces where the room has others. Neighbours that
// share a whole side u = 1 | u = 0 have a Crease there.
Screen room_screen(const Simulation& simulation);
// Angle between the lit sides of the first two rectangles [degrees]; NaN without them.
double edge_angle_deg(const Simulation& simulation);
// The true devices.
Result<Device> true_camera(const Simulation& simulation, const std::string& id);
Result<Device> true_projector(const Simulation& simulation, const Rig& rig, const std::string& id);

}  // namespace countershade::simdata
