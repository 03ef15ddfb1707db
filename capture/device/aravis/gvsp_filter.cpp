#include "capture/device/aravis/gvsp_filter.h"

#include <arpa/inet.h>
#include <linux/filter.h>
#include <sys/socket.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cstring>
#include <filesystem>
#include <vector>

#include "calib/base/check.h"

namespace countershade::capture {

namespace {

constexpr std::uint32_t kUdp = 8, kIpAndUdp = 28;  // bytes of headers; a filter sees those of UDP
constexpr int kReceiveBuffer = 16 << 20;           // bytes: several photos

// A program of the kernel's packet filter (classic BPF), put together with jumps to its two ends.
class FilterProgram {
 public:
  void load(std::uint16_t size, std::uint32_t at) { add(BPF_LD | size | BPF_ABS, at); }
  void load_length() { add(BPF_LD | BPF_W | BPF_LEN, 0); }
  void load_id() { add(BPF_LD | BPF_MEM, 0); }
  void store_id() { add(BPF_ST, 0); }
  void mask(std::uint32_t bits) { add(BPF_ALU | BPF_AND | BPF_K, bits); }
  void require(std::uint16_t test, std::uint32_t value) { jump(test, value, 0, kDrop); }
  void drop_if(std::uint16_t test, std::uint32_t value) { jump(test, value, kDrop, 0); }
  void accept_if(std::uint16_t test, std::uint32_t value) { jump(test, value, kAccept, 0); }
  void accept() { add(BPF_RET | BPF_K, 0xffffffff); }
  // What follows, up to the label's end, is passed over unless the test holds.
  std::size_t begin_if(std::uint16_t test, std::uint32_t value) {
    jump(test, value, 0, 0);
    return program_.size() - 1;
  }
  void end_if(std::size_t begun) { program_[begun].jf = offset(begun, program_.size()); }
  std::vector<sock_filter> finished() {
    const std::size_t drop = program_.size();
    add(BPF_RET | BPF_K, 0);
    const std::size_t take = program_.size();
    accept();
    for (std::size_t i = 0; i < drop; ++i) {
      if (program_[i].jt == kAccept) program_[i].jt = offset(i, take);
      if (program_[i].jt == kDrop) program_[i].jt = offset(i, drop);
      if (program_[i].jf == kDrop) program_[i].jf = offset(i, drop);
    }
    return program_;
  }

