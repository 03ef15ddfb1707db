#ifdef __linux__

#include "capture/device/video/v4l2_node.h"

#include <fcntl.h>
#include <linux/videodev2.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <utility>

namespace countershade::capture {

V4l2Node::V4l2Node(const std::string& path) : file_(::open(path.c_str(), O_RDWR | O_NONBLOCK | O_CLOEXEC)) {}
V4l2Node::V4l2Node(V4l2Node&& other) noexcept : file_(std::exchange(other.file_, -1)) {}
V4l2Node& V4l2Node::operator=(V4l2Node&& other) noexcept {
  std::swap(file_, other.file_);
  return *this;
}
V4l2Node::~V4l2Node() {
  if (is_open()) ::close(file_);
}

int V4l2Node::call(unsigned long request, void* argument) const {
  while (::ioctl(file_, request, argument) != 0)
    if (errno != EINTR) return errno;
  return 0;
}

std::optional<V4l2Node::Control> V4l2Node::control(std::uint32_t what) const {
  v4l2_queryctrl query{};
  query.id = what;
  if (call(VIDIOC_QUERYCTRL, &query) != 0) return std::nullopt;
  if (query.flags & (V4L2_CTRL_FLAG_DISABLED | V4L2_CTRL_FLAG_READ_ONLY)) return std::nullopt;
  return Control{reinterpret_cast<const char*>(query.name), query.minimum, query.maximum};
}

std::optional<int> V4l2Node::read_back(std::uint32_t what) const {
  v4l2_control value{what, 0};
  if (call(VIDIOC_G_CTRL, &value) != 0) return std::nullopt;
  return value.value;
}

std::optional<double> V4l2Node::exposure_ms() const {
  const auto tenths = read_back(V4L2_CID_EXPOSURE_ABSOLUTE);
  return tenths ? std::optional(*tenths / 10.0) : std::nullopt;
}

Result<void> V4l2Node::hold(const std::string& id, std::uint32_t what, int value) const {
  const auto found = control(what);
  if (!found) return {};
  v4l2_control wish{what, std::clamp(value, found->least, found->most)};
  if (const int number = call(VIDIOC_S_CTRL, &wish); number != 0)
    return v4l2_error(id, fmt::format("'{}' cannot be set to {}", found->name, wish.value), number);
  const auto now = read_back(what);
  if (now == std::clamp(value, found->least, found->most)) return {};
  return error(ErrorCode::kDevice, "camera '{}': '{}' was set to {} and reads back {}; set it by `v4l2-ctl`", id,
               found->name, std::clamp(value, found->least, found->most), now ? std::to_string(*now) : "nothing");
}

Result<void> V4l2Node::lock(const std::string& id) const {
  struct Setting {
    std::uint32_t what;
    int value;
  };
  constexpr Setting kSettings[] = {
      {V4L2_CID_EXPOSURE_AUTO, V4L2_EXPOSURE_MANUAL},
      {V4L2_CID_EXPOSURE_AUTO_PRIORITY, 0},  // a frame rate that follows the light
      {V4L2_CID_AUTOGAIN, 0},
      {V4L2_CID_ISO_SENSITIVITY_AUTO, V4L2_ISO_SENSITIVITY_MANUAL},
      {V4L2_CID_AUTO_WHITE_BALANCE, 0},
      {V4L2_CID_AUTOBRIGHTNESS, 0},
      {V4L2_CID_HUE_AUTO, 0},
      {V4L2_CID_FOCUS_AUTO, 0},
      {V4L2_CID_CHROMA_AGC, 0},
      {V4L2_CID_WIDE_DYNAMIC_RANGE, 0},
      {V4L2_CID_IMAGE_STABILIZATION, 0},
      {V4L2_CID_BACKLIGHT_COMPENSATION, 0},
      {V4L2_CID_POWER_LINE_FREQUENCY, V4L2_CID_POWER_LINE_FREQUENCY_DISABLED},
      {V4L2_CID_SHARPNESS, 0},
  };
  for (const Setting& s : kSettings) CS_TRY_VOID(hold(id, s.what, s.value));
  if (const auto gamma = control(V4L2_CID_GAMMA); gamma && gamma->most >= 100)
    CS_TRY_VOID(hold(id, V4L2_CID_GAMMA, 100));  // hundredths, of USB cameras
  return {};
}

Error v4l2_error(const std::string& id, const std::string& what, int number) {
  if (number == ENODEV) return error(ErrorCode::kDevice, "camera '{}' is gone; is it plugged in and powered?", id);
  return error(ErrorCode::kDevice, "camera '{}': {}: {}", id, what,
               number == EBUSY ? "another program has it; close it" : std::strerror(number));
}

std::vector<std::string> device_files(const std::string& prefix) {
  std::vector<std::string> paths;
  std::error_code ignored;
  for (const auto& entry : std::filesystem::directory_iterator("/dev", ignored))
    if (entry.path().string().starts_with(prefix)) paths.push_back(entry.path().string());
  std::sort(paths.begin(), paths.end(), [](const std::string& a, const std::string& b) {
    return a.size() != b.size() ? a.size() < b.size() : a < b;
  });
  return paths;
}

std::string hindrance_of(const std::string& path, int number) {
  if (number == EACCES || number == EPERM)
    return fmt::format(
        "'{}' may not be opened: add yourself to the group `video` (sudo usermod -aG video $USER), then "
        "log in again",
        path);
  if (number == EBUSY) return fmt::format("'{}' is in use by another program: close it", path);
  return fmt::format("'{}' cannot be opened: {}", path, std::strerror(number));
}

}  // namespace countershade::capture

#endif
