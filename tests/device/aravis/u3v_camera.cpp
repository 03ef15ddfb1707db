#include "tests/device/aravis/u3v_camera.h"

#include <unistd.h>

#include <algorithm>

#include "calib/base/check.h"
#include "capture/device/pixel_format.h"
#include "tests/device/aravis/genicam.h"

namespace countershade::testing {

namespace {

// One register space, little-endian. Technology-agnostic registers (ABRM) lie at 0; they say where the others are.
// kUsb: technology registers (SBRM); kStream: of the stream interface (SIRM); kManifest: of descriptions.
constexpr std::uint32_t kGenCp = 0x0, kVendor = 0x4, kModel = 0x44, kDeviceVersion = 0xc4, kSerial = 0x144,
                        kResponseMs = 0x1cc, kManifestAt = 0x1d0, kUsbAt = 0x1d8, kUsb = 0x2000, kStream = 0x3000,
                        kManifest = 0x4000, kFeatures = 0x10000, kXml = 0x20000, kSpace = 0x30000;
constexpr std::size_t kLargest = 1024, kLeader = 52, kTrailer = 32;  // bytes
constexpr std::uint32_t kControlMagic = 0x43563355, kLeaderMagic = 0x4c563355, kTrailerMagic = 0x54563355;
constexpr unsigned kRead = 0x0800, kWrite = 0x0802, kBadAddress = 0x8003, kUnknown = 0x8001;

std::uint64_t number_at(const Bytes& bytes, std::size_t at, int count) {
  std::uint64_t value = 0;
  for (int i = 0; i < count; ++i) value |= static_cast<std::uint64_t>(bytes.at(at + i)) << 8 * i;
  return value;
}

}  // namespace

U3vCamera::U3vCamera(U3vOptions options, Photograph photograph)
    : options_(std::move(options)), photograph_(std::move(photograph)), space_(kSpace) {
  const std::string xml =
      genicam_description({options_.width, options_.height, options_.formats}, {"U3V", "LittleEndian", kFeatures});
  CS_CHECK(xml.size() < kSpace - kXml, "the description fits");
  set(kGenCp, 0x00010000), set(kResponseMs, 500), set(kManifestAt, kManifest, 8), set(kUsbAt, kUsb, 8);
  text(kVendor, "Countershade"), text(kModel, "RoomCamera"), text(kDeviceVersion, "1"), text(kSerial, options_.serial);
  set(kUsb, 0x00010000), set(kUsb + 4, 1);  // a stream interface
  set(kUsb + 0x14, kLargest), set(kUsb + 0x18, kLargest), set(kUsb + 0x1c, 1);
  set(kUsb + 0x20, kStream, 8), set(kUsb + 0x28, 0x30);
  set(kManifest, 1, 8), set(kManifest + 8, 0x01000000), set(kManifest + 12, 0x01010000);
  set(kManifest + 16, kXml, 8), set(kManifest + 24, xml.size(), 8);
  text(kXml, xml);
  for (const auto& [at, value] :
       {std::pair(kWidth, options_.width), {kHeight, options_.height}, {kExposure, 20000}, {kExposureAuto, 1}})
    set(kFeatures + at, static_cast<std::uint32_t>(value));
  for (const capture::PixelFormat& f : capture::pixel_formats())
    if (f.name == options_.formats[0]) set(kFeatures + kFormat, f.code);
  received(0, {});
}

U3vCamera::~U3vCamera() {
  unplug();
}

std::uint32_t U3vCamera::get(std::uint32_t at) const {
  return static_cast<std::uint32_t>(number_at(space_, at, 4));
}

void U3vCamera::set(std::uint32_t at, std::uint64_t value, int bytes) {
  for (int i = 0; i < bytes; ++i) space_.at(at + i) = static_cast<std::uint8_t>(value >> 8 * i);
}

void U3vCamera::text(std::uint32_t at, const std::string& value) {
  std::copy(value.begin(), value.end(), space_.begin() + at);
}

std::size_t U3vCamera::photo_size() const {
  return capture::pixel_format(get(kFeatures + kFormat))->bytes(options_.width, options_.height);
}

// A command: magic, flags, number, length, id (2 bytes each), then an address and what belongs to it.
bool U3vCamera::received(int endpoint, const Bytes& data) {
  if (endpoint == 1 && data.size() >= 20 && number_at(data, 0, 4) == kControlMagic) {
    const auto command = static_cast<unsigned>(number_at(data, 6, 2));
    const std::uint64_t address = number_at(data, 12, 8);
    unsigned status = 0;
    Bytes body;
    if (command == kRead && data.size() >= 24) {
      const std::uint64_t size = number_at(data, 22, 2);
      if (size > kLargest - 12 || address + size > kSpace)
        status = kBadAddress;
      else
        body.assign(space_.begin() + static_cast<std::ptrdiff_t>(address),
                    space_.begin() + static_cast<std::ptrdiff_t>(address + size));
    } else if (command == kWrite) {
      const std::uint64_t size = number_at(data, 8, 2) - 8;
      if (data.size() < 20 + size || address + size > kXml)
        status = kBadAddress;
      else
        std::copy_n(data.begin() + 20, size, space_.begin() + static_cast<std::ptrdiff_t>(address));
      add_number(body, 0, 2), add_number(body, size, 2);
    } else {
      status = kUnknown;
    }
    answer_.clear();
    add_number(answer_, kControlMagic, 4);
    add_number(answer_, status, 2), add_number(answer_, command | 1, 2), add_number(answer_, body.size(), 2);
    add_number(answer_, number_at(data, 10, 2), 2);
    answer_.insert(answer_.end(), body.begin(), body.end());
  } else if (endpoint == 1) {
    return false;
  }
  // What the host reads before it chooses its transfers.
  set(kStream + 0x08, photo_size(), 8), set(kStream + 0x10, kLeader), set(kStream + 0x14, kTrailer);
  return true;
}

void U3vCamera::photograph() {
  const double exposure_us = get(kFeatures + kExposure);
  usleep(static_cast<useconds_t>(exposure_us));
  const capture::PixelFormat format = *capture::pixel_format(get(kFeatures + kFormat));
  photo_.clear();
  for (const std::uint16_t v : photograph_(exposure_us / 1e3))
    add_number(photo_, v >> (16 - format.bits), format.packing == capture::Packing::kWords ? 2 : 1);
  ++photos_;
  if (options_.cut_every > 0 && photos_ % options_.cut_every == 0) photo_.resize(photo_.size() / 2);
  sent_ = 0;
}

Bytes U3vCamera::leader() const {
  Bytes b;
  add_number(b, kLeaderMagic, 4), add_number(b, 0, 2), add_number(b, kLeader, 2), add_number(b, block_, 8);
  add_number(b, 0, 2), add_number(b, 1, 2);  // an image
  add_number(
      b,
      static_cast<std::uint64_t>(std::chrono::nanoseconds(std::chrono::steady_clock::now().time_since_epoch()).count()),
      8);
  add_number(b, get(kFeatures + kFormat), 4), add_number(b, options_.width, 4), add_number(b, options_.height, 4);
  b.resize(kLeader);
  return b;
}

Bytes U3vCamera::trailer() const {
  Bytes b;
  add_number(b, kTrailerMagic, 4), add_number(b, 0, 2), add_number(b, kTrailer, 2), add_number(b, block_, 8);
  add_number(b, 0, 2), add_number(b, 0, 2), add_number(b, photo_.size(), 8), add_number(b, options_.height, 4);
  b.resize(kTrailer);
  return b;
}

std::optional<Bytes> U3vCamera::send(int endpoint, std::size_t room) {
  if (endpoint == 1) {
    if (answer_.empty()) return std::nullopt;
    answer_.resize(std::min(answer_.size(), room));
    return std::exchange(answer_, {});
  }
  if (endpoint != 2 || !(get(kStream + 4) & 1)) return std::nullopt;
  if (stage_ == kWaiting) {
    if (!get(kFeatures + kRun) || !get(kFeatures + kTrigger) || room < kLeader) return std::nullopt;
    set(kFeatures + kTrigger, 0);
    photograph();
    stage_ = kPixels;
    return leader();
  }
  if (stage_ == kPixels) {
    const std::size_t size = std::min(room, photo_.size() - sent_);
    Bytes piece(photo_.begin() + static_cast<std::ptrdiff_t>(sent_),
                photo_.begin() + static_cast<std::ptrdiff_t>(sent_ + size));
    sent_ += size;
    if (sent_ == photo_.size()) stage_ = kEnd;
    return piece;
  }
  Bytes end = trailer();
  ++block_;
  stage_ = kWaiting;
  return end;
}

// USB3 Vision 1.0, chapter 3: an association of two vendor-class interfaces, and what says that it is a camera.
UsbDescriptors U3vCamera::descriptors() const {
  Bytes all = {9, 2, 0, 0, 2, 1, 0, 0x80, 250};
  for (const Bytes& more :
       {Bytes{8, 11, 0, 2, 0xef, 5, 0, 0}, Bytes{9, 4, 0, 0, 2, 0xef, 5, 0, 0},
        Bytes{20, 0x24, 1, 0, 0, 1, 0, 0, 0, 1, 0, 4, 1, 2, 0, 0, 0, 3, 0, 0x08},  // GUID is string 4
        Bytes{7, 5, 0x81, 2, 0x00, 0x02, 0}, Bytes{7, 5, 0x01, 2, 0x00, 0x02, 0}, Bytes{9, 4, 1, 0, 1, 0xef, 5, 2, 0},
        Bytes{7, 5, 0x82, 2, 0x00, 0x02, 0}})
    all.insert(all.end(), more.begin(), more.end());
  all[2] = static_cast<std::uint8_t>(all.size());
  return {{18, 1, 0x00, 0x02, 0xef, 2, 1, 64, 0x09, 0x12, 0x13, 0x00, 0x00, 0x01, 1, 2, 3, 1},
          all,
          {"Countershade", "RoomCamera", options_.serial, "120900130001"}};
}

}  // namespace countershade::testing
