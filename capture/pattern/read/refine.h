// The second half of decoding: neighbours check, complete and refine each other.
#pragma once

#include <vector>

#include "capture/pattern/decode.h"

namespace countershade::capture {

// One axis of a camera's view as its bits were read.
struct AxisReading {
  int cell_px = 1, bits = 0, length_px = 0;
  int base = -1;  // the bit that others were shown in exclusive or with; its edges leave all of those in doubt
  Image q;  // projector px; the middle of the cell, or of two neighbouring cells where one bit is at its edge; NaN
            // where bits leave more than that open
  std::vector<std::uint32_t> code, uncertain;  // per pixel: bits read, and those of them that are in doubt
  Image contrast;                              // white - black
  Image sigma;                                 // refined: projector px
  Mask reason;                                 // Reason; kUncertainBit: may be completed
};

// For every pixel that was read: the plane through those neighbours (7 x 7) that agree with it replaces q, and sigma is
// what the fit's scatter says. Pixels that too few neighbours support become kIsolated, those that contradict the
// majority kInconsistent. A pixel with bits in doubt takes the plane of its neighbours, if all its certain bits (half
// of them at least) are those of a cell that the plane says, and is accepted then.
void refine_by_neighbours(AxisReading& reading);

// For readings that are finer than a pixel already and stay as they are: the same judgement. `other` holds the second
// way to read a pixel; one that is kUncertainBit is accepted where seven of ten neighbours agree with one of the two.
// sigma is widened by what brighter surroundings may pull, and such readings are joined with their neighbours' plane.
void check_by_neighbours(AxisReading& reading, const Image& other);

}  // namespace countershade::capture
