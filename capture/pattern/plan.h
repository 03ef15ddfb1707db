// Which frames of a sequence carry the code of a projector, and what each of them is.
#pragma once

#include <vector>

#include "capture/pattern/decode.h"

namespace countershade::capture {

// Frame indices of one bit of a Gray code; -1 = not there.
struct BitFrames {
  int plain = -1, inverse = -1;
  int base = -1;  // the bit that it was shown in exclusive or with
};
struct WaveFrame {
  int index = -1;
  double period_px = 0, shift_rad = 0;
};
struct AxisCode {
  std::vector<BitFrames> bits;     // by bit, least significant first
  int cell_px = 1, length_px = 0;  // pixels per cell, and along the axis
  std::vector<WaveFrame> waves;    // sinusoids
  bool exists() const { return !bits.empty() || !waves.empty(); }
};
struct CodePlan {
  int white = -1, black = -1;  // of that projector alone; -1 = not there
  AxisCode axis[2];            // x, y
};

// Which frames carry the code of `projector`. Error: kRefused when there is none, a bit lacks its inverse or the bit it
// was combined with, or the sinusoids cannot be unwrapped (check_waves).
Result<CodePlan> plan_code(const Sequence& sequence, const std::string& projector);

}  // namespace countershade::capture
