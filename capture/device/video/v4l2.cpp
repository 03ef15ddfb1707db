#include "capture/device/video/v4l2.h"

#ifdef __linux__
#include <linux/videodev2.h>
#include <poll.h>
#include <sys/mman.h>
#endif

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <ctime>
#include <filesystem>
#include <optional>

#include "calib/base/check.h"
#include "capture/device/pixel_format.h"
#include "capture/device/video/photo_clock.h"
#include "capture/device/video/v4l2_node.h"

namespace countershade::capture {

namespace fs = std::filesystem;

#ifndef __linux__

bool has_v4l2() {
  return false;
}
std::vector<V4l2Camera> list_v4l2_cameras() {
  return {};
}
Result<std::unique_ptr<Camera>> open_v4l2_camera(const std::string& id, const std::string&, const V4l2Options&) {
  return error(ErrorCode::kUnsupported, "camera '{}': Video4Linux2 is of Linux alone; choose another backend", id);
}

#else

namespace {

constexpr int kBuffers = 4;
constexpr double kExposureTolerance = 0.01;  // what a camera may round an exposure by
constexpr int kSettle = 4;                   // photos after a change of exposure that may still be exposed as before

// The kernel's names of what pixel_format.h knows.
struct Name {
  std::uint32_t fourcc;
  const char* format;
};
constexpr Name kNames[] = {
    {V4L2_PIX_FMT_GREY, "Mono8"},        {V4L2_PIX_FMT_Y10, "Mono10"},        {V4L2_PIX_FMT_Y12, "Mono12"},
    {V4L2_PIX_FMT_Y14, "Mono14"},        {V4L2_PIX_FMT_Y16, "Mono16"},        {V4L2_PIX_FMT_SBGGR8, "BayerBG8"},
    {V4L2_PIX_FMT_SGBRG8, "BayerGB8"},   {V4L2_PIX_FMT_SGRBG8, "BayerGR8"},   {V4L2_PIX_FMT_SRGGB8, "BayerRG8"},
    {V4L2_PIX_FMT_SBGGR10, "BayerBG10"}, {V4L2_PIX_FMT_SGBRG10, "BayerGB10"}, {V4L2_PIX_FMT_SGRBG10, "BayerGR10"},
    {V4L2_PIX_FMT_SRGGB10, "BayerRG10"}, {V4L2_PIX_FMT_SBGGR12, "BayerBG12"}, {V4L2_PIX_FMT_SGBRG12, "BayerGB12"},
    {V4L2_PIX_FMT_SGRBG12, "BayerGR12"}, {V4L2_PIX_FMT_SRGGB12, "BayerRG12"}, {V4L2_PIX_FMT_SBGGR16, "BayerBG16"},
    {V4L2_PIX_FMT_SGBRG16, "BayerGB16"}, {V4L2_PIX_FMT_SGRBG16, "BayerGR16"}, {V4L2_PIX_FMT_SRGGB16, "BayerRG16"},
    {V4L2_PIX_FMT_RGB24, "RGB8"},        {V4L2_PIX_FMT_BGR24, "BGR8"},        {V4L2_PIX_FMT_YUYV, "YUYV"},
    {V4L2_PIX_FMT_MJPEG, "JPEG"},
};

std::string spelled(std::uint32_t fourcc) {
  std::string text(4, ' ');
  for (int i = 0; i < 4; ++i) text[i] = static_cast<char>(fourcc >> 8 * i & 0x7f);
  return text;
}

double monotonic_s() {
  timespec now{};
  clock_gettime(CLOCK_MONOTONIC, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

struct Mapping {
  void* start = MAP_FAILED;
  std::size_t size = 0;
  Mapping(void* s, std::size_t n) : start(s), size(n) {}
  Mapping(Mapping&& other) noexcept : start(std::exchange(other.start, MAP_FAILED)), size(other.size) {}
  Mapping& operator=(Mapping&&) = delete;
  ~Mapping() {
    if (start != MAP_FAILED) ::munmap(start, size);
  }
};

std::vector<std::uint32_t> offered_formats(const V4l2Node& node) {
  std::vector<std::uint32_t> all;
  v4l2_fmtdesc format{};
  format.type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
  for (format.index = 0; node.call(VIDIOC_ENUM_FMT, &format) == 0; ++format.index) all.push_back(format.pixelformat);
  return all;
}

struct Found {
  V4l2Camera camera;
  V4l2Node node;
};

// Nodes that stream pictures, or that may not be asked whether they do.
std::vector<Found> found_cameras() {
  std::vector<Found> all;
  for (const std::string& path : device_files("/dev/video")) {
    V4l2Node node(path);
    if (!node.is_open()) {
      if (errno != ENODEV && errno != ENXIO)
        all.push_back({{path, "a video device", "", {}, hindrance_of(path, errno)}, V4l2Node()});
      continue;
    }
    v4l2_capability what{};
    if (node.call(VIDIOC_QUERYCAP, &what) != 0) continue;
    const std::uint32_t able = what.capabilities & V4L2_CAP_DEVICE_CAPS ? what.device_caps : what.capabilities;
    if (!(able & V4L2_CAP_VIDEO_CAPTURE) || !(able & V4L2_CAP_STREAMING)) continue;
    V4l2Camera camera{
        path, reinterpret_cast<const char*>(what.card), reinterpret_cast<const char*>(what.bus_info), {}, ""};
    for (const std::uint32_t format : offered_formats(node)) camera.formats.push_back(spelled(format));
    all.push_back({std::move(camera), std::move(node)});
  }
  return all;
}

class OpenCamera final : public Camera {
 public:
  OpenCamera(std::string id, V4l2Node node, const V4l2Options& options)
      : id_(std::move(id)), options_(options), node_(std::move(node)) {}
  ~OpenCamera() override { stop(); }

  const std::string& id() const override { return id_; }
  Result<void> set_up();
  Result<void> arm(double exposure_ms) override;
  Result<Exposure> trigger() override;

 private:
  Error failed(const std::string& what, int number) const { return v4l2_error(id_, what, number); }
  Result<void> choose_format();
  std::array<std::uint32_t, 2> largest_size(std::uint32_t fourcc) const;
  Result<void> set_exposure(double exposure_ms);
  Result<void> start();
  void stop();
  Result<void> give(std::uint32_t index);
  Result<std::optional<v4l2_buffer>> take(double until_s);
  Result<std::optional<Exposure>> take_whole();
  Result<Image> read_out(const v4l2_buffer& buffer) const;

  std::string id_;
  V4l2Options options_;
  V4l2Node node_;
  v4l2_pix_format picture_{};
  PixelFormat format_;
  std::vector<Mapping> buffers_;
  double exposure_ms_ = 0;
  int unsettled_ = 0;  // photos to come that may be exposed as before
  bool armed_ = false, came_ = false, streaming_ = false;
  PhotoClock clock_;
  int lost_ = 0;  // photos since trigger() that did not arrive whole
  std::uint64_t photos_ = 0;
};

// ---- what the camera is set to ----

std::array<std::uint32_t, 2> OpenCamera::largest_size(std::uint32_t fourcc) const {
  std::array<std::uint32_t, 2> largest{0, 0};
  v4l2_frmsizeenum size{};
  size.pixel_format = fourcc;
  for (size.index = 0; node_.call(VIDIOC_ENUM_FRAMESIZES, &size) == 0; ++size.index) {
    const bool discrete = size.type == V4L2_FRMSIZE_TYPE_DISCRETE;
    const std::array<std::uint32_t, 2> one{discrete ? size.discrete.width : size.stepwise.max_width,
                                           discrete ? size.discrete.height : size.stepwise.max_height};
    if (std::uint64_t{one[0]} * one[1] > std::uint64_t{largest[0]} * largest[1]) largest = one;
    if (!discrete) break;
  }
  return largest;
}

Result<void> OpenCamera::choose_format() {
  std::vector<std::string> known, offered;
  for (const std::uint32_t fourcc : offered_formats(node_)) {
    offered.push_back("'" + spelled(fourcc) + "'");
    for (const Name& n : kNames)
      if (n.fourcc == fourcc) known.push_back(n.format);
  }
  const auto best = best_format(known);
  if (!best)
    return error(ErrorCode::kUnsupported,
                 "camera '{}' offers the pixel formats {}, of which this program reads none; it reads grey of 8 to 16 "
                 "bits, Bayer of 8 to 16, RGB, YUYV and MJPEG",
                 id_, fmt::join(offered, ", "));
  format_ = *best;
  const auto named = [&](const Name& n) { return n.format == best->name; };
  const std::uint32_t fourcc = std::find_if(std::begin(kNames), std::end(kNames), named)->fourcc;
  v4l2_format wish{};
  wish.type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
  if (const int number = node_.call(VIDIOC_G_FMT, &wish); number != 0) return failed("its format", number);
  const std::array<std::uint32_t, 2> size = largest_size(fourcc);
  if (size[0] > 0) wish.fmt.pix.width = size[0], wish.fmt.pix.height = size[1];
  wish.fmt.pix.pixelformat = fourcc;
  wish.fmt.pix.field = V4L2_FIELD_NONE;
  wish.fmt.pix.bytesperline = wish.fmt.pix.sizeimage = 0;
  if (const int number = node_.call(VIDIOC_S_FMT, &wish); number != 0)
    return failed(fmt::format("format '{}'", spelled(fourcc)), number);
  picture_ = wish.fmt.pix;
  if (picture_.pixelformat != fourcc)
    return error(ErrorCode::kDevice, "camera '{}': format '{}' was asked for, '{}' reads back", id_, spelled(fourcc),
                 spelled(picture_.pixelformat));
  if (picture_.width == 0 || picture_.height == 0 || picture_.width > 32768 || picture_.height > 32768)
    return error(ErrorCode::kDevice, "camera '{}': it says that its pictures are {} x {} pixels", id_, picture_.width,
                 picture_.height);
  return {};
}

Result<void> OpenCamera::set_up() {
  CS_TRY_VOID(choose_format());
  return node_.lock(id_);
}

Result<void> OpenCamera::set_exposure(double exposure_ms) {
  const auto query = node_.control(V4L2_CID_EXPOSURE_ABSOLUTE);  // tenths of a millisecond
  if (!query)
    return error(ErrorCode::kUnsupported,
                 "camera '{}' cannot be told its exposure in milliseconds: leave exposures_ms out of the rig, and set "
                 "the exposure by `v4l2-ctl`",
                 id_);
  if (10 * exposure_ms < query->least || 10 * exposure_ms > query->most)
    return error(ErrorCode::kBadValue,
                 "camera '{}': exposures_ms = {} is outside what it can do, {} to {} ms; correct the rig", id_,
                 exposure_ms, query->least / 10.0, query->most / 10.0);
  return node_.hold(id_, V4L2_CID_EXPOSURE_ABSOLUTE, static_cast<int>(std::lround(10 * exposure_ms)));
}

Result<void> OpenCamera::arm(double exposure_ms) {
  if (!(exposure_ms >= 0) || !std::isfinite(exposure_ms))
    return error(ErrorCode::kBadValue, "camera '{}': an exposure of {} ms is none; give 0 (the camera's own) or more",
                 id_, exposure_ms);
  if (exposure_ms > 0) CS_TRY_VOID(set_exposure(exposure_ms));
  const double now = node_.exposure_ms().value_or(0);
  if (exposure_ms > 0 && std::abs(now - exposure_ms) > kExposureTolerance * exposure_ms)
    return error(
        ErrorCode::kDevice,
        "camera '{}': an exposure of {} ms was asked for, the nearest that it can do is {} ms; write that into "
        "the rig",
        id_, exposure_ms, now);
  if (now != exposure_ms_) unsettled_ = kSettle;
  exposure_ms_ = now;
  if (!streaming_) CS_TRY_VOID(start());
  armed_ = true;
  return {};
}

// ---- photos ----

Result<void> OpenCamera::give(std::uint32_t index) {
  v4l2_buffer buffer{};
  buffer.type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
  buffer.memory = V4L2_MEMORY_MMAP;
  buffer.index = index;
  if (const int number = node_.call(VIDIOC_QBUF, &buffer); number != 0) return failed("a buffer", number);
  return {};
}

Result<void> OpenCamera::start() {
  v4l2_requestbuffers request{};
  request.count = kBuffers;
  request.type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
  request.memory = V4L2_MEMORY_MMAP;
  if (const int number = node_.call(VIDIOC_REQBUFS, &request); number != 0)
    return failed("no memory for its pictures", number);
  for (std::uint32_t i = 0; i < request.count; ++i) {
    v4l2_buffer buffer{};
    buffer.type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
    buffer.memory = V4L2_MEMORY_MMAP;
    buffer.index = i;
    if (const int number = node_.call(VIDIOC_QUERYBUF, &buffer); number != 0) return failed("a buffer", number);
    void* start = ::mmap(nullptr, buffer.length, PROT_READ, MAP_SHARED, node_.file(), buffer.m.offset);
    if (start == MAP_FAILED) return failed("its memory cannot be mapped", errno);
    buffers_.emplace_back(start, buffer.length);
    CS_TRY_VOID(give(i));
  }
  int type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
  if (const int number = node_.call(VIDIOC_STREAMON, &type); number != 0) return failed("it does not start", number);
  streaming_ = true;
  return {};
}

void OpenCamera::stop() {
  if (!streaming_) return;
  int type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
  node_.call(VIDIOC_STREAMOFF, &type);
  streaming_ = false;
}

// The next photo; none where none comes in time. `until_s` in the past: only one that waits already.
Result<std::optional<v4l2_buffer>> OpenCamera::take(double until_s) {
  for (;;) {
    v4l2_buffer buffer{};
    buffer.type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
    buffer.memory = V4L2_MEMORY_MMAP;
    const int number = node_.call(VIDIOC_DQBUF, &buffer);
    if (number == 0) {
      if (buffer.index >= buffers_.size()) return failed("it gives a buffer that it does not have", EPROTO);
      return std::optional(buffer);
    }
    if (number != EAGAIN) return failed("no photo", number);
    const double left_s = until_s - monotonic_s();
    if (left_s <= 0) return std::optional<v4l2_buffer>();
    pollfd wait{node_.file(), POLLIN, 0};
    ::poll(&wait, 1, static_cast<int>(std::min(1e3 * left_s + 1, 1e4)));
    if (wait.revents & (POLLERR | POLLNVAL | POLLHUP)) return failed("no photo", ENODEV);
  }
}

Result<Image> OpenCamera::read_out(const v4l2_buffer& buffer) const {
  const int width = static_cast<int>(picture_.width), height = static_cast<int>(picture_.height);
  const auto* from = static_cast<const std::byte*>(buffers_[buffer.index].start);
  const std::size_t size = std::min<std::size_t>(buffer.bytesused, buffers_[buffer.index].size);
  return unpack(format_, std::span(from, size), width, height, picture_.bytesperline);
}

// One photo that was begun after now; none where it did not come, or not whole.
Result<std::optional<Exposure>> OpenCamera::take_whole() {
  for (;;) {  // what waits is of the past
    CS_TRY(const std::optional<v4l2_buffer> old, take(0));
    if (!old) break;
    CS_TRY_VOID(give(old->index));
  }
  clock_.ask(monotonic_s());
  std::uint32_t former = 0;
  for (int seen = 0;; ++seen) {
    const double until_s = monotonic_s() + options_.timeout_s + 1e-3 * exposure_ms_;
    CS_TRY(const std::optional<v4l2_buffer> taken, take(until_s));
    came_ = taken.has_value();
    if (!came_) return std::optional<Exposure>();
    // Drivers keep what came short to themselves; the numbers tell.
    if (seen > 0 && taken->sequence > former) lost_ += static_cast<int>(taken->sequence - former - 1);
    former = taken->sequence;
    const double time_s =
        static_cast<double>(taken->timestamp.tv_sec) + 1e-6 * static_cast<double>(taken->timestamp.tv_usec);
    const bool monotonic = (taken->flags & V4L2_BUF_FLAG_TIMESTAMP_MASK) == V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC;
    if (clock_.of_before(time_s, monotonic, monotonic_s(), 1e-3 * exposure_ms_) || seen < unsettled_) {
      CS_TRY_VOID(give(taken->index));
      continue;
    }
    unsettled_ = 0;
    std::optional<Result<Image>> values;
    if (!(taken->flags & V4L2_BUF_FLAG_ERROR)) values = read_out(*taken);
    CS_TRY_VOID(give(taken->index));
    if (!values || !*values) {
      ++lost_;
      return std::optional<Exposure>();
    }
    Exposure e;
    e.values = std::move(**values);
    e.full_scale = format_.full_scale();
    e.exposure_ms = exposure_ms_;
    e.timestamp_s = time_s - 1e-3 * exposure_ms_;
    e.counter = photos_++;
    e.saturated = saturated_share(e.values, e.full_scale);
    return std::optional<Exposure>(std::move(e));
  }
}

Result<Exposure> OpenCamera::trigger() {
  CS_CHECK(armed_, "camera '" + id_ + "' is triggered before it is armed");
  lost_ = 0;
  for (int i = 0; i < options_.tries; ++i) {
    CS_TRY(std::optional<Exposure> whole, take_whole());
    if (!whole) continue;
    whole->lost = lost_;
    return std::move(*whole);
  }
  if (!came_)
    return error(ErrorCode::kDevice,
                 "camera '{}' sends no photo within {:.1f} s, {} times: unplug it and plug it in again; a hub without "
                 "power of its own, or several cameras on one, may be too slow",
                 id_, options_.timeout_s + exposure_ms_ / 1e3, options_.tries);
  return error(ErrorCode::kDevice,
               "camera '{}': every photo came with an error or too short, {} times: another cable or socket, fewer "
               "devices on its hub",
               id_, options_.tries);
}

}  // namespace

bool has_v4l2() {
  return true;
}

std::vector<V4l2Camera> list_v4l2_cameras() {
  std::vector<V4l2Camera> cameras;
  for (Found& f : found_cameras()) cameras.push_back(std::move(f.camera));
  return cameras;
}

Result<std::unique_ptr<Camera>> open_v4l2_camera(const std::string& id, const std::string& device,
                                                 const V4l2Options& options) {
  std::vector<Found> all = found_cameras();
  std::error_code ignored;
  const std::string node = device.starts_with("/") ? fs::weakly_canonical(device, ignored).string() : device;
  std::vector<Found*> matching;
  std::string found;
  for (Found& f : all) {
    if (device.empty() || node == f.camera.device || device == f.camera.name || device == f.camera.bus)
      matching.push_back(&f);
    found += fmt::format("{}'{}' ({})", found.empty() ? "" : ", ", f.camera.device, f.camera.name);
  }
  if (all.empty())
    return error(ErrorCode::kDevice,
                 "camera '{}': this computer has no video device. Is the camera plugged in? `lsusb` shows whether USB "
                 "sees it; of a virtual machine or a container: is it handed in?",
                 id);
  if (matching.empty())
    return error(ErrorCode::kDevice, "camera '{}': no video device is called '{}'; there is {}", id, device, found);
  if (matching.size() > 1)
    return error(ErrorCode::kBadValue, "camera '{}': device = \"{}\" fits several cameras; name one of {}", id, device,
                 found);
  if (!matching[0]->camera.hindrance.empty())
    return error(ErrorCode::kDevice, "camera '{}': {}", id, matching[0]->camera.hindrance);
  auto open = std::make_unique<OpenCamera>(id, std::move(matching[0]->node), options);
  CS_TRY_VOID(open->set_up());
  return std::unique_ptr<Camera>(std::move(open));
}

#endif

}  // namespace countershade::capture
