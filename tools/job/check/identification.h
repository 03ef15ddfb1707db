// Which monitor is which, and does it show pixels as they are sent?
#pragma once

#include <string>
#include <vector>

#include "calib/base/progress.h"
#include "calib/file/rig.h"
#include "calib/image/image.h"
#include "capture/device/window.h"

namespace countershade::tools {

// (height, width, 3): a line of one pixel around all (a side that is missing is cut off), a field of single pixels and
// one of single lines (even grey, unless something scales), steps of 4 from black and to white (fewer are seen where a
// limited range is taken for a full one), and these lines of text, as large as fits.
Picture identification_picture(int width, int height, const std::vector<std::string>& text);

// What it says on a monitor: its name, its mode, and the projectors of the rig that name it.
std::vector<std::string> identification_text(const capture::Monitor& monitor, const Rig* rig);

// Shows it on every monitor at once for so long. Errors: kDevice.
Result<void> identify_monitors(const Rig* rig, double seconds, Progress& progress);

}  // namespace countershade::tools
