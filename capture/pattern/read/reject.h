// Pixels whose rejection can be told better from what lies around them, or from where the devices stand.
#pragma once

#include <cstddef>

#include "calib/geometry/lens.h"
#include "capture/pattern/decode.h"

namespace countershade::capture {

// Rejected pixels that lie between two surfaces become kMixed: what is accepted on either side of them, in a line and
// up to three pixels away, is continued to them, and the two continuations are apart (by more than a crease, where
// surfaces meet but slopes differ, can explain).
void name_mixed(Correspondence& c);

// Accepted pixels that no point of space explains become kEpipolar, NaN, and are no longer counted as accepted: a
// camera pixel's ray is a line in the projector's picture, and a wrong code has no reason to lie on it. Allowed is 1.5
// px, or six times the scatter of all pixels (what the devices' models do not know), or five sigma. Both devices are in
// one frame; `camera` has the size of the maps. Codes of one axis say nothing here. Gives how many were rejected.
std::size_t reject_off_epipolar(const Device& camera, const Device& projector, Correspondence& c);

}  // namespace countershade::capture
