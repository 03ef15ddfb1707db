// Cameras through libcamera: those of boards whose pictures a pipeline of the computer's own develops, and USB webcams.
#pragma once

#include <array>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "calib/base/result.h"
#include "capture/device/device.h"

namespace countershade::capture {

struct LibcameraCamera {
  std::string id;                    // libcamera's own, which stays the same: where it is plugged in, and what it is
  std::string name;                  // as the camera says: "HD Pro Webcam C920", "imx219"
  std::vector<std::string> nodes;    // the /dev/video nodes that its pictures come from
  std::vector<std::string> formats;  // of its raw stream, where it has one, as libcamera spells them: "SBGGR10"
  std::optional<std::array<double, 2>> exposures_ms;  // least and most; none where it cannot be told
  std::string hindrance;                              // why it cannot be opened, with the remedy; empty where it can
};

// False where this program was built without libcamera.
bool has_libcamera();
// All cameras that libcamera knows, and media devices that may not be opened; empty without libcamera.
std::vector<LibcameraCamera> list_libcamera_cameras();
// Why libcamera may know none, with the remedy.
std::string why_no_libcamera_camera();

struct LibcameraOptions {
  double timeout_s = 2;  // beyond the exposure, for one photo
  int tries = 4;         // of a photo that was lost or came with an error
};

// Opens a camera by libcamera's id, its name or one of its /dev/video nodes; an empty `device` is the only one there
// is. The raw stream is taken where there is one that is read here, in the format with the most grey values
// (pixel_format.h) and its largest size.
//
// Automatic exposure, white balance, sharpening and noise reduction are switched off, exposure and gain set, in every
// request. What libcamera has no control for is locked through the camera's /dev/video nodes (v4l2_node.h). arm(): an
// exposure outside the range that libcamera states is kBadValue. trigger() drops photos begun before it was called
// (photo_clock.h), those whose request did not ask for this exposure yet, and those whose metadata contradict what was
// asked (photo_settings.h). A pipeline that says nothing of a photo's exposure (uvcvideo) is taken at its driver's
// word, which is what was asked for and not what the camera made of it: `check` looks at the light. Errors of
// trigger(): kDevice: the camera is gone, no photo came, none was whole, or all contradict what was asked (names both).
// Errors: kDevice: no such camera, may not be opened (permissions), another program has it; kBadValue: several fit
// (lists them); kUnsupported: without libcamera, or no format that is read here.
Result<std::unique_ptr<Camera>> open_libcamera_camera(const std::string& id, const std::string& device,
                                                      const LibcameraOptions& options = {});

}  // namespace countershade::capture
