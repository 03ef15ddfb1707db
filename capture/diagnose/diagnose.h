// Why photos do not fit their sequence: each cause by name, beside the decoder that only says that they do not.
#pragma once

#include <string>
#include <vector>

#include "capture/pattern/decode.h"

namespace countershade::capture {

// What is wrong, by name:
//   axes-swapped          x and y are exchanged
//   inverse-swapped       `inverse` says true where it should say false
//   levels-swapped        white and black are exchanged
//   bits-reversed         bit 0 is the most significant
//   steps-reversed        sinusoids are shifted the other way
//   frame-missing         one frame was not photographed, and all photos behind it are one early
//   frame-doubled         one photo too many, and all photos behind it are one late
//   projectors-exchanged  photos of one projector stand under the name of another
//   other-projector       the code goes on beyond the resolution
//   mirrored              the picture is seen as in a mirror
//   gamma-encoded         photos are not linear light
//   jpeg                  photos were compressed with loss
struct Finding {
  std::string name;
  // Evidence. Shares of pixels that fit their neighbours, as given and if it were so; mirrored: share of places, and
  // how many of them; gamma-encoded: exponent assumed and found; jpeg: steps inside blocks and across their borders,
  // relative to the former.
  double as_given = 0, if_so = 0;
  std::string sentence;  // names the thing, its value and the remedy
};

struct Suspect {
  std::string camera, projector;
  const Correspondence* decoded = nullptr;  // what the decoder gave; nullptr where it refused
  std::string response = "linear";          // the camera's, as the rig states it
  bool photos_too = true;                   // look for gamma and JPEG: once per camera is enough
};

// Findings, most telling first. The photos themselves (gamma-encoded, jpeg), the handedness of what was decoded, and a
// held-out picture where there are several projectors, are always looked at: five photos at most. Only where the
// decoder refused, or little of what is lit fits its neighbours (reads_poorly), or the picture is mirrored, is every
// photo of the projector read once more, in up to 48 places, and each edit of the sequence that would be a likely
// mistake is decoded there. An edit is named when half of these pixels fit then and 15 % more than as given: with less,
// edges and indirect light leave too few pixels that could tell. Nothing is repaired.
std::vector<Finding> diagnose(const Sequence& sequence, const PhotoSource& photos, const Suspect& suspect);

// On one axis, less than three quarters of the lit pixels were accepted, or of those, lie on one plane with the pixels
// around them.
bool reads_poorly(const Correspondence& decoded, const Sequence& sequence);

// The sentences, joined by blanks; empty where there are none.
std::string text_of(const std::vector<Finding>& findings);

}  // namespace countershade::capture
