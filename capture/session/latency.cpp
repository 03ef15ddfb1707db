#include "capture/session/latency.h"

#include <algorithm>
#include <cstddef>

namespace countershade::capture {

Appearance appearance(std::span<const StepPhoto> photos) {
  std::size_t whole = photos.size();
  while (whole > 0 && photos[whole - 1].share > kWholeChange) --whole;
  if (whole == 0 || whole == photos.size()) return {};
  const StepPhoto& before = photos[whole - 1];
  const bool inside = before.share > 1 - kWholeChange && (whole == 1 || photos[whole - 2].share < 1 - kWholeChange);
  const double start = photos.front().from_ms;
  if (inside) {
    const double at = before.from_ms + (1 - before.share) * before.exposure_ms - start;
    return {at, at};
  }
  const bool between = before.share <= 1 - kWholeChange;
  return {before.from_ms + (between ? before.exposure_ms : 0) - start, photos[whole].from_ms - start};
}

double longest_ms(std::span<const Appearance> appearances) {
  double timed = 0, longest = 0;
  for (const Appearance& a : appearances)
    if (a.timed()) timed = std::max(timed, a.latest_ms);
  longest = timed;
  for (const Appearance& a : appearances)
    if (a.earliest_ms > timed) longest = std::max(longest, a.latest_ms);
  return longest;
}

}  // namespace countershade::capture
