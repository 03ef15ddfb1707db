#include "capture/device/video/photo_clock.h"

#include <utility>

namespace countershade::capture {

namespace {
constexpr int kInFlight = 2;      // photos that may be under way
constexpr int kMostDropped = 60;  // photos that say that they are of before: more, and it is another clock
}  // namespace

bool PhotoClock::of_before(double time, bool same_clock, double arrived, double exposure) {
  const double former = std::exchange(former_, time);
  const int seen = seen_++;
  if (!same_clock || time > arrived || time <= former || seen >= kMostDropped) believed_ = false;
  return believed_ && exposure > 0 ? time - exposure < asked_ : seen < kInFlight;
}

}  // namespace countershade::capture
