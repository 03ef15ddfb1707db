#include "tests/device/aravis/gige_camera.h"

#include <arpa/inet.h>
#include <fmt/format.h>
#include <net/if.h>
#include <poll.h>
#include <pthread.h>
#include <sched.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <ctime>
#include <deque>
#include <optional>
#include <random>

#include "calib/base/check.h"
#include "capture/device/pixel_format.h"
#include "tests/device/aravis/genicam.h"

namespace countershade::testing {

namespace {

// Bootstrap registers of GigE Vision; those of genicam.h are ours.
enum Register : std::uint32_t {
  kVersion = 0x0,
  kMode = 0x4,
  kMacHigh = 0x8,
  kMacLow = 0xc,
  kAddress = 0x24,
  kMask = 0x34,
  kVendor = 0x48,
  kModel = 0x68,
  kDeviceVersion = 0x88,
  kSerial = 0xd8,
  kFirstUrl = 0x200,
  kChannels = 0x904,
  kCapabilities = 0x934,
  kHeartbeat = 0x938,
  kTickHigh = 0x93c,
  kTickLow = 0x940,
  kPrivilege = 0xa00,
  kStreamPort = 0xd00,
  kPacketSize = 0xd04,
  kStreamAddress = 0xd18,
};
constexpr std::uint32_t kXmlAt = 0x10000;
constexpr std::uint32_t kFireTest = 0x80000000;
constexpr int kHeaders = 28;  // of IP and UDP, which the packet size includes

void put16(std::uint8_t* to, unsigned v) {
  to[0] = static_cast<std::uint8_t>(v >> 8), to[1] = static_cast<std::uint8_t>(v);
}
void put32(std::uint8_t* to, std::uint32_t v) {
  put16(to, v >> 16), put16(to + 2, v & 0xffff);
}
unsigned get16(const std::uint8_t* from) {
  return static_cast<unsigned>(from[0]) << 8 | from[1];
}
std::uint32_t get32(const std::uint8_t* from) {
  return get16(from) << 16 | get16(from + 2);
}

}  // namespace

std::string enter_private_network() {
  if (unshare(CLONE_NEWNET) != 0 && unshare(CLONE_NEWUSER | CLONE_NEWNET) != 0)
    return fmt::format("no network of its own: {}", std::strerror(errno));
  const int any = socket(AF_INET, SOCK_DGRAM, 0);
  ifreq request{};
  std::strcpy(request.ifr_name, "lo");
  request.ifr_flags = IFF_UP | IFF_RUNNING | IFF_LOOPBACK;
  const bool up = ioctl(any, SIOCSIFFLAGS, &request) == 0;
  const std::string why = up ? "" : fmt::format("loopback does not come up: {}", std::strerror(errno));
  close(any);
  return why;
}

struct GigeCamera::State {
  GigeOptions options;
  Photograph photograph;
  std::vector<std::uint8_t> space;  // registers, then the description
  std::vector<std::uint8_t> photo;  // the latest, kept for resends
  unsigned block = 0, sent = 0;
  std::uint64_t taken_ns = 0;
  int control = -1, stream = -1;
  std::mt19937 random{20};
  std::deque<double> exposures;                 // that were set, the newest last [us]
  std::vector<std::vector<std::uint8_t>> held;  // packets that wait for the next photo
  struct Exposed {
    std::vector<std::uint8_t> photo;
    unsigned block = 0;
    std::uint64_t taken_ns = 0;
  };
  std::optional<Exposed> former;  // of a camera that runs freely: is sent when the next one is exposed

  std::uint32_t get(std::uint32_t at) const { return get32(space.data() + at); }
  void set(std::uint32_t at, std::uint32_t v) { put32(space.data() + at, v); }
  void text(std::uint32_t at, const std::string& value) { std::copy(value.begin(), value.end(), space.begin() + at); }
  std::size_t piece() const { return (get(kPacketSize) & 0xffff) - kHeaders - 8; }
  unsigned last_packet() const { return static_cast<unsigned>((photo.size() + piece() - 1) / piece()) + 1; }

