#include "capture/device/device.h"

#include <algorithm>
#include <chrono>
#include <thread>

namespace countershade::capture {

Result<void> Projector::show_stereo(const Picture&, const Picture&) {
  return error(ErrorCode::kUnsupported, "projector '{}' shows one picture to both eyes; show each eye's by itself",
               id());
}

Projector* Devices::projector(const std::string& id) const {
  for (const auto& p : projectors)
    if (p->id() == id) return p.get();
  return nullptr;
}

double Devices::refresh_ms() const {
  double longest = 0;
  for (const auto& p : projectors)
    if (p->refresh_hz() > 0) longest = std::max(longest, 1e3 / p->refresh_hz());
  return longest > 0 ? longest : 1e3 / 60;
}

void Devices::wait(double ms) const {
  if (!(ms > 0)) return;
  if (clock)
    clock(ms);
  else
    std::this_thread::sleep_for(std::chrono::duration<double, std::milli>(ms));
}

}  // namespace countershade::capture
