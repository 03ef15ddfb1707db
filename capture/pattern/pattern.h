// Patterns: what each role of a sequence looks like on a projector (encode).
#pragma once

#include "calib/base/result.h"
#include "calib/file/session.h"
#include "calib/image/image.h"

namespace countershade::capture {

// The picture of `role` for a projector: (height, width, 3), encoded values 0..65535; black where `role.projector`
// names another projector. Errors: kUnsupported for a kind this program cannot draw.
Result<Picture> render_role(const Role& role, const std::string& projector_id, int width, int height);

// Gray code of a column or row, and back. n = binary index < 2^31.
inline unsigned gray_from_binary(unsigned n) {
  return n ^ (n >> 1);
}
unsigned binary_from_gray(unsigned g);
// Bits needed for `count` cells.
int gray_bits(int count);

// The default capture of a rig: per projector white, black and Gray code with inverse on both axes; then, for the
// photometric fit, two complementary block patterns per primary on all projectors together, black, and for every
// projector but the first three primaries alone (7 + 3 (n - 1) frames, PHYSICS 6); two held-out photo-like frames.
Sequence default_sequence(const Rig& rig);

// Writes patterns/ (CONTRACT): sequence.json and NNNN/<projector>.png, 8-bit RGB. The folder appears whole.
Result<void> write_patterns(const Sequence& sequence, const std::filesystem::path& folder);

}  // namespace countershade::capture
