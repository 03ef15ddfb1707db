// Which code does this scene need? Judged by a few photos, before the code is shown.
#pragma once

#include <string>
#include <vector>

#include "capture/pattern/decode.h"

namespace countershade::capture {

// What a code is predicted to do on the pixels that the projector lights directly.
struct CodeForecast {
  std::string code;
  int frames = 0;       // on both axes, beside white, black and the three shifts that every code has
  double lost = 0;      // share of pixels that will not be decoded
  double sigma_px = 0;  // median random error of a coordinate [projector px]
  double bias_px = 0;   // mean pull of indirect light on what remains [projector px]
  bool good = false;    // below the bounds of ChoiceOptions
};

struct CodeChoice {
  std::string projector, code;
  std::vector<CodeForecast> forecasts;  // cheapest first
  double direct = 0;                    // median share of the light that is direct
  double noise = 0;                     // median noise of a pixel, as a share of the amplitude of its direct light
  std::string reason;                   // one sentence
};

struct ChoiceOptions {
  double most_lost = 0.01, most_sigma_px = 0.3, most_bias_px = 0.05;
};

// The cheaper of the two codes of short sinusoids (micro-phase, micro-phase-9) that is predicted to stay below the
// bounds; where none does, the one that loses less. Stripes are no candidates: the study `pre-scan` found no room where
// Gray or XOR codes keep more pixels, at three times the frames. `sequence` has the frames of base_roles. Per pixel,
// the three shifts give offset O and amplitude A of the finest sinusoid, the direct share is 2 A / (white - black), and
// noise comes from O of one axis against O of the other, which are the same light: a code unwraps a pixel where
// distance * A / sigma(O) exceeds what kClearOdds asks for (read_phase), distance being that of its closest two
// columns; sigma is from the Fisher information of its frames, and the mean bias grows with the period as PHYSICS 8 has
// it, times indirect over direct light. Errors: those of PhotoSource; kRefused where the projector modulates no pixel.
Result<CodeChoice> choose_code(const Sequence& sequence, const PhotoSource& photos, const std::string& projector,
                               const ChoiceOptions& options);

// As a table for people, and for programs.
std::string choice_text(const CodeChoice& choice);
std::string choices_json(const std::vector<CodeChoice>& choices);

}  // namespace countershade::capture
