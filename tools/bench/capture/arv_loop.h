// Aravis' own client, as its examples have it: what a backend's speed is compared with.
#pragma once

#include <memory>
#include <string>

#include "calib/base/result.h"

namespace countershade::bench {

inline constexpr double kArvLoopExposureMs = 0.1;

// Asks a camera for photos by software trigger, in Mono8, with the packets that Aravis finds the largest.
class ArvLoop {
 public:
  virtual ~ArvLoop() = default;
  static Result<std::unique_ptr<ArvLoop>> open(const std::string& address);
  // Asks for one, waits for it, gives its memory back. False where it did not arrive whole.
  virtual Result<bool> photo() = 0;
};

}  // namespace countershade::bench
