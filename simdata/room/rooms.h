// Rooms to simulate: the default ones that `countershade new` writes, and the distribution that studies draw from.
#pragma once

#include <array>

#include "calib/file/rig.h"
#include "calib/geometry/lens.h"
#include "calib/geometry/screen.h"

namespace countershade::simdata {

struct RigAndRoom {
  Rig rig;
  Simulation simulation;
};

// The two-wall room of the documentation: asymmetric in every index. Camera 1920 x 1200, projectors 1280 x 800.
RigAndRoom default_two_wall();

// The same room with devices of fewer pixels, for tests and rehearsals: the camera has 1/divisor of its resolution in
// each direction.
RigAndRoom small_two_wall(int divisor, std::array<int, 2> projector_resolution, int samples);

// A two-wall room drawn from the study distribution (docs/rooms.md): angle 80-110 degrees, walls 2.4-3.6 m wide and
// 1.8-2.4 m high, albedo .7-.85 with a tint per wall, throw 1.0-1.6, vertical lens shift .1-.3, horizontal .01 rms;
// each projector covers its wall and spills >= 30 cm over the edge. Every draw is asymmetric in every index.
RigAndRoom random_two_wall(std::uint64_t seed);

// Walls of a simulated room as surfaces (world frame of the simulation), in the order left, right. v is upward, in
// heights of the wall itself; u runs from left to right, so the crease is u = 1 of the left wall and u = 0 of the right
// one. It is listed as a Crease only when the walls begin and end at the same heights, since its charts share v.
Screen room_screen(const Simulation& simulation);
// The true devices.
Result<Device> true_camera(const Simulation& simulation, const std::string& id);
Result<Device> true_projector(const Simulation& simulation, const Rig& rig, const std::string& id);

}  // namespace countershade::simdata
