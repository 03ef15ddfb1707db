// Cameras behind the kernel's Video4Linux2 interface: USB webcams and industrial UVC cameras, frame grabbers, CSI
// boards.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "calib/base/result.h"
#include "capture/device/device.h"

namespace countershade::capture {

struct V4l2Camera {
  std::string device;                // "/dev/video0"
  std::string name, bus;             // as the driver says: "HD Pro Webcam C920", "usb-0000:00:14.0-2"
  std::vector<std::string> formats;  // four characters each, as the kernel spells them: "Y16 ", "YUYV"
  std::string hindrance;             // why it cannot be opened, with the remedy; empty where it can
};

// False on systems without Video4Linux2.
bool has_v4l2();
// All devices that stream pictures, those that may not be opened too.
std::vector<V4l2Camera> list_v4l2_cameras();

struct V4l2Options {
  double timeout_s = 2;  // beyond the exposure, for one photo
  int tries = 4;         // of a photo that was lost or came with an error
};

// Opens a camera by its node ("/dev/video0", or a link to it as in /dev/v4l/by-id), name or bus; an empty `device` is
// the only one there is. The format with the most grey values is chosen: grey before mosaic before colour, then more
// bits (GREY, Y10, Y12, Y14, Y16; Bayer of 8, 10, 12, 16 bits; RGB3, BGR3, YUYV, MJPG), then its largest size.
//
// Opening switches off whatever changes by itself or bends the light (exposure, gain, white balance, focus and their
// priorities, flicker filter, sharpening, backlight compensation, gamma), and reads back what it has set. arm(): an
// exposure outside the range that the driver states is kBadValue, one that reads back differently kDevice; a camera
// whose exposure is not stated in time takes only 0. That a camera makes something else of what its driver reads back
// no program can ask: `check` looks at the light. trigger() drops the photos whose exposure began before it was called,
// and those that came with an error or too short. Errors of trigger(): kDevice: the camera is gone, no photo came, or
// none was whole. Errors: kDevice: no such camera, may not be opened (permissions), another program has it; kBadValue:
// several fit (lists them); kUnsupported: it offers no format that is read here.
Result<std::unique_ptr<Camera>> open_v4l2_camera(const std::string& id, const std::string& device,
                                                 const V4l2Options& options = {});

}  // namespace countershade::capture
