#include "capture/device/device.h"

namespace countershade::capture {

Projector* Devices::projector(const std::string& id) const {
  for (const auto& p : projectors)
    if (p->id() == id) return p.get();
  return nullptr;
}

}  // namespace countershade::capture
