// Whether a camera still looks where it looked: shifts too small to change bins of pixels.
#pragma once

#include "capture/session/frame_check.h"

namespace countershade::capture {

// How far detail of photo a stands elsewhere in photo b of the same picture [px]; both in single pixels (bin_photo with
// bin 1), of one size (a Bug otherwise). Lucas & Kanade 1981 in 6 x 4 tiles, each with a gain and added light of its
// own, so that light that drifts is no shift. Of all tiles the largest shift along a direction whose detail tells it,
// less four standard deviations of noise; at least 0. Meant for shifts below about 2 px: larger ones are
// underestimated.
double view_shift_px(const Bins& a, const Bins& b);

}  // namespace countershade::capture
