// GigE Vision and USB3 Vision cameras, through Aravis.
#pragma once

#include <array>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "calib/base/result.h"
#include "capture/device/device.h"

namespace countershade::capture {

// One that answered. `device` is what a rig names it by: any of serial, address and name will do, too.
struct AravisCamera {
  std::string device, name;                           // serial number (address where it has none); "vendor model"
  std::string protocol;                               // "GigEVision" or "USB3Vision"
  std::string address;                                // IP address; of USB its id
  std::vector<std::string> formats;                   // those that this program reads; empty: it could not be asked
  std::optional<std::array<double, 2>> exposures_ms;  // shortest, longest; none: unknown
  std::string hindrance;  // why it cannot be used, or its photos may not arrive, and the remedy; empty: nothing is seen
  std::string advice;     // what would make it better; mostly empty
};

// False where this program was built without Aravis.
bool has_aravis();
// Those that answer within a second, each opened for a moment where nobody has it; empty without Aravis.
std::vector<AravisCamera> list_aravis_cameras();

struct AravisOptions {
  double timeout_s = 2;  // beyond the exposure, for one photo
  int tries = 4;         // of a photo that was lost on the way, or parts of it
};

// Opens a camera by serial number, IP address or name; an empty `device` is the only one there is. GigE cameras are
// opened by their address, since with two network cards one that is opened by name may be found and send nothing. The
// format with the most grey values is chosen (pixel_format.h), packets are as large as the network lets through.
//
// Opening switches automatic exposure, gain, white balance, black level and gamma off, and reads back what it has set.
// arm(): an exposure outside the camera's range is kBadValue (names the range), one that the camera changes by more
// than 1 % kDevice (names both). trigger() drops photos of the past, asks for one, and returns it only if it is whole:
// one with holes, or that does not come, is taken again, `tries` times in all. A camera without a software trigger runs
// freely: of the photos whose first packet came an exposure or more after the question the third counts, the fifth
// after a change of exposure, since cameras hold photos back; it is dated by that packet less its exposure. Errors of
// trigger(): kDevice: the camera is gone; no photo came (firewall, network card, trigger), or none was whole (packet
// size, cable); its photo is not as large as it says. Errors: kDevice: none found, several and none named (lists them),
// another program has it; kUnsupported without Aravis.
Result<std::unique_ptr<Camera>> open_aravis_camera(const std::string& id, const std::string& device,
                                                   const AravisOptions& options = {});

}  // namespace countershade::capture
