// Decoded pixels judged by frames that decoding has not seen.
#pragma once

#include <vector>

#include "capture/pattern/decode.h"

namespace countershade::capture {

// How many accepted pixels of a projector a pair of complementary block patterns (role `blocks`) contradicts.
struct CodeAudit {
  std::size_t judged = 0;  // pixels lit by this projector alone, two pixels and more away from the border of a block,
                           // whose pair of photos clearly differs
  std::size_t contradicted = 0;  // the block that lights them is not the one that their code says
  // Share of wrong codes: half of them land in a block of the right colour, so twice the contradicted.
  double wrong() const { return judged ? 2.0 * static_cast<double>(contradicted) / static_cast<double>(judged) : 0; }
};

// For every entry of `decoded` (of one camera). Nothing where the sequence has no pair of blocks. Errors: those of
// photos.
Result<std::vector<CodeAudit>> audit_codes(const Sequence& sequence, const PhotoSource& photos,
                                           const std::vector<Correspondence>& decoded);

}  // namespace countershade::capture
