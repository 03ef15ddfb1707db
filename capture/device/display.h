// Windows that show what a renderer left on the graphics card: one per projector, with the objects of one GL 4.3
// context.
#pragma once

#include <memory>
#include <span>
#include <string>
#include <vector>

#include "calib/base/result.h"

namespace countershade::capture {

struct DisplayWindow {
  std::string projector;
  int width = 0, height = 0;  // pixels
  std::string monitor;        // full screen there; empty: a window, the next to the right of the last
};

// All calls come from the thread that opened it, the main thread.
class TextureDisplay {
 public:
  // Opens the windows and makes the first one's context current: the renderer lives in it.
  // Errors: kDevice: no display, no such monitor, its mode differs from width x height, or GL 4.3 is missing.
  static Result<std::unique_ptr<TextureDisplay>> open(const std::vector<DisplayWindow>& windows);
  virtual ~TextureDisplay() = default;
  // Shows textures[q] (2-D, the window's size, row 0 on top) in window q, rounded to 8 bits, pixel for pixel. Waits for
  // the display's refresh. The first window's context is current before and after. Errors: kDevice.
  virtual Result<void> present(std::span<const unsigned> textures) = 0;
  // Keys typed into any of the windows since the last call, as lower-case letters; "q" when a window was closed.
  virtual std::string typed() = 0;
};

}  // namespace countershade::capture
