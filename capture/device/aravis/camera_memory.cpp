#include "capture/device/aravis/camera_memory.h"

#include <arpa/inet.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>

namespace countershade::capture {

namespace {

constexpr std::uint32_t kBlock = 512;  // bytes that every camera gives at once
constexpr std::uint16_t kPort = 3956;

}  // namespace

CameraMemory::CameraMemory(const std::string& address) : file_(socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0)) {
  sockaddr_in camera{};
  camera.sin_family = AF_INET, camera.sin_port = htons(kPort);
  const bool reached = file_ >= 0 && inet_aton(address.c_str(), &camera.sin_addr) != 0 &&
                       connect(file_, reinterpret_cast<sockaddr*>(&camera), sizeof camera) == 0;
  if (reached || file_ < 0) return;
  close(file_);
  file_ = -1;
}

CameraMemory::~CameraMemory() {
  if (file_ >= 0) close(file_);
}

std::vector<std::uint8_t> CameraMemory::read(std::uint32_t at, std::uint32_t size) {
  std::vector<std::uint8_t> all;
  while (all.size() < size) {
    const auto had = static_cast<std::uint32_t>(all.size());
    const std::vector<std::uint8_t> part = block(at + had, std::min(kBlock, (size - had + 3) / 4 * 4));
    if (part.empty()) return {};
    all.insert(all.end(), part.begin(), part.end());
  }
  all.resize(size);
  return all;
}

std::vector<std::uint8_t> CameraMemory::block(std::uint32_t at, std::uint32_t count) {
  const auto byte = [](std::uint32_t value, int shift) { return static_cast<std::uint8_t>(value >> shift); };
  for (int i = 0; i < 3 && file_ >= 0; ++i) {
    const std::uint16_t id = ++id_ == 0 ? ++id_ : id_;
    const std::uint8_t question[16] = {0x42,
                                       1,
                                       0,
                                       0x84,
                                       0,
                                       8,
                                       byte(id, 8),
                                       byte(id, 0),
                                       byte(at, 24),
                                       byte(at, 16),
                                       byte(at, 8),
                                       byte(at, 0),
                                       0,
                                       0,
                                       byte(count, 8),
                                       byte(count, 0)};
    std::array<std::uint8_t, 1024> answer{};
    pollfd waiting{file_, POLLIN, 0};
    if (send(file_, question, sizeof question, 0) < 0) continue;
    const auto until = std::chrono::steady_clock::now() + std::chrono::milliseconds(500);
    while (true) {
      const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(until - std::chrono::steady_clock::now());
      if (left.count() <= 0 || poll(&waiting, 1, static_cast<int>(left.count())) <= 0) break;
      const ssize_t n = recv(file_, answer.data(), answer.size(), 0);
      if (n < 0) break;
      const bool ours = n >= 12 + static_cast<ssize_t>(count) && answer[3] == 0x85 && answer[6] == question[6] &&
                        answer[7] == question[7];
      if (ours) return {answer.begin() + 12, answer.begin() + 12 + count};
    }
  }
  return {};
}

}  // namespace countershade::capture
