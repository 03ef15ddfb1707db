#include "tests/device/usb_device.h"

#include <arpa/inet.h>
#include <fmt/format.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <sstream>

#include "calib/base/check.h"

namespace countershade::testing {

namespace {

constexpr const char* kHub = "/sys/devices/platform/vhci_hcd.0";
constexpr std::size_t kLargest = 4u << 20;  // bytes of one transfer
constexpr std::uint32_t kSubmit = 1, kUnlink = 2, kSubmitted = 3, kUnlinked = 4;

bool send_all(int socket, const void* data, std::size_t size) {
  for (auto* at = static_cast<const char*>(data); size > 0;) {
    const ssize_t n = ::send(socket, at, size, MSG_NOSIGNAL);
    if (n <= 0 && errno != EINTR) return false;
    if (n > 0) at += n, size -= static_cast<std::size_t>(n);
  }
  return true;
}

bool receive_all(int socket, void* data, std::size_t size) {
  for (auto* at = static_cast<char*>(data); size > 0;) {
    const ssize_t n = ::recv(socket, at, size, MSG_WAITALL);
    if (n == 0 || (n < 0 && errno != EINTR)) return false;
    if (n > 0) at += n, size -= static_cast<std::size_t>(n);
  }
  return true;
}

// A port of the virtual hub that nothing is plugged into; -1 = none.
int free_port() {
  std::ifstream status(std::string(kHub) + "/status");
  for (std::string line; std::getline(status, line);) {
    std::istringstream fields(line);
    std::string hub;
    int port = -1, state = -1;
    if (fields >> hub >> port >> state && hub == "hs" && state == 4) return port;
  }
  return -1;
}

}  // namespace

void add_number(Bytes& to, std::uint64_t value, int bytes) {
  for (int i = 0; i < bytes; ++i) to.push_back(static_cast<std::uint8_t>(value >> 8 * i));
}

UsbDevice::~UsbDevice() {
  CS_CHECK(!thread_.joinable(), "a device is unplugged before it goes");
}

std::string UsbDevice::plug_in() {
  if (access(kHub, F_OK) != 0) return "no module vhci_hcd here (tools/test --devices runs this in a virtual machine)";
  const int port = free_port();
  if (port < 0) return "vhci_hcd has no free port";
  int pair[2];
  if (socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, pair) != 0) return std::strerror(errno);
  descriptors_ = descriptors();
  socket_ = pair[0];
  thread_ = std::thread([this] { serve(); });
  {
    // Port, socket, bus and number of a device that it says it is, high speed. The kernel keeps the socket.
    std::ofstream attach(std::string(kHub) + "/attach");
    attach << fmt::format("{} {} {} {}", port, pair[1], 0x10002, 3) << std::flush;
    if (!attach) return close(pair[1]), unplug(), "vhci_hcd does not take the device (root?)";
  }
  close(pair[1]);
  return "";
}

void UsbDevice::unplug() {
  stop_ = true;
  if (socket_ >= 0) shutdown(socket_, SHUT_RDWR);
  if (thread_.joinable()) thread_.join();
  if (socket_ >= 0) close(std::exchange(socket_, -1));
}

bool UsbDevice::reply(std::uint32_t command, std::uint32_t number, int status, std::span<const std::uint8_t> data,
                      std::size_t length) {
  std::array<std::uint32_t, 12> header{};
  header[0] = htonl(command), header[1] = htonl(number), header[5] = htonl(static_cast<std::uint32_t>(status));
  header[6] = htonl(static_cast<std::uint32_t>(length));
  return send_all(socket_, header.data(), sizeof header) && send_all(socket_, data.data(), data.size());
}

// USB 2.0, section 9.4.
std::optional<Bytes> UsbDevice::standard(const UsbSetup& s) const {
  switch (s.request) {
    case 0:  // status
      return Bytes{0, 0};
    case 1:
    case 3:
    case 9:
    case 11:  // clear and set feature, set configuration, set interface
      return Bytes{};
    case 8:  // configuration
      return Bytes{1};
    case 10:  // interface
      return Bytes{0};
    case 6:
      break;
    default:
      return std::nullopt;
  }
  const unsigned kind = s.value >> 8, number = s.value & 0xff;
  if (kind == 1) return descriptors_.device;
  if (kind == 2) return descriptors_.configuration;
  if (kind != 3 || number > descriptors_.strings.size()) return std::nullopt;
  if (number == 0) return Bytes{4, 3, 0x09, 0x04};  // English
  Bytes text{0, 3};
  for (const char c : descriptors_.strings[number - 1]) add_number(text, static_cast<std::uint8_t>(c), 2);
  text[0] = static_cast<std::uint8_t>(text.size());
  return text;
}

bool UsbDevice::read_request() {
  std::array<std::uint32_t, 12> h{};
  if (!receive_all(socket_, h.data(), sizeof h)) return false;
  const std::uint32_t command = ntohl(h[0]), number = ntohl(h[1]);
  const bool in = ntohl(h[3]) != 0;
  const int endpoint = static_cast<int>(ntohl(h[4]));
  const std::size_t length = ntohl(h[6]);
  if (command == kUnlink) {
    const std::size_t before = waiting_.size();
    waiting_.remove_if([&](const Waiting& w) { return w.number == ntohl(h[5]); });
    return reply(kUnlinked, number, waiting_.size() < before ? -ECONNRESET : 0, {}, 0);
  }
  if (command != kSubmit || length > kLargest) return false;
  Bytes data(in ? 0 : length);
  if (!receive_all(socket_, data.data(), data.size())) return false;
  if (in && endpoint != 0) {
    waiting_.push_back({number, endpoint, length});
    return true;
  }
  if (endpoint != 0) return reply(kSubmitted, number, received(endpoint, data) ? 0 : -EPIPE, {}, length);
  const auto* s = reinterpret_cast<const std::uint8_t*>(&h[10]);
  const auto word = [&](int at) { return static_cast<std::uint16_t>(s[at] | s[at + 1] << 8); };
  const UsbSetup setup{s[0], s[1], word(2), word(4), word(6)};
  std::optional<Bytes> answer = (s[0] & 0x60) == 0 ? standard(setup) : control(setup, data);
  if (!answer) return reply(kSubmitted, number, -EPIPE, {}, 0);
  if (!in) return reply(kSubmitted, number, 0, {}, length);
  answer->resize(std::min(answer->size(), length));
  return reply(kSubmitted, number, 0, *answer, answer->size());
}

// The oldest first; one that must wait holds up no other endpoint.
bool UsbDevice::answer_waiting() {
  for (auto w = waiting_.begin(); w != waiting_.end();) {
    const std::optional<Bytes> data = send(w->endpoint, w->room);
    if (!data) {
      ++w;
      continue;
    }
    if (!reply(kSubmitted, w->number, 0, *data, data->size())) return false;
    w = waiting_.erase(w);
  }
  return true;
}

void UsbDevice::serve() {
  while (!stop_) {
    pollfd request{socket_, POLLIN, 0};
    if (poll(&request, 1, waiting_.empty() ? 50 : 1) < 0 && errno != EINTR) return;
    if (request.revents != 0 && !read_request()) return;
    if (!answer_waiting()) return;
  }
}

}  // namespace countershade::testing
