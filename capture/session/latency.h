// When a picture appears, from photos that were taken one after the other since it was shown.
#pragma once

#include <span>

namespace countershade::capture {

// Share of a change from which on a photo shows all of it.
inline constexpr double kWholeChange = 0.97;

struct StepPhoto {
  double from_ms = 0, exposure_ms = 0;  // by the camera's clock
  double share = 0;                     // of the change from the old picture to the new one, 0..1
};

// When, since the first photo's start: not before `earliest`, not after `latest`.
struct Appearance {
  double earliest_ms = 0, latest_ms = 0;
  bool timed() const { return latest_ms > 0 && earliest_ms == latest_ms; }
};

// Zeros where the first photo shows all of it. A photo that shows a part of the change times it within its exposure:
// after (1 - share) of it. Where none does, it came between two; several that do, as of projectors that are not equally
// late, tell no more than that it was there when the first whole one began.
Appearance appearance(std::span<const StepPhoto> photos);

// When pictures appear at the latest, from several of these. One that was not timed counts only where it came later
// than all that were: else it is one of them.
double longest_ms(std::span<const Appearance> appearances);

}  // namespace countershade::capture
