// Which photos of a camera that cannot be triggered were begun after somebody asked for one.
#pragma once

#include <optional>

namespace countershade::capture {

// By the wall clock's time at which the first packet of a photo came, which is an exposure or more after it was begun,
// never earlier; and since cameras hold photos back, some that look new are passed over. All times in seconds.
class FreeRun {
 public:
  // From now on photos are old until one was begun after this; `held`: that may be inside the camera.
  void ask(double wall, double monotonic, int held);
  // Of a photo whose first packet came at `came` by the wall clock: when it was begun, by the monotonic clock; none
  // where it may be old. Where somebody has set the wall clock meanwhile, the question is put again.
  std::optional<double> begun(double came, double exposure, double wall, double monotonic);

 private:
  double asked_ = 0, offset_ = 0;  // by the wall clock; wall clock less monotonic clock
  int held_ = 0, left_ = 0;
};

}  // namespace countershade::capture
