// Cameras that are watched: what cannot be a photo is refused, and what happened since it was opened is known.
#pragma once

#include <memory>

#include "capture/device/device.h"

namespace countershade::capture {

// Hands on what `camera` gives and keeps its health(). Error: kDevice where a photo has no pixels, or a value that is
// no number, below 0 or above full scale (which fractions of a file of floats may be).
std::unique_ptr<Camera> watched(std::unique_ptr<Camera> camera);

}  // namespace countershade::capture
