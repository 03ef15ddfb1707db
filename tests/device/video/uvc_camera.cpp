#include "tests/device/video/uvc_camera.h"

#include <fcntl.h>
#include <linux/videodev2.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>

#include "calib/base/check.h"

namespace countershade::testing {

namespace {

constexpr std::uint8_t kCamera = 1, kProcessing = 2, kOutput = 3;  // units of the video function
constexpr std::uint8_t kSet = 0x01, kCurrent = 0x81, kLeast = 0x82, kMost = 0x83, kStep = 0x84, kLength = 0x85,
                       kInfo = 0x86, kPreset = 0x87;
constexpr std::size_t kPayload = 16384;  // bytes of a transfer with its header
constexpr std::size_t kProbeSize = 34;   // UVC 1.1, table 4-75
constexpr std::uint8_t kVideo = 14, kClass = 0x24;

struct Format {
  const char *name, *guid;
  int bits;
};
constexpr Format kFormats[] = {{"GREY", "Y800", 8}, {"Y16 ", "Y16 ", 16}, {"YUYV", "YUY2", 16}, {"BA81", "BA81", 8}};

const Format& format_named(const std::string& name) {
  for (const Format& f : kFormats)
    if (name == f.name) return f;
  CS_CHECK(false, "a format of the table");
  return kFormats[0];
}

void add(Bytes& to, const Bytes& more) {
  to.insert(to.end(), more.begin(), more.end());
}

void put(Bytes& in, std::size_t at, std::uint64_t value, int bytes) {
  Bytes number;
  add_number(number, value, bytes);
  std::copy(number.begin(), number.end(), in.begin() + static_cast<std::ptrdiff_t>(at));
}

}  // namespace

struct UvcCamera::Control {
  std::uint8_t unit, selector;
  int size;  // bytes
  std::int32_t least, most, step, preset, value;
};

namespace {
enum { kAutomatic, kExposure };  // the first two of the table below
}  // namespace

UvcCamera::UvcCamera(UvcOptions options, Photograph photograph)
    : options_(std::move(options)), photograph_(std::move(photograph)), probe_(kProbeSize), commit_(kProbeSize) {
  // As cheap webcams are after power-up: everything automatic, sharpened, bent.
  controls_ = {
      {kCamera, 0x02, 1, 0, 0, 0x01 | 0x08, 8, 8},         // exposure: 1 by hand, 8 automatic; "step": the set of both
      {kCamera, 0x04, 4, 1, 10000, 1, 100, 100},           // exposure [tenths of a millisecond]
      {kProcessing, 0x02, 2, -64, 64, 1, 0, 0},            // brightness
      {kProcessing, 0x05, 1, 0, 2, 1, 1, 1},               // flicker filter
      {kProcessing, 0x08, 2, 0, 6, 1, 3, 3},               // sharpness
      {kProcessing, 0x09, 2, 100, 300, 1, 220, 220},       // gamma [hundredths]
      {kProcessing, 0x0a, 2, 2800, 6500, 10, 4600, 4600},  // white balance [K]
      {kProcessing, 0x0b, 1, 0, 1, 1, 1, 1},               // automatic white balance
  };
  for (Bytes* block : {&probe_, &commit_}) (*block)[2] = (*block)[3] = 1;
}

UvcCamera::~UvcCamera() {
  unplug();
}

const std::string& UvcCamera::format() const {
  return options_.formats.at(commit_[2] - 1u);
}

// UVC 1.1, sections 3.6 to 3.9; uncompressed payload, appendix of it.
UsbDescriptors UvcCamera::descriptors() const {
  const auto interface = [](std::uint8_t number, std::uint8_t endpoints, std::uint8_t kind) {
    return Bytes{9, 4, number, 0, endpoints, kVideo, kind, 0, number == 0 ? std::uint8_t{2} : std::uint8_t{0}};
  };
  Bytes units;
  add(units, {18, kClass, 2, kCamera, 0x01, 0x02, 0, 0, 0, 0, 0, 0, 0, 0, 3, 0x0a, 0, 0});  // has exposure and its mode
  add(units, {12, kClass, 5, kProcessing, kCamera, 0, 0, 2, 0x71, 0x14, 0, 0});             // has the rest
  add(units, {9, kClass, 3, kOutput, 0x01, 0x01, 0, kProcessing, 0});
  Bytes header{13, kClass, 1, 0x10, 0x01};
  add_number(header, 13 + units.size(), 2);
  add_number(header, 6000000, 4);  // clock [Hz]
  add(header, {1, 1});

  Bytes formats;
  const auto interval = static_cast<std::uint64_t>(1e7 / options_.rate);
  for (std::size_t i = 0; i < options_.formats.size(); ++i) {
    const Format& f = format_named(options_.formats[i]);
    add(formats, {27, kClass, 4, static_cast<std::uint8_t>(i + 1), 1});
    for (int c = 0; c < 4; ++c) formats.push_back(static_cast<std::uint8_t>(f.guid[c]));
    add(formats, {0, 0, 0x10, 0, 0x80, 0, 0, 0xaa, 0, 0x38, 0x9b, 0x71});
    add(formats, {static_cast<std::uint8_t>(f.bits), 1, 0, 0, 0, 0});
    const std::uint64_t size = static_cast<std::uint64_t>(options_.width) * options_.height * f.bits / 8;
    add(formats, {30, kClass, 5, 1, 0});
    add_number(formats, options_.width, 2), add_number(formats, options_.height, 2);
    for (int k = 0; k < 2; ++k) add_number(formats, static_cast<std::uint64_t>(8 * options_.rate) * size, 4);
    add_number(formats, size, 4), add_number(formats, interval, 4);
    formats.push_back(1);
    add_number(formats, interval, 4);
    add(formats, {6, kClass, 0x0d, 1, 1, 4});
  }
  const auto count = static_cast<std::uint8_t>(options_.formats.size());
  Bytes stream{static_cast<std::uint8_t>(13 + count), kClass, 1, count};
  add_number(stream, stream[0] + formats.size(), 2);
  add(stream, {0x81, 0, kOutput, 0, 0, 0, 1});
  stream.resize(stream[0]);

  Bytes all{9, 2, 0, 0, 2, 1, 0, 0x80, 250};
  add(all, {8, 11, 0, 2, kVideo, 3, 0, 2});
  add(all, interface(0, 0, 1)), add(all, header), add(all, units);
  add(all, interface(1, 1, 2)), add(all, stream), add(all, formats);
  add(all, {7, 5, 0x81, 2, 0x00, 0x02, 0});
  put(all, 2, all.size(), 2);
  return {{18, 1, 0x00, 0x02, 0xef, 2, 1, 64, 0x09, 0x12, 0x11, 0x00, 0x00, 0x01, 1, 2, 3, 1},
          all,
          {"Countershade", "Room webcam", "ROOM1"}};
}

// Probe and commit: which format comes, in which pieces.
std::optional<Bytes> UvcCamera::stream_control(const UsbSetup& s, const Bytes& data) {
  const int selector = s.value >> 8;
  if (selector != 1 && selector != 2) return std::nullopt;
  Bytes& block = selector == 1 ? probe_ : commit_;
  if (s.request == kInfo) return Bytes{3};
  if (s.request == kLength) return Bytes{kProbeSize, 0};
  if (s.request != kSet) return block;
  std::copy_n(data.begin(), std::min(data.size(), block.size()), block.begin());
  if (block[2] < 1 || block[2] > options_.formats.size()) block[2] = 1;
  block[3] = 1;
  put(block, 4, static_cast<std::uint64_t>(1e7 / options_.rate), 4);
  put(block, 18,
      static_cast<std::uint64_t>(options_.width) * options_.height *
          format_named(options_.formats[block[2] - 1u]).bits / 8,
      4);
  put(block, 22, kPayload, 4), put(block, 26, 6000000, 4);
  if (selector == 2) streaming_ = true, photo_.clear(), sent_ = 0, next_ = Clock::now();
  return Bytes{};
}

std::optional<Bytes> UvcCamera::control(const UsbSetup& s, const Bytes& data) {
  if ((s.index & 0xff) == 1) return stream_control(s, data);
  for (Control& c : controls_) {
    if (c.unit != s.index >> 8 || c.selector != s.value >> 8) continue;
    const auto number = [&](std::int32_t value) {
      Bytes bytes;
      add_number(bytes, static_cast<std::uint32_t>(value), c.size);
      return bytes;
    };
    switch (s.request) {
      case kSet: {
        std::uint32_t bits = 0;
        for (std::size_t i = 0; i < std::min<std::size_t>(data.size(), 4); ++i) bits |= data[i] << 8 * i;
        const auto value = c.size == 2 ? static_cast<std::int16_t>(bits) : static_cast<std::int32_t>(bits);
        const bool mode = &c == &controls_[kAutomatic];
        if (mode ? value != 1 && value != 8 : value < c.least || value > c.most) return std::nullopt;
        c.value = value;
        if (&c == &controls_[kExposure] && value > options_.step) c.value -= value % options_.step;
        return Bytes{};
      }
      case kCurrent:
        return number(c.value);
      case kLeast:
        return number(c.least);
      case kMost:
        return number(c.most);
      case kStep:
        return number(c.step);
      case kPreset:
        return number(c.preset);
      case kLength:
        return Bytes{static_cast<std::uint8_t>(c.size), 0};
      case kInfo:
        return Bytes{3};
      default:
        return std::nullopt;
    }
  }
  return std::nullopt;
}

void UvcCamera::photograph() {
  // What is automatic wanders by itself.
  asked_.push_back(controls_[kAutomatic].value == 1 ? controls_[kExposure].value : 60 + 7 * (photos_ % 9));
  const std::size_t from = asked_.size() - 1 - std::min<std::size_t>(asked_.size() - 1, options_.delay);
  const double exposure_ms = options_.frozen_exposure ? 10 : asked_[from] / 10.0;
  const std::vector<std::uint16_t> values = photograph_(exposure_ms);
  photo_.clear();
  for (const std::uint16_t v : values) {
    if (format() == "Y16 ") photo_.push_back(static_cast<std::uint8_t>(v));
    photo_.push_back(static_cast<std::uint8_t>(v >> 8));
    if (format() == "YUYV") photo_.push_back(128);
  }
  ++photos_;
  if (options_.cut_of > 0 && (static_cast<unsigned>(photos_) * 2654435761u >> 16) % options_.cut_of == 0)
    photo_.resize(photo_.size() / 2);
  sent_ = 0;
  parity_ = !parity_;
}

// A transfer is a header of two bytes (bit 0: parity of the photo, bit 1: its last piece, bit 7) and pixels.
std::optional<Bytes> UvcCamera::send(int endpoint, std::size_t room) {
  if (endpoint != 1 || !streaming_) return std::nullopt;
  if (photo_.empty()) {
    const double period_s = std::max(1 / options_.rate, controls_[kExposure].value / 1e4);
    if (Clock::now() < next_ + std::chrono::duration<double>(period_s)) return std::nullopt;
    photograph();
    next_ = Clock::now();
  }
  const std::size_t pixels = std::min(std::min(room, kPayload) - 2, photo_.size() - sent_);
  const bool last = sent_ + pixels == photo_.size();
  Bytes piece{2, static_cast<std::uint8_t>(0x80 | (parity_ ? 1 : 0) | (last ? 2 : 0))};
  piece.insert(piece.end(), photo_.begin() + static_cast<std::ptrdiff_t>(sent_),
               photo_.begin() + static_cast<std::ptrdiff_t>(sent_ + pixels));
  sent_ += pixels;
  if (last) photo_.clear();
  return piece;
}

int read_back(const std::string& node, std::uint32_t what) {
  const int file = ::open(node.c_str(), O_RDWR);
  v4l2_control control{what, 0};
  const int failed = ioctl(file, VIDIOC_G_CTRL, &control);
  close(file);
  return failed ? -1 : control.value;
}

}  // namespace countershade::testing
