// Sinusoids: which projector coordinate has these values in these frames.
#pragma once

#include <vector>

#include "capture/pattern/read/levels.h"
#include "capture/pattern/read/refine.h"

namespace countershade::capture {

// chi^2 by which the best way to unwrap a phase must beat the next: odds of 1 to 8000.
constexpr double kClearOdds = 18;

// What the photos of one axis say of all its pixels together.
struct WaveModel {
  // A pixel that sees projector coordinate q has the light O + A b (cos t + h2 cos 2t + h3 cos 3t), t = 2 pi q / period
  // + shift. The harmonics are what an unknown response adds to a sinusoid. Blur of the projector and the camera takes
  // more off shorter periods: b = exp(-2 pi^2 blur / period^2), relative to the shortest, and so for the harmonics;
  // blur is a variance [projector px^2].
  double h2 = 0, h3 = 0, blur = 0;
  NoiseModel noise;  // of one photo's mean of channels
};

// The photos of one axis, in the order of AxisCode::waves: means of channels, linear. skip: 1 = not read.
struct WavePhotos {
  std::vector<Image> light;
  Mask skip;
};

// Which periods can be unwrapped by which. Error: kRefused when no period has three different shifts, or the periods
// repeat together within the axis and nothing else says which time round it is.
Result<void> check_waves(const AxisCode& code, const std::string& projector, const char* axis);

// Fits the wave model to the pixels that the pattern modulates most (up to 20000): harmonics from what the residuals of
// the single pixels have in common, noise from what they have not. Needs more frames than the three unknowns of a
// pixel; `noise` is taken as it is otherwise.
WaveModel fit_wave_model(const AxisCode& code, const WavePhotos& photos, const Image* coarse, const NoiseModel& noise);

// Maximum likelihood per pixel. One period of three or more shifts (the shortest) gives offset, amplitude and phase;
// all that could unwrap the phase are tried against the other frames, which have the same offset and, but for blur,
// amplitude as long as all periods are short against what indirect light resolves (micro phase shifting, Gupta & Nayar
// 2012). Periods beyond twice the shortest, with three shifts of their own, keep their own offset and amplitude and
// help to unwrap only (indirect light turns their phase; PHYSICS 8). `coarse` [projector px, NaN = says nothing] is
// what a Gray code read, if there is one.
//
// In the reading: q; sigma from the Fisher information of the frames, widened by what the residuals have more than
// noise; reason kDark (no modulation beyond noise, or below dark_fraction of its 99th percentile), kIndirect (lit, but
// less than 2 % of the light is modulated), kPhase (the frames contradict each other), kUncertainBit (two ways to
// unwrap are as likely; `other` holds the second).
struct PhaseReading {
  AxisReading reading;
  Image other;  // projector px; NaN where no second way to unwrap is likely
};
PhaseReading read_phase(const AxisCode& code, const WavePhotos& photos, const WaveModel& model, const Image* coarse,
                        const DecodeOptions& options);

}  // namespace countershade::capture
