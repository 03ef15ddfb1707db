// An open /dev/video node and its settings, whoever takes the pictures from it: Video4Linux2 itself, or libcamera.
// Linux only.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "calib/base/result.h"

namespace countershade::capture {

class V4l2Node {
 public:
  V4l2Node() = default;
  // Opens it for reading and writing, without waiting; is_open() is false where that fails (errno says why).
  explicit V4l2Node(const std::string& path);
  V4l2Node(V4l2Node&& other) noexcept;
  V4l2Node& operator=(V4l2Node&& other) noexcept;
  ~V4l2Node();
  bool is_open() const { return file_ >= 0; }
  int file() const { return file_; }
  // An ioctl that a signal does not end; 0, or the error number.
  int call(unsigned long request, void* argument) const;

  struct Control {
    std::string name;
    int least, most;
  };
  // `what` is a V4L2_CID_...; none where the camera has no such setting, or none that can be used.
  std::optional<Control> control(std::uint32_t what) const;
  std::optional<int> read_back(std::uint32_t what) const;
  // The exposure that the driver reads back [ms]; none where it is not told in time.
  std::optional<double> exposure_ms() const;
  // Sets a value, within the control's bounds, where there is such a control. Errors (they name camera `id`): kDevice:
  // the driver refuses it, or reads back another value (names both).
  Result<void> hold(const std::string& id, std::uint32_t what, int value) const;
  // Switches off whatever changes by itself or bends the light: exposure, gain, white balance, focus and their
  // priorities, flicker filter, sharpening, backlight compensation, gamma. Errors as of hold().
  Result<void> lock(const std::string& id) const;

 private:
  int file_ = -1;
};

// That a call failed: the camera is gone, another program has it, or what the system says.
Error v4l2_error(const std::string& id, const std::string& what, int number);

// Paths that begin so ("/dev/video"), in the order of their numbers.
std::vector<std::string> device_files(const std::string& prefix);

// What hinders the opening of a device file, and the remedy.
std::string hindrance_of(const std::string& path, int number);

}  // namespace countershade::capture
