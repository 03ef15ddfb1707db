// The lenses of simulated devices.
#pragma once

#include "calib/file/rig.h"
#include "calib/geometry/lens.h"

namespace countershade::simdata {

// The lens of a camera: that of its .cameramodel where it names one (any lens model of mrcal), else Brown-Conrady by
// its own numbers. Errors: kBadFile; kBadValue where the model's picture is not of the camera's resolution.
Result<Lens> camera_lens(const SimulatedCamera& camera);
// The lens of a projector of width x height pixels: Brown-Conrady about the shifted axis. Errors: kBadValue for a
// distortion that folds inside the picture.
Result<Lens> projector_lens(const SimulatedProjector& projector, int width, int height);

}  // namespace countershade::simdata
