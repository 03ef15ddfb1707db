// A display without a monitor, whose picture is a file.
#pragma once

#include <sys/types.h>

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace countershade::testing {

// Starts Xvfb with one screen of width x height; ends it with the scope.
class XvfbDisplay {
 public:
  XvfbDisplay(const std::filesystem::path& folder, int width, int height);
  ~XvfbDisplay();
  XvfbDisplay(const XvfbDisplay&) = delete;
  XvfbDisplay& operator=(const XvfbDisplay&) = delete;

  bool running() const { return !name_.empty(); }  // false: Xvfb is not installed here
  std::string name() const { return ":" + name_; }
  // (width, height) pixels from (left, 0), RGB.
  std::vector<std::uint8_t> pixels(int width, int height, int left = 0) const;
  // As somebody who clicks on the cross of the window with this title; whether there is one.
  bool close_window(const std::string& title) const;

 private:
  std::filesystem::path file_;
  pid_t server_ = -1;
  std::string name_;
};

}  // namespace countershade::testing
