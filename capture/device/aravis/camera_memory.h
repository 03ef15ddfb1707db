// Memory of a GigE camera that nobody has opened.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace countershade::capture {

// Reads by GigE Vision's READMEM_CMD (2.0, 16.5), which cameras answer whoever has them.
class CameraMemory {
 public:
  explicit CameraMemory(const std::string& address);
  CameraMemory(const CameraMemory&) = delete;
  CameraMemory& operator=(const CameraMemory&) = delete;
  ~CameraMemory();

  // `size` bytes from `at` on; empty where the camera does not answer, after a second and a half.
  std::vector<std::uint8_t> read(std::uint32_t at, std::uint32_t size);

 private:
  std::vector<std::uint8_t> block(std::uint32_t at, std::uint32_t count);

  int file_ = -1;
  std::uint16_t id_ = 0x7f00;
};

}  // namespace countershade::capture
