// Patterns: what each role of a sequence looks like on a projector (encode).
#pragma once

#include "calib/base/result.h"
#include "calib/file/file.h"
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

// Phase of a role of kind phase at the centre of the first pixel [rad].
double wave_shift(const Role& role);

// The codes by name (code_roles), each with what it is.
const std::vector<std::pair<std::string, std::string>>& codes();
// The frames that tell a projector's pixels apart on both axes, in order, without white and black:
//   gray                 every bit of the Gray code, with its inverse
//   xor-02, xor-04       the same in exclusive or with bit 0 or 1, so that every stripe is narrow (Gupta et al. 2011)
//   micro-phase          three shifts of a period of 16 px, two in quadrature of two (three beyond 2048 px) others
//                        below 27 px: 7 (9) frames per axis (band and shared unknowns: Gupta & Nayar 2012)
//   micro-phase-9        always three others
//   embedded             three shifts of 16 px and of two periods whose beats with it unwrap it (Moreno et al. 2015)
//   phase                four shifts each of a ladder of periods, from the length of the axis down to 20 px
// Sinusoids are made for a projector of exponent 2.2 (shown_exponent 1 / 2.2). Errors: kBadValue names the nearest
// code.
Result<std::vector<Role>> code_roles(const std::string& code, const ProjectorSpec& projector);

// The frames that every capture with a chosen code begins with, per projector: white, black, and the three shifts of 16
// px on both axes, which say how much light is direct (choose.h) and are part of every code.
std::vector<Role> base_roles(const ProjectorSpec& projector);
Sequence base_sequence(const Rig& rig);
// base_sequence, then what is left of each projector's code (codes[q] of the rig's projector q), then the photometric
// frames of default_sequence. Errors as code_roles.
Result<Sequence> sequence_with(const Rig& rig, const std::vector<std::string>& codes);

// What is shown and photographed by hand, whatever the camera does to its photos: per projector white, black and Gray
// code with inverse on both axes; then, for the photometric fit, two complementary block patterns per primary on all
// projectors together, black, and for every projector but the first three primaries alone (7 + 3 (n - 1) frames,
// PHYSICS 6); two held-out photo-like frames.
Sequence default_sequence(const Rig& rig);

// Writes patterns/ (CONTRACT): sequence.json and NNNN/<projector>.png, 8-bit RGB. The folder appears whole.
Result<void> write_patterns(const Sequence& sequence, const std::filesystem::path& folder,
                            const FillFolder& record = {});

}  // namespace countershade::capture