 private:
  static constexpr std::uint8_t kAccept = 254, kDrop = 255;  // until they are known
  static std::uint8_t offset(std::size_t from, std::size_t to) {
    CS_CHECK(to - from - 1 < kAccept, "the filter is short");
    return static_cast<std::uint8_t>(to - from - 1);
  }
  void add(std::uint16_t code, std::uint32_t k) { program_.push_back({code, 0, 0, k}); }
  void jump(std::uint16_t test, std::uint32_t value, std::uint8_t yes, std::uint8_t no) {
    program_.push_back({static_cast<std::uint16_t>(BPF_JMP | test | BPF_K), yes, no, value});
  }
  std::vector<sock_filter> program_;
};

constexpr std::uint32_t kLeader = 1, kTrailer = 2, kPayload = 3;
constexpr std::uint32_t kImageLeader = 36, kImage = 1;  // bytes behind its header; the payload type

// Not a packet, but the camera's word that it has that packet no more. The packet's number is in the accumulator then.
void accept_news(FilterProgram& p) {
  p.load(BPF_H, kUdp);
  p.mask(0x8000);
  p.accept_if(BPF_JEQ, 0x8000);
  p.load_id();
}

// Packets whose header has so many bytes; the packet's number is in the accumulator.
void check_packets(FilterProgram& p, const StreamShape& shape, std::uint32_t header) {
  const std::uint32_t full = shape.packet_size - kIpAndUdp - header;
  const std::uint32_t least = (shape.image_bytes + full - 1) / full, most = (shape.payload_bytes + full - 1) / full;
  p.store_id();
  p.drop_if(BPF_JGT, most + 1);
  p.load(BPF_B, kUdp + 4);
  p.mask(0xf);
  const std::size_t payload = p.begin_if(BPF_JEQ, kPayload);
  p.load_id();
  p.require(BPF_JGE, 1);
  p.drop_if(BPF_JGT, most);
  p.accept_if(BPF_JGT, least);
  accept_news(p);
  const std::size_t last = p.begin_if(BPF_JEQ, least);
  p.load_length();
  p.require(BPF_JGE, kUdp + header + shape.image_bytes - (least - 1) * full);
  p.accept();
  p.end_if(last);
  p.load_length();
  p.require(BPF_JGE, kUdp + header + full);
  p.accept();
  p.end_if(payload);
  const std::size_t leader = p.begin_if(BPF_JEQ, kLeader);
  p.load_id();
  p.require(BPF_JEQ, 0);
  accept_news(p);
  p.load_length();
  p.require(BPF_JGE, kUdp + header + kImageLeader);
  p.load(BPF_H, kUdp + header + 2);
  p.mask(0x3fff);  // chunks may follow the picture
  p.require(BPF_JEQ, kImage);
  p.accept();
  p.end_if(leader);
  p.require(BPF_JEQ, kTrailer);
  p.load_id();
  p.require(BPF_JGT, least);
  p.accept();
}

std::vector<sock_filter> filter_of(const StreamShape& shape) {
  constexpr std::uint32_t kHeader = 8, kLongHeader = 20;  // the latter has block ids of 64 bits
  FilterProgram p;
  p.load_length();
  p.require(BPF_JGE, kUdp + kHeader);
  p.load(BPF_B, kUdp + 4);
  const std::size_t extended = p.begin_if(BPF_JGE, 0x80);
  p.load_length();
  p.require(BPF_JGE, kUdp + kLongHeader);
  p.load(BPF_W, kUdp + 16);
  check_packets(p, shape, kLongHeader);
  p.end_if(extended);
  p.load(BPF_W, kUdp + 4);
  p.mask(0xffffff);
  check_packets(p, shape, kHeader);
  return p.finished();
}

// This process's UDP sockets on that port. Aravis does not hand its own out.
std::vector<int> sockets_on(int port) {
  std::vector<int> found;
  std::error_code reason;
  for (const auto& entry : std::filesystem::directory_iterator("/proc/self/fd", reason)) {
    const std::string name = entry.path().filename();
    int fd = -1, type = 0;
    if (std::from_chars(name.data(), name.data() + name.size(), fd).ec != std::errc()) continue;
    sockaddr_in here{};
    socklen_t size = sizeof here, type_size = sizeof type;
    if (getsockname(fd, reinterpret_cast<sockaddr*>(&here), &size) != 0 || here.sin_family != AF_INET) continue;
    if (getsockopt(fd, SOL_SOCKET, SO_TYPE, &type, &type_size) != 0 || type != SOCK_DGRAM) continue;
    if (ntohs(here.sin_port) == port) found.push_back(fd);
  }
  return found;
}

}  // namespace

Result<void> filter_stream(const StreamShape& shape) {
  CS_CHECK(shape.packet_size > 64 && shape.image_bytes > 0 && shape.payload_bytes >= shape.image_bytes,
           "a photo of whole packets");
  std::vector<sock_filter> program = filter_of(shape);
  const sock_fprog attached{static_cast<unsigned short>(program.size()), program.data()};
  const std::vector<int> sockets = sockets_on(shape.port);
  if (sockets.empty())
    return error(ErrorCode::kDevice, "the socket of its stream, UDP port {}, is not found in /proc/self/fd",
                 shape.port);
  for (const int fd : sockets) {
    if (setsockopt(fd, SOL_SOCKET, SO_ATTACH_FILTER, &attached, sizeof attached) != 0)
      return error(ErrorCode::kDevice, "the kernel takes no packet filter for its stream: {}", std::strerror(errno));
    if (setsockopt(fd, SOL_SOCKET, SO_RCVBUFFORCE, &kReceiveBuffer, sizeof kReceiveBuffer) != 0)
      setsockopt(fd, SOL_SOCKET, SO_RCVBUF, &kReceiveBuffer, sizeof kReceiveBuffer);  // as much as this user may
  }
  return {};
}

}  // namespace countershade::capture
