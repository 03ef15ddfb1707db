// The small check before every capture.
#pragma once

#include <string>
#include <vector>

#include "calib/base/progress.h"
#include "calib/base/result.h"
#include "calib/file/rig.h"
#include "capture/device/device.h"
#include "tools/report/check_page.h"

namespace countershade::tools {

// Shows black and white on every projector alone and on all of them, and looks at what each camera sees: exposure,
// saturation, contrast, ambient light, a stale frame, a projector that lights nothing.
// A camera that is watched and fails is a finding, after which the next one is looked at; other errors of devices are
// errors.
Result<std::vector<Finding>> self_check(const Rig& rig, const capture::Devices& devices, Progress& progress);

// Whether a camera's photos are to be trusted (Camera::health), of those that it has taken so far.
Finding health_of(const capture::Camera& camera);

}  // namespace countershade::tools
