#include "capture/session/latency.h"

#include <cstddef>

namespace countershade::capture {

double appeared_after_ms(std::span<const StepPhoto> photos) {
  std::size_t whole = photos.size();
  while (whole > 0 && photos[whole - 1].share > kWholeChange) --whole;
  if (whole == 0 || whole == photos.size()) return 0;
  const StepPhoto& before = photos[whole - 1];
  const bool inside = before.share > 1 - kWholeChange && (whole == 1 || photos[whole - 2].share < 1 - kWholeChange);
  return (inside ? before.from_ms + (1 - before.share) * before.exposure_ms : photos[whole].from_ms) -
         photos.front().from_ms;
}

}  // namespace countershade::capture
