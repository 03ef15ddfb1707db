// A disk that is soon full, or cannot be written.
#pragma once

#include <sys/mount.h>

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <string>

namespace countershade::testing {

// A file system of 64 KiB over a folder; ready() is false where this process may not mount.
class SmallDisk {
 public:
  explicit SmallDisk(const std::filesystem::path& folder) : folder_(folder) {
    std::filesystem::create_directories(folder);
    ready_ = ::mount("none", folder_.c_str(), "tmpfs", 0, "size=64k") == 0;
    if (!ready_) why_ = std::strerror(errno);
  }
  ~SmallDisk() {
    if (ready_) ::umount(folder_.c_str());
  }
  bool ready() const { return ready_; }
  const std::string& why() const { return why_; }
  bool make_read_only() { return ::mount("none", folder_.c_str(), "tmpfs", MS_REMOUNT | MS_RDONLY, "size=64k") == 0; }

 private:
  std::filesystem::path folder_;
  bool ready_ = false;
  std::string why_;
};

}  // namespace countershade::testing
