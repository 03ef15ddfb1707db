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
Result<std::vector<Finding>> self_check(const Rig& rig, const capture::Devices& devices, Progress& progress);

}  // namespace countershade::tools
