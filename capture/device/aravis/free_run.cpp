#include "capture/device/aravis/free_run.h"

#include <cmath>

namespace countershade::capture {

namespace {
constexpr double kClockSet = 2e-3;  // that two clocks read one after the other may differ by, and have not been set
}  // namespace

void FreeRun::ask(double wall, double monotonic, int held) {
  asked_ = wall, offset_ = wall - monotonic;
  held_ = left_ = held;
}

std::optional<double> FreeRun::begun(double came, double exposure, double wall, double monotonic) {
  if (std::abs(wall - monotonic - offset_) > kClockSet) ask(wall, monotonic, held_);
  if (!(came - exposure > asked_ && came <= wall) || left_-- > 0) return std::nullopt;
  return came - exposure - offset_;
}

}  // namespace countershade::capture
