// Whether a simulated room can exist.
#pragma once

#include "calib/base/result.h"
#include "calib/file/rig.h"
#include "simdata/room/shape.h"

namespace countershade::simdata {

// kBadValue names the first value that is out of bounds, or the device of the rig that the simulation does not have.
Result<void> check_room(const Rig& rig, const Simulation& simulation);

// Whether the surfaces leave room for each other and for the devices: kBadValue names two that pass through each other,
// and the device that stands in a surface.
Result<void> check_layout(const Rig& rig, const Simulation& simulation,
                          const std::vector<std::shared_ptr<const Shape>>& shapes);

}  // namespace countershade::simdata
