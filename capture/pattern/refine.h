// The second half of decoding: neighbours check and refine each other.
#pragma once

#include "capture/pattern/decode.h"

namespace countershade::capture {

// For every accepted pixel of c: the plane through the decoded neighbours (7 x 7) that agree with it. Replaces x, y by the
// plane's value and sigma by what the fit's scatter says. Pixels that too few neighbours support become kIsolated, those
// that contradict the majority kInconsistent. cell_px: size of a code cell, the quantisation step.
void refine_by_neighbours(bool has_x, bool has_y, int cell_px, Correspondence& c);

}  // namespace countershade::capture
