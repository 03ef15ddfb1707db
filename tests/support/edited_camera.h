// A camera whose photos somebody edits on their way: a driver that lies, a cable that is pulled.
#pragma once

#include <functional>
#include <memory>
#include <utility>

#include "capture/device/device.h"

namespace countershade::testing {

class EditedCamera final : public capture::Camera {
 public:
  // What becomes of the n-th photo that is asked for, from 0.
  using Edit = std::function<Result<capture::Exposure>(Result<capture::Exposure> taken, int n)>;
  EditedCamera(std::unique_ptr<capture::Camera> camera, Edit edit)
      : camera_(std::move(camera)), edit_(std::move(edit)) {}
  const std::string& id() const override { return camera_->id(); }
  Result<void> arm(double exposure_ms) override { return camera_->arm(exposure_ms); }
  Result<capture::Exposure> trigger() override { return edit_(camera_->trigger(), photos_++); }

 private:
  std::unique_ptr<capture::Camera> camera_;
  Edit edit_;
  int photos_ = 0;
};

}  // namespace countershade::testing
