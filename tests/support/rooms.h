// The documentation's room with fewer pixels: seconds instead of minutes.
#pragma once

#include <array>

#include "simdata/room/rooms.h"

namespace countershade::testing {

// default_two_wall() seen by a camera of 1/divisor of its resolution in each direction.
inline simdata::RigAndRoom small_two_wall(int divisor, std::array<int, 2> projector_resolution, int samples) {
  simdata::RigAndRoom room = simdata::default_two_wall();
  SimulatedCamera& camera = room.simulation.cameras[0];
  camera.focal_px /= divisor;
  for (int i = 0; i < 2; ++i) {
    camera.resolution[i] /= divisor;
    camera.principal[i] = (camera.principal[i] + 0.5) / divisor - 0.5;
  }
  for (ProjectorSpec& p : room.rig.projectors) p.resolution = projector_resolution;
  room.simulation.samples = samples;
  return room;
}

}  // namespace countershade::testing
