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

// Time from the first photo's start until the picture was there; 0 where the first photo shows all of it. A photo that
// shows a part of the change tells when it came within its exposure: after (1 - share) of it. Several that do, as of
// projectors that are not equally late, tell no more than that it was there when the first whole one began.
double appeared_after_ms(std::span<const StepPhoto> photos);

}  // namespace countershade::capture