  void start();
  bool has(GigeFault fault) const { return options.fault == fault; }
  bool lost(bool again);
  void send(const std::vector<std::uint8_t>& packet) const;
  std::vector<std::uint8_t> packet(unsigned id) const;
  void send_packet(unsigned id, bool again);
  void send_photo();
  void send_faults_before();
  void develop(const std::vector<std::uint16_t>& values);
  void write(std::uint32_t at, std::uint32_t value, std::atomic<int>& photos);
  void take(std::atomic<int>& photos);
};

void GigeCamera::State::start() {
  std::string xml = options.description;
  if (xml.empty())
    xml = genicam_description({options.width, options.height, options.formats, !options.runs_freely},
                              {"GEV", "BigEndian", 0});
  space.resize(kXmlAt + (xml.size() + 3) / 4 * 4);
  in_addr address{};
  inet_aton(options.address.c_str(), &address);
  set(kVersion, 0x00010002), set(kMode, 0x80000001), set(kMacHigh, 0x0242), set(kMacLow, 0x7f000001);
  set(kAddress, ntohl(address.s_addr)), set(kMask, 0xff000000);
  text(kVendor, "Countershade"), text(kModel, "RoomCamera"), text(kDeviceVersion, "1"), text(kSerial, options.serial);
  const std::size_t claimed = options.claimed_description > 0 ? options.claimed_description : xml.size();
  const char* file = xml.starts_with("PK") ? "room.zip" : "room.xml";
  const std::string blanks(options.blanks ? 4 : 0, ' ');
  text(kFirstUrl, fmt::format("Local:{0}{1};{0}{2:x};{0}{3:x}", blanks, file, kXmlAt, claimed)), text(kXmlAt, xml);
  set(kChannels, 1), set(kCapabilities, 0x7), set(kHeartbeat, 3000), set(kTickLow, 1000000000);
  set(kPacketSize, 1400), set(kWidth, options.width), set(kHeight, options.height);
  for (const capture::PixelFormat& f : capture::pixel_formats())
    if (f.name == options.formats[0]) set(kFormat, f.code);
  set(kExposure, 20000), set(kExposureAuto, 1), set(kTriggerSource, 0);
  control = socket(AF_INET, SOCK_DGRAM, 0), stream = socket(AF_INET, SOCK_DGRAM, 0);
  const int yes = 1;
  setsockopt(control, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
  sockaddr_in here{};
  here.sin_family = AF_INET, here.sin_port = htons(3956), here.sin_addr.s_addr = INADDR_ANY;
  CS_CHECK(bind(control, reinterpret_cast<sockaddr*>(&here), sizeof here) == 0, "GVCP's port is free");
}

void GigeCamera::State::send(const std::vector<std::uint8_t>& packet) const {
  sockaddr_in to{};
  to.sin_family = AF_INET, to.sin_port = htons(static_cast<std::uint16_t>(get(kStreamPort)));
  to.sin_addr.s_addr = htonl(get(kStreamAddress));
  sendto(stream, packet.data(), packet.size(), 0, reinterpret_cast<sockaddr*>(&to), sizeof to);
}

// Packet 0 is the leader, then the pixels, the last one is the trailer.
std::vector<std::uint8_t> GigeCamera::State::packet(unsigned id) const {
  std::vector<std::uint8_t> p(8);
  put16(p.data() + 2, block), put32(p.data() + 4, id);
  if (id == 0) {
    p.resize(has(GigeFault::kShortLeader) ? 8 : 44);
    p[4] = 1;
    if (p.size() < 44) return p;
    put16(p.data() + 10, has(GigeFault::kOtherPayload) ? 10 : 1);
    put32(p.data() + 12, static_cast<std::uint32_t>(taken_ns >> 32));
    put32(p.data() + 16, static_cast<std::uint32_t>(taken_ns));
    put32(p.data() + 20, get(kFormat)),
        put32(p.data() + 24, options.claimed_width > 0 ? options.claimed_width : get(kWidth)),
        put32(p.data() + 28, get(kHeight));
    if (has(GigeFault::kOtherPayload)) put16(p.data() + 8, 0xffff), put16(p.data() + 20, 0xffff);
  } else if (id == last_packet()) {
    p.resize(16);
    p[4] = 2;
    put16(p.data() + 10, 1), put32(p.data() + 12, get(kHeight));
  } else {
    const std::size_t at = (id - 1) * piece();
    std::size_t end = at + piece() + (has(GigeFault::kLongPackets) ? 400 : 0);
    p[4] = 3;
    if (has(GigeFault::kMovedPart) && id == 2) p[4] = 7, p.resize(16), end -= 8;  // and then: part 0, byte 0
    p.insert(p.end(), photo.begin() + static_cast<std::ptrdiff_t>(at),
             photo.begin() + static_cast<std::ptrdiff_t>(std::min(photo.size(), end)));
    if (has(GigeFault::kHalfPacket) && id == 2) p.resize(p.size() / 2);
  }
  return p;
}

bool GigeCamera::State::lost(bool again) {
  if (options.loss > 0 && std::uniform_real_distribution<double>()(random) < options.loss) return true;
  return !again && options.drop_every > 0 && ++sent % options.drop_every == 0;
}

void GigeCamera::State::send_packet(unsigned id, bool again) {
  if (lost(again) || (has(GigeFault::kNoTrailer) && id == last_packet())) return;
  if (has(GigeFault::kHoldsBack) && !again && block % 3 == 1)
    held.push_back(packet(id));
  else
    send(packet(id));
}

void GigeCamera::State::send_faults_before() {
  std::vector<std::uint8_t> p = packet(1);
  if (has(GigeFault::kTinyPackets))
    for (std::size_t size = 7; size > 0; --size) p.resize(size), send(p);
  if (has(GigeFault::kPacketBeyond))
    for (const unsigned id : {last_packet() + 1, last_packet() + 1000, 0xffffffu})
      put32(p.data() + 4, id), p[4] = 3, send(p);
  if (has(GigeFault::kFarBeyond))
    for (const auto& [kind, id] : {std::pair(4, 7u), {3, 100000u}, {2, 0u}, {3, 5000u}})
      put32(p.data() + 4, id), p[4] = static_cast<std::uint8_t>(kind), send(p);
}

void GigeCamera::State::send_photo() {
  for (const auto& p : std::exchange(held, {})) send(p);
  send_faults_before();
  for (unsigned i = 0; i <= last_packet(); ++i) {
    if (has(GigeFault::kNoData) && i > 0 && i < last_packet()) continue;
    if (has(GigeFault::kNoise)) {
      std::vector<std::uint8_t> p(random() % 1400);
      for (std::uint8_t& v : p) v = static_cast<std::uint8_t>(random());
      if (p.size() > 8) put16(p.data() + 2, block), p[4] &= 0x8f;  // of the photo, and of a kind that there is
      send(p);
    }
    send_packet(has(GigeFault::kBackwards) ? last_packet() - i : i, false);
    if (has(GigeFault::kMovedPart) && i == 2) {  // as many bytes as there should be
      std::vector<std::uint8_t> p = packet(i);
      put32(p.data() + 4, 0x0700ea60), p.resize(24), send(p);
    }
    if (has(GigeFault::kInterleaved) && i != 3) {  // the other one never comes whole
      std::vector<std::uint8_t> p = packet(i);
      put16(p.data() + 2, block + 1);
      std::fill(p.begin() + (i == 0 || i == last_packet() ? static_cast<std::ptrdiff_t>(p.size()) : 8), p.end(), 7);
      send(p);
    }
  }
}

void GigeCamera::State::develop(const std::vector<std::uint16_t>& values) {
  const capture::PixelFormat format = *capture::pixel_format(get(kFormat));
  const std::size_t count = static_cast<std::size_t>(options.width) * (options.height - options.lines_short);
  CS_CHECK(values.size() >= count, "a value for each pixel");
  const int shift = 16 - format.bits;
  if (format.packing != capture::Packing::kWords) {
    photo.resize(count);
    for (std::size_t i = 0; i < count; ++i) photo[i] = static_cast<std::uint8_t>(values[i] >> shift);
    return;
  }
  photo.resize(2 * count);
  for (std::size_t i = 0; i < count; ++i) {
    photo[2 * i] = static_cast<std::uint8_t>(values[i] >> shift);
    photo[2 * i + 1] = static_cast<std::uint8_t>(values[i] >> shift >> 8);
  }
}

void GigeCamera::State::take(std::atomic<int>& photos) {
  exposures.push_back(get(kExposure));
  while (static_cast<int>(exposures.size()) > options.obeys_after + 1) exposures.pop_front();
  const double exposure_us = exposures.front();
  usleep(static_cast<useconds_t>(exposure_us));
  ++photos;
  if (options.silent) return;
  if (!(options.repeats_frame && photos % 2 == 0)) {
    develop(photograph(exposure_us / 1e3));
    if (has(GigeFault::kBlockWraps) && photos == 1) block = 65533;
    unsigned step = has(GigeFault::kInterleaved) ? 2 : 1;
    if (has(GigeFault::kBlockJumps)) step = 30000;
    if (has(GigeFault::kBlockBack)) step = photos % 2 ? 200 : 65535 - 50;
    block = (block + step - 1) % 65535 + 1;  // 0 is left out
    taken_ns = static_cast<std::uint64_t>(
        std::chrono::nanoseconds(std::chrono::steady_clock::now().time_since_epoch()).count());
    if (has(GigeFault::kClockBack)) taken_ns -= 1000000000ull * photos;
    if (has(GigeFault::kClockAhead)) taken_ns |= 0x7full << 56;
  }
  if (!options.runs_freely) return send_photo();
  Exposed now{std::move(photo), block, taken_ns};
  if (former) {
    photo = std::move(former->photo), block = former->block, taken_ns = former->taken_ns;
    send_photo();
  }
  block = now.block;
  former = std::move(now);
}

void GigeCamera::State::write(std::uint32_t at, std::uint32_t value, std::atomic<int>& photos) {
  if (at >= kXmlAt - 4) return;
  if (at == kExposure && options.exposure_step_us > 0)
    value = static_cast<std::uint32_t>(std::max(1.0, std::round(value / options.exposure_step_us)) *
                                       options.exposure_step_us);
  if (at == kExposureAuto && options.automatic) value = 1;
  if (at == kPacketSize && value & kFireTest) {
    const int size = static_cast<int>(value & 0xffff);
    if (size <= options.largest_packet) send(std::vector<std::uint8_t>(size - kHeaders));
    value &= ~kFireTest;
  }
  set(at, value);
  if (at == kTrigger && value && get(kRun)) take(photos);
}

GigeCamera::GigeCamera(GigeOptions options, Photograph photograph) : state_(std::make_unique<State>()) {
  state_->options = std::move(options), state_->photograph = std::move(photograph);
  state_->start();
  thread_ = std::thread([this] { serve(); });
}

GigeCamera::~GigeCamera() {
  unplug();
}

void GigeCamera::unplug() {
  stop_ = true;
  if (thread_.joinable()) thread_.join();
  for (int* s : {&state_->control, &state_->stream})
    if (*s >= 0) close(*s), *s = -1;
}

double GigeCamera::cpu_s() const {
  clockid_t clock{};
  timespec used{};
  pthread_getcpuclockid(const_cast<std::thread&>(thread_).native_handle(), &clock);
  clock_gettime(clock, &used);
  return static_cast<double>(used.tv_sec) + 1e-9 * static_cast<double>(used.tv_nsec);
}

void GigeCamera::serve() {
  State& s = *state_;
  while (!stop_ && !(s.options.unplug_after > 0 && photos_ >= s.options.unplug_after)) {
    pollfd waiting{s.control, POLLIN, 0};
    const bool exposes = s.options.runs_freely && s.get(kRun);
    if (poll(&waiting, 1, exposes ? 0 : 20) <= 0) {
      if (exposes) s.take(photos_);
      continue;
    }
    std::uint8_t in[2048], out[2048] = {};
    sockaddr_in from{};
    socklen_t from_size = sizeof from;
    const ssize_t n = recvfrom(s.control, in, sizeof in, 0, reinterpret_cast<sockaddr*>(&from), &from_size);
    if (n < 8 || in[0] != 0x42) continue;
    const unsigned command = get16(in + 2), length = get16(in + 4);
    if (static_cast<ssize_t>(length) + 8 > n) continue;
    const std::uint8_t* data = in + 8;
    unsigned size = 0;
    std::vector<std::pair<std::uint32_t, std::uint32_t>> writes;
    switch (command) {
      case 0x0002:
        std::copy_n(s.space.begin(), size = 0xf8, out + 8);
        break;
      case 0x0080:
        for (; size + 4 <= length; size += 4) {
          const std::uint32_t at = get32(data + size);
          put32(out + 8 + size, at <= s.space.size() - 4 ? s.get(at) : 0);
        }
        break;
      case 0x0082:
        for (unsigned i = 0; i + 8 <= length; i += 8) writes.emplace_back(get32(data + i), get32(data + i + 4));
        size = 4, put16(out + 10, static_cast<unsigned>(writes.size()));
        break;
      case 0x0084: {
        const std::uint32_t at = get32(data), count = std::min(1000u, get16(data + 6));
        if (at + count <= s.space.size()) std::copy_n(s.space.begin() + at, count, out + 12), size = count + 4;
        put32(out + 8, at);
        break;
      }
      case 0x0086:
        for (unsigned i = 4; i + 4 <= length; i += 4) writes.emplace_back(get32(data) + i - 4, get32(data + i));
        size = 4, put16(out + 10, length - 4);
        break;
      case 0x0040:
        if (!s.options.deaf && get16(data + 2) == s.block)
          for (unsigned id = get32(data + 4) & 0xffffff; id <= std::min(get32(data + 8) & 0xffffff, s.last_packet());
               ++id)
            s.send_packet(id, true), ++resent_;
        continue;
      default:
        continue;
    }
    put16(out + 2, command + 1), put16(out + 4, size), put16(out + 6, get16(in + 6));
    // A trigger is acknowledged before the exposure; other settings count once they are acknowledged.
    const bool triggers = !writes.empty() && writes[0].first == kTrigger;
    if (!triggers)
      for (const auto& [at, value] : writes) s.write(at, value, photos_);
    sendto(s.control, out, size + 8, 0, reinterpret_cast<sockaddr*>(&from), from_size);
    if (triggers) s.write(kTrigger, writes[0].second, photos_);
  }
}

}  // namespace countershade::testing
