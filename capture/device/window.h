// A projector that is a monitor of this computer: one full-screen window, bits as given.
#pragma once

#include <span>

#include "capture/device/device.h"

namespace countershade::capture {

struct Monitor {
  std::string name;  // the output's name as the window system gives it, e.g. "HDMI-1"
  int width = 0, height = 0;
  double refresh_hz = 0;  // 0 = unknown
  std::string trap = {};  // what the desktop says that it does to pictures (colours, scale); empty: nothing
  std::string edid = {};  // what hangs on it, by its own words (edid.h), e.g. "EPS EB-L1755U X4KJ930"; empty: unknown

  // Whether a rig's `monitor` means it: by its output, or by what hangs there, wherever it is plugged in.
  bool is(const std::string& monitor) const { return !monitor.empty() && (monitor == name || monitor == edid); }
};

// What a table of the desktop, per encoded value the one that leaves the computer (0..65535), does to pictures: night
// light, colour profiles, brightness sliders. Empty where it stays within 2 % of the values, and for one of zeros,
// which displays without a monitor have.
std::string altered_by_table(std::span<const unsigned short> red, std::span<const unsigned short> green,
                             std::span<const unsigned short> blue);

// Monitors of the running display. Error: kDevice when there is no display to connect to.
Result<std::vector<Monitor>> list_monitors();

// Full screen on the monitor of that name (Monitor::is); an empty name opens a window called `title`, `left` pixels
// from the screen's origin. A picture is shown with its values rounded to 8 bits, one value per pixel, without scaling,
// dither or colour management of ours. All calls come from the thread that opened it, the main thread. Errors: kDevice:
// no display, no such monitor (names those there are), or its mode is not width x height.
Result<std::unique_ptr<Projector>> open_window_projector(const std::string& id, int width, int height,
                                                         const std::string& monitor, const std::string& title,
                                                         int left = 0);

}  // namespace countershade::capture
