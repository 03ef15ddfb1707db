// Whether a simulated room can exist.
#pragma once

#include "calib/base/result.h"
#include "calib/file/rig.h"

namespace countershade::simdata {

// kBadValue names the first value that is out of bounds, or the device of the rig that the simulation does not have.
Result<void> check_room(const Rig& rig, const Simulation& simulation);

}  // namespace countershade::simdata
