// Decoded pixels judged by frames that decoding has not seen.
#pragma once

#include <algorithm>
#include <optional>
#include <vector>

#include "capture/pattern/decode.h"

namespace countershade::capture {

// How many accepted pixels of a projector a pair of complementary block patterns (role `blocks`) contradicts.
struct CodeAudit {
  std::size_t judged = 0;  // pixels lit by this projector alone, two pixels and more away from the border of a block,
                           // whose pair of photos clearly differs
  std::size_t contradicted = 0;  // the block that lights them is not the one that their code says
  // Share of wrong codes: half of them land in a block of the right colour, so twice the contradicted.
  double wrong() const {
    return judged ? std::min(1.0, 2.0 * static_cast<double>(contradicted) / static_cast<double>(judged)) : 0;
  }
};

// For every entry of `decoded` (of one camera). Nothing where the sequence has no pair of blocks. Errors: those of
// photos.
Result<std::vector<CodeAudit>> audit_codes(const Sequence& sequence, const PhotoSource& photos,
                                           const std::vector<Correspondence>& decoded);

// Pixels that block patterns light clearly, so that some projector lights them directly, and those of them in which no
// projector's code is accepted. A decoder counts what shows no stripe as dark or lit by way of other surfaces; blocks,
// which are coarse, tell it from what is out of focus. Errors: those of photos.
struct Unread {
  std::size_t clear = 0, unread = 0;
  double share() const { return clear ? static_cast<double>(unread) / static_cast<double>(clear) : 0; }
};
Result<Unread> unread_pixels(const Sequence& sequence, const PhotoSource& photos,
                             const std::vector<Correspondence>& decoded);

// How far the picture of the room moved on the camera between the white frames and the block patterns: a code whose
// photos all moved a little is consistent in itself, and contradicts nothing but what is photographed later.
inline constexpr double kMostViewShift = 0.15;  // camera px: more than decoding errs by itself
struct ViewShift {
  double x = 0, y = 0, sigma = 0;  // camera px; sigma of the worse of both
  double length() const;
  // Further than decoding errs by itself, and than noise explains.
  bool moved() const;
};

// Light adds: P + P' - 2 B = sum over projectors of (W - B), whatever bounces, for complementary blocks P and P', each
// projector's white W and black B. Where the view has moved by d in between, the left side is the right one, R, moved:
//
//   left = a R + b - d . grad R       (least squares; a: lamps that changed)
//
// of means over 5 x 5 pixels, so that shifts of up to 2 px are read well and larger ones as too small, less those over
// 25 x 25, so that other light, where it is smooth, does not pass for a shift of what it lies over. Nothing where
// frames are missing or no edge is seen. Errors: those of photos.
Result<std::optional<ViewShift>> shift_of_view(const Sequence& sequence, const PhotoSource& photos);

}  // namespace countershade::capture
