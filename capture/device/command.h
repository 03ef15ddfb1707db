// A camera that somebody else's program takes photos with: one run of a command is one photo. For tethered cameras,
// e.g. through gphoto2.
#pragma once

#include "capture/device/device.h"

namespace countershade::capture {

struct CommandCameraOptions {
  double timeout_s = 60;  // of one photo; what the command started is killed then
};

// `command` is a line for /bin/sh. {file} in it stands for the photo to write, without its ending: the command adds
// .png, .tif, .tiff, .jpg or .exr, and has ended when the photo is whole. {exposure_ms} and {exposure_s} stand for the
// exposure [ms, s]. Stored numbers are kept as they are; a JPEG's are 8 bits and hardly ever linear.
// Errors: kBadValue: no {file} in the command. arm(): kBadValue: a second exposure that the command would not hear of.
// trigger(): kDevice: the command failed (its exit code and last line), took too long, or left no photo.
Result<std::unique_ptr<Camera>> open_command_camera(const std::string& id, const std::string& command,
                                                    const CommandCameraOptions& options = {});

}  // namespace countershade::capture
