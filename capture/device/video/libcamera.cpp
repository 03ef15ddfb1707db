#include "capture/device/video/libcamera.h"

#ifdef COUNTERSHADE_LIBCAMERA
#include <libcamera/libcamera.h>
#include <libcamera/logging.h>
#include <linux/dma-buf.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#endif

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <condition_variable>
#include <cstdlib>
#include <cstring>
#include <deque>
#include <filesystem>
#include <mutex>
#include <thread>

#include "calib/base/check.h"
#include "capture/device/pixel_format.h"
#include "capture/device/video/photo_clock.h"
#include "capture/device/video/photo_settings.h"
#include "capture/device/video/v4l2_node.h"

namespace countershade::capture {

namespace fs = std::filesystem;

#ifndef COUNTERSHADE_LIBCAMERA

bool has_libcamera() {
  return false;
}
std::vector<LibcameraCamera> list_libcamera_cameras() {
  return {};
}
std::string why_no_libcamera_camera() {
  return "install libcamera-dev and build again";
}
Result<std::unique_ptr<Camera>> open_libcamera_camera(const std::string& id, const std::string&,
                                                      const LibcameraOptions&) {
  return error(ErrorCode::kUnsupported,
               "camera '{}': this program was built without libcamera; install libcamera-dev and build again", id);
}

#else

namespace lc = libcamera;

namespace {

constexpr int kSettle = 4;         // photos after a change of exposure that may still be exposed as before
constexpr int kContradicting = 8;  // photos whose metadata contradict, before it is an error

// libcamera's names of what pixel_format.h knows. Its RGB888 has blue first in memory, as DRM's.
struct Name {
  lc::PixelFormat format;
  const char* name;
};
const Name kNames[] = {
    {lc::formats::R8, "Mono8"},          {lc::formats::R10, "Mono10"},        {lc::formats::R12, "Mono12"},
    {lc::formats::SBGGR8, "BayerBG8"},   {lc::formats::SGBRG8, "BayerGB8"},   {lc::formats::SGRBG8, "BayerGR8"},
    {lc::formats::SRGGB8, "BayerRG8"},   {lc::formats::SBGGR10, "BayerBG10"}, {lc::formats::SGBRG10, "BayerGB10"},
    {lc::formats::SGRBG10, "BayerGR10"}, {lc::formats::SRGGB10, "BayerRG10"}, {lc::formats::SBGGR12, "BayerBG12"},
    {lc::formats::SGBRG12, "BayerGB12"}, {lc::formats::SGRBG12, "BayerGR12"}, {lc::formats::SRGGB12, "BayerRG12"},
    {lc::formats::SBGGR16, "BayerBG16"}, {lc::formats::SGBRG16, "BayerGB16"}, {lc::formats::SGRBG16, "BayerGR16"},
    {lc::formats::SRGGB16, "BayerRG16"}, {lc::formats::BGR888, "RGB8"},       {lc::formats::RGB888, "BGR8"},
    {lc::formats::YUYV, "YUYV"},         {lc::formats::MJPEG, "JPEG"},
};

// Seconds of the clock that drivers time photos by: libstdc++'s steady clock is CLOCK_MONOTONIC.
double monotonic_s() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

// A process may have one CameraManager. It exists, with the thread that it runs, while a camera is open or listed; a
// new one is made only when the former has ended altogether.
Result<std::shared_ptr<lc::CameraManager>> camera_manager(const std::string& id) {
  struct One {
    std::mutex mutex;
    std::condition_variable ended;
    std::weak_ptr<lc::CameraManager> manager;
    bool exists = false;
  };
  static One& one = *new One;  // a camera may be closed while the process ends
  std::unique_lock lock(one.mutex);
  for (;;) {
    if (auto manager = one.manager.lock()) return manager;
    if (!one.exists) break;
    one.ended.wait(lock);
  }
  // What fails is told by our own errors; libcamera speaks to those who ask for it.
  if (!std::getenv("LIBCAMERA_LOG_LEVELS") && !std::getenv("LIBCAMERA_LOG_FILE"))
    lc::logSetTarget(lc::LoggingTargetNone);
  auto made = std::make_unique<lc::CameraManager>();
  if (const int failed = made->start(); failed != 0)
    return error(ErrorCode::kDevice, "camera '{}': libcamera does not start: {}; its own log says more: set {}", id,
                 std::strerror(-failed), "LIBCAMERA_LOG_LEVELS=*:DEBUG");
  one.exists = true;
  std::shared_ptr<lc::CameraManager> manager(made.release(), [](lc::CameraManager* last) {
    last->stop();
    delete last;
    const std::lock_guard guard(one.mutex);
    one.exists = false;
    one.ended.notify_all();
  });
  one.manager = manager;
  return manager;
}

// Media devices that may not be opened; libcamera passes over them without a word.
std::vector<LibcameraCamera> closed_media_devices() {
  std::vector<LibcameraCamera> all;
  for (const std::string& path : device_files("/dev/media")) {
    const V4l2Node file(path);
    if (!file.is_open() && errno != ENODEV && errno != ENXIO)
      all.push_back({path, "a media device", {}, {}, {}, hindrance_of(path, errno)});
  }
  return all;
}

std::vector<std::string> nodes_of(lc::CameraManager& manager, const lc::Camera* camera) {
  std::vector<std::string> nodes;
  for (const std::string& path : device_files("/dev/video")) {
    struct stat what {};
    if (::stat(path.c_str(), &what) == 0 && manager.get(what.st_rdev).get() == camera) nodes.push_back(path);
  }
  return nodes;
}

std::string name_of(const lc::Camera& camera) {
  return camera.properties().get(lc::properties::Model).value_or(camera.id());
}

// The bounds of a setting; none where the camera has no such setting.
template <class T>
std::optional<std::array<T, 2>> range_of(const lc::Camera& camera, const lc::ControlId& what) {
  const auto found = camera.controls().find(what.id());
  if (found == camera.controls().end()) return std::nullopt;
  return std::array<T, 2>{found->second.min().get<T>(), found->second.max().get<T>()};
}

std::optional<std::array<double, 2>> exposures_ms(const lc::Camera& camera) {
  const auto range = range_of<std::int32_t>(camera, lc::controls::ExposureTime);  // [us]
  if (!range) return std::nullopt;
  return std::array<double, 2>{(*range)[0] / 1e3, (*range)[1] / 1e3};
}

struct Wish {
  std::unique_ptr<lc::CameraConfiguration> configuration;
  std::vector<std::string> offered;  // as libcamera spells them
  std::optional<PixelFormat> format;
};

// The raw stream if there is one that is read here, else what comes next to it.
Wish wish_of(lc::Camera& camera) {
  Wish wish;
  for (const lc::StreamRole role : {lc::StreamRole::Raw, lc::StreamRole::StillCapture, lc::StreamRole::Viewfinder}) {
    auto configuration = camera.generateConfiguration({role});
    if (!configuration || configuration->empty()) continue;
    std::vector<std::string> known, offered;
    for (const lc::PixelFormat& format : configuration->at(0).formats().pixelformats()) {
      if (format.isValid()) offered.push_back(format.toString());
      for (const Name& n : kNames)
        if (n.format == format) known.push_back(n.name);
    }
    if (wish.offered.empty()) wish.offered = offered;
    if (wish.format = best_format(known); !wish.format) continue;
    wish.offered = offered;
    lc::StreamConfiguration& stream = configuration->at(0);
    const auto named = [&](const Name& n) { return n.name == wish.format->name; };
    stream.pixelFormat = std::find_if(std::begin(kNames), std::end(kNames), named)->format;
    if (const lc::Size largest = stream.formats().range(stream.pixelFormat).max; !largest.isNull())
      stream.size = largest;
    wish.configuration = std::move(configuration);
    break;
  }
  return wish;
}

LibcameraCamera described(lc::CameraManager& manager, lc::Camera& camera) {
  LibcameraCamera one{camera.id(), name_of(camera), nodes_of(manager, &camera), {}, exposures_ms(camera), ""};
  if (const int failed = camera.acquire(); failed == 0)
    camera.release();
  else
    one.hindrance = hindrance_of(camera.id(), -failed);
  one.formats = wish_of(camera).offered;
  return one;
}

class Mapping {
 public:
  explicit Mapping(const lc::FrameBuffer::Plane& plane)
      : file_(plane.fd.get()),
        offset_(plane.offset),
        size_(plane.offset + plane.length),
        start_(::mmap(nullptr, size_, PROT_READ, MAP_SHARED, file_, 0)) {}
  Mapping(Mapping&& other) noexcept
      : file_(other.file_),
        offset_(other.offset_),
        size_(other.size_),
        start_(std::exchange(other.start_, MAP_FAILED)) {}
  Mapping& operator=(Mapping&&) = delete;
  ~Mapping() {
    if (valid()) ::munmap(start_, size_);
  }
  bool valid() const { return start_ != MAP_FAILED; }
  // At most so many bytes, which the processor may read between begin(true) and begin(false).
  std::span<const std::byte> bytes(std::size_t count) const {
    return {static_cast<const std::byte*>(start_) + offset_, std::min(count, size_ - offset_)};
  }
  void reading(bool begin) const {
    dma_buf_sync sync{};
    sync.flags = DMA_BUF_SYNC_READ | (begin ? DMA_BUF_SYNC_START : DMA_BUF_SYNC_END);
    ::ioctl(file_, DMA_BUF_IOCTL_SYNC, &sync);  // memory that is no DMA buffer needs none
  }

 private:
  int file_;
  std::size_t offset_, size_;
  void* start_;
};

// Requests that are done: libcamera's thread brings them, ours takes them.
class Arrivals {
 public:
  void add(lc::Request* request) {
    const std::lock_guard guard(mutex_);
    waiting_.push_back(request);
    came_.notify_one();
  }
  // Null where none comes in that time.
  lc::Request* next(double seconds) {
    std::unique_lock lock(mutex_);
    if (!came_.wait_for(lock, std::chrono::duration<double>(seconds), [this] { return !waiting_.empty(); }))
      return nullptr;
    lc::Request* first = waiting_.front();
    waiting_.pop_front();
    return first;
  }

 private:
  std::mutex mutex_;
  std::condition_variable came_;
  std::deque<lc::Request*> waiting_;
};

class OpenCamera final : public Camera {
 public:
  OpenCamera(std::string id, std::shared_ptr<lc::CameraManager> manager, std::shared_ptr<lc::Camera> camera,
             const LibcameraOptions& options)
      : id_(std::move(id)), options_(options), manager_(std::move(manager)), camera_(std::move(camera)) {}
  ~OpenCamera() override;

  const std::string& id() const override { return id_; }
  Result<void> set_up();
  Result<void> arm(double exposure_ms) override;
  Result<Exposure> trigger() override;

 private:
  // `number` as libcamera gives it: below 0.
  Error failed(const std::string& what, int number) const { return v4l2_error(id_, what, -number); }
  bool is_there() const;
  Result<void> lock_nodes();
  void hold_controls();
  template <class T>
  void hold(const lc::Control<T>& what, T value);
  Result<void> start();
  Result<void> give(lc::Request* request);
  Result<lc::Request*> take(double until_s);
  bool is_outdated(const lc::Request& request, double time_s);
  Result<std::optional<Exposure>> take_whole();
  Result<std::optional<Exposure>> read_out(lc::Request* request, double time_s);
  PhotoSettings said_of(const lc::ControlList& metadata) const;

  std::string id_;
  LibcameraOptions options_;
  std::shared_ptr<lc::CameraManager> manager_;  // outlives the camera
  std::shared_ptr<lc::Camera> camera_;
  bool acquired_ = false;
  std::vector<V4l2Node> nodes_;
  std::unique_ptr<lc::CameraConfiguration> configuration_;
  PixelFormat format_;
  std::unique_ptr<lc::FrameBufferAllocator> memory_;
  std::vector<Mapping> mappings_;                       // by a request's cookie, as the next two
  std::vector<std::unique_ptr<lc::Request>> requests_;  // all are queued, or wait in arrivals_
  std::vector<int> asked_;                              // the number of the wish that a request was queued with
  Arrivals arrivals_;
  lc::ControlList held_{lc::controls::controls};  // set in every request
  PhotoSettings wish_;
  int wish_number_ = 0, settled_ = 0;  // photos since the first request with this wish; below 0: none yet
  bool armed_ = false, came_ = false, running_ = false;
  PhotoClock clock_;
  std::string contradiction_;  // of the last photo
  int contradicting_ = 0;      // photos in a row
  int lost_ = 0;               // photos since trigger() that did not arrive whole
  std::uint64_t photos_ = 0;
};

OpenCamera::~OpenCamera() {
  if (running_) camera_->stop();  // gives all requests back, in libcamera's thread, before it returns
  camera_->requestCompleted.disconnect(&arrivals_);
  requests_.clear();
  memory_.reset();
  if (acquired_) camera_->release();
}

bool OpenCamera::is_there() const {
  const auto all = manager_->cameras();
  return std::find(all.begin(), all.end(), camera_) != all.end();
}

Result<void> OpenCamera::lock_nodes() {
  for (const std::string& path : nodes_of(*manager_, camera_.get())) {
    V4l2Node node(path);
    if (!node.is_open()) return error(ErrorCode::kDevice, "camera '{}': {}", id_, hindrance_of(path, errno));
    CS_TRY_VOID(node.lock(id_));
    nodes_.push_back(std::move(node));
  }
  return {};
}

template <class T>
void OpenCamera::hold(const lc::Control<T>& what, T value) {
  if (const auto range = range_of<T>(*camera_, what)) held_.set(what, std::clamp(value, (*range)[0], (*range)[1]));
}

void OpenCamera::hold_controls() {
  hold(lc::controls::AeEnable, false);
  hold(lc::controls::AwbEnable, false);
  hold(lc::controls::AnalogueGain, 1.0f);
  hold(lc::controls::Sharpness, 0.0f);
  hold(lc::controls::draft::NoiseReductionMode, std::int32_t{lc::controls::draft::NoiseReductionModeOff});
  // As fast as the exposure lets it, as slow as it needs: a frame of fixed length would cut the exposure.
  if (const auto range = range_of<std::int64_t>(*camera_, lc::controls::FrameDurationLimits))
    held_.set(lc::controls::FrameDurationLimits, lc::Span<const std::int64_t, 2>(*range));
  if (const auto gain = held_.get(lc::controls::AnalogueGain)) wish_.gain = *gain;
}

Result<void> OpenCamera::set_up() {
  if (const int number = camera_->acquire(); number != 0) return failed("it cannot be opened", number);
  acquired_ = true;
  Wish wish = wish_of(*camera_);
  if (!wish.format)
    return error(ErrorCode::kUnsupported,
                 "camera '{}' offers the pixel formats {}, of which this program reads none; it reads grey of 8 to 12 "
                 "bits, unpacked Bayer of 8 to 16, RGB, YUYV and MJPEG",
                 id_, fmt::join(wish.offered, ", "));
  configuration_ = std::move(wish.configuration);
  format_ = *wish.format;
  lc::StreamConfiguration& stream = configuration_->at(0);
  const lc::PixelFormat asked = stream.pixelFormat;
  if (configuration_->validate() == lc::CameraConfiguration::Invalid || stream.pixelFormat != asked)
    return error(ErrorCode::kDevice, "camera '{}': format {} was asked for, libcamera makes {} of it", id_,
                 asked.toString(), stream.pixelFormat.toString());
  CS_TRY_VOID(lock_nodes());
  if (const int number = camera_->configure(configuration_.get()); number != 0)
    return failed(fmt::format("format {}", stream.toString()), number);
  hold_controls();
  return {};
}

Result<void> OpenCamera::arm(double exposure_ms) {
  if (!(exposure_ms >= 0) || !std::isfinite(exposure_ms))
    return error(ErrorCode::kBadValue, "camera '{}': an exposure of {} ms is none; give 0 (the camera's own) or more",
                 id_, exposure_ms);
  const auto range = exposures_ms(*camera_);
  if (exposure_ms > 0 && !range)
    return error(ErrorCode::kUnsupported,
                 "camera '{}' cannot be told its exposure through libcamera: leave exposures_ms out of the rig, and "
                 "set the exposure by its own tool",
                 id_);
  if (exposure_ms > 0 && (exposure_ms < (*range)[0] || exposure_ms > (*range)[1]))
    return error(ErrorCode::kBadValue,
                 "camera '{}': exposures_ms = {} is outside what it can do, {} to {} ms; correct the rig", id_,
                 exposure_ms, (*range)[0], (*range)[1]);
  if (exposure_ms > 0 && wish_.exposure_ms != exposure_ms) {
    wish_.exposure_ms = exposure_ms;
    held_.set(lc::controls::ExposureTime, static_cast<std::int32_t>(std::lround(1e3 * exposure_ms)));
    ++wish_number_, settled_ = -1;
  }
  if (!running_) CS_TRY_VOID(start());
  armed_ = true;
  return {};
}

Result<void> OpenCamera::start() {
  lc::Stream* stream = configuration_->at(0).stream();
  requests_.clear(), mappings_.clear();
  memory_ = std::make_unique<lc::FrameBufferAllocator>(camera_);
  if (const int number = memory_->allocate(stream); number < 0) return failed("no memory for its pictures", number);
  for (const auto& buffer : memory_->buffers(stream)) {
    auto request = camera_->createRequest(requests_.size());
    if (!request || request->addBuffer(stream, buffer.get()) != 0) return failed("a request", -ENOMEM);
    mappings_.emplace_back(buffer->planes()[0]);
    if (!mappings_.back().valid()) return failed("its memory cannot be mapped", -errno);
    requests_.push_back(std::move(request));
  }
  asked_.assign(requests_.size(), 0);
  camera_->requestCompleted.disconnect(&arrivals_);
  camera_->requestCompleted.connect(&arrivals_, &Arrivals::add);
  if (const int number = camera_->start(&held_); number != 0) return failed("it does not start", number);
  running_ = true;
  for (const auto& request : requests_) CS_TRY_VOID(give(request.get()));
  return {};
}

Result<void> OpenCamera::give(lc::Request* request) {
  if (request->status() != lc::Request::RequestPending) request->reuse(lc::Request::ReuseBuffers);
  request->controls().merge(held_);
  asked_[request->cookie()] = wish_number_;
  if (settled_ < 0) settled_ = 0;
  if (const int number = camera_->queueRequest(request); number != 0) return failed("a request", number);
  return {};
}

// The next photo; null where none comes in time. `until_s` in the past: only one that waits already.
Result<lc::Request*> OpenCamera::take(double until_s) {
  constexpr double kLook_s = 0.2;  // how often it is asked whether the camera is still there
  for (;;) {
    const double left_s = until_s - monotonic_s();
    if (lc::Request* request = arrivals_.next(std::clamp(left_s, 0.0, kLook_s))) return request;
    if (left_s <= 0) return nullptr;
    if (!is_there()) return failed("no photo", -ENODEV);
  }
}

PhotoSettings OpenCamera::said_of(const lc::ControlList& metadata) const {
  PhotoSettings said;
  if (const auto us = metadata.get(lc::controls::ExposureTime)) said.exposure_ms = *us / 1e3;
  if (const auto gain = metadata.get(lc::controls::AnalogueGain)) said.gain = *gain;
  if (const auto us = metadata.get(lc::controls::FrameDuration)) said.frame_ms = static_cast<double>(*us) / 1e3;
  for (const V4l2Node& node : nodes_)
    if (const auto ms = node.exposure_ms(); ms && !said.exposure_ms) said.exposure_ms = ms, said.by_driver = true;
  return said;
}

// None where the photo is not whole, or is not what was asked for.
Result<std::optional<Exposure>> OpenCamera::read_out(lc::Request* request, double time_s) {
  const lc::StreamConfiguration& stream = configuration_->at(0);
  const lc::FrameMetadata& frame = request->buffers().begin()->second->metadata();
  const PhotoSettings said = said_of(request->metadata());
  contradiction_ = contradiction(wish_, said);
  if (!contradiction_.empty()) {
    ++contradicting_;
    return std::optional<Exposure>();
  }
  contradicting_ = 0;
  if (frame.status != lc::FrameMetadata::FrameSuccess) return std::optional<Exposure>();
  const Mapping& mapping = mappings_[request->cookie()];
  mapping.reading(true);
  auto values = unpack(format_, mapping.bytes(frame.planes()[0].bytesused), static_cast<int>(stream.size.width),
                       static_cast<int>(stream.size.height), stream.stride);
  mapping.reading(false);
  if (!values) return std::optional<Exposure>();
  Exposure e;
  e.values = std::move(*values);
  e.full_scale = format_.full_scale();
  e.exposure_ms = said.exposure_ms.value_or(wish_.exposure_ms.value_or(0));
  e.timestamp_s = time_s - 1e-3 * e.exposure_ms;
  e.counter = photos_++;
  e.saturated = saturated_share(e.values, e.full_scale);
  return std::optional<Exposure>(std::move(e));
}

// Whether a photo was begun before it was asked for, or before the exposure that is wished for now had its effect.
bool OpenCamera::is_outdated(const lc::Request& request, double time_s) {
  const bool asked = asked_[request.cookie()] == wish_number_, settled = settled_ >= kSettle;
  if (settled_ >= 0) ++settled_;
  const bool of_before = clock_.of_before(time_s, true, monotonic_s(), 1e-3 * wish_.exposure_ms.value_or(0));
  return of_before || !asked || !settled;
}

// One photo that was begun after now; none where it did not come, not whole, or not as asked for.
Result<std::optional<Exposure>> OpenCamera::take_whole() {
  for (;;) {  // what waits is of the past
    CS_TRY(lc::Request * old, take(0));
    if (!old) break;
    CS_TRY_VOID(give(old));
  }
  clock_.ask(monotonic_s());
  contradiction_.clear();
  std::optional<std::uint32_t> former;
  for (;;) {
    CS_TRY(lc::Request * taken, take(monotonic_s() + options_.timeout_s + 1e-3 * wish_.exposure_ms.value_or(0)));
    came_ = taken != nullptr;
    if (!came_) return std::optional<Exposure>();
    if (taken->status() !=
        lc::Request::RequestComplete) {  // the camera is gone, which libcamera hears of a little later
      for (const double until_s = monotonic_s() + options_.timeout_s; is_there() && monotonic_s() < until_s;)
        std::this_thread::sleep_for(std::chrono::milliseconds(20));
      if (!is_there()) return failed("no photo", -ENODEV);
      ++lost_;
      CS_TRY_VOID(give(taken));
      return std::optional<Exposure>();
    }
    const lc::FrameMetadata& frame = taken->buffers().begin()->second->metadata();
    // Drivers keep what came short to themselves; the numbers tell.
    if (former && frame.sequence > *former) lost_ += static_cast<int>(frame.sequence - *former - 1);
    former = frame.sequence;
    const auto stated_ns = taken->metadata().get(lc::controls::SensorTimestamp);
    const double time_s = 1e-9 * (stated_ns ? static_cast<double>(*stated_ns) : static_cast<double>(frame.timestamp));
    std::optional<Exposure> whole;
    const bool outdated = is_outdated(*taken, time_s);
    if (!outdated) {
      CS_TRY(whole, read_out(taken, time_s));
      lost_ += !whole && contradiction_.empty();
    }
    CS_TRY_VOID(give(taken));
    if (!outdated) return whole;
  }
}

Result<Exposure> OpenCamera::trigger() {
  CS_CHECK(armed_, "camera '" + id_ + "' is triggered before it is armed");
  lost_ = contradicting_ = 0;
  for (int i = 0; i < options_.tries; i += contradiction_.empty()) {
    CS_TRY(std::optional<Exposure> whole, take_whole());
    if (whole) {
      whole->lost = lost_;
      return std::move(*whole);
    }
    if (contradicting_ >= kContradicting)
      return error(ErrorCode::kDevice,
                   "camera '{}': {}, in {} photos one after the other; write what it can do into the rig, and close "
                   "other programs that set it",
                   id_, contradiction_, contradicting_);
  }
  if (!came_)
    return error(ErrorCode::kDevice,
                 "camera '{}' sends no photo within {:.1f} s, {} times: unplug it and plug it in again; a hub without "
                 "power of its own, or several cameras on one, may be too slow",
                 id_, options_.timeout_s + wish_.exposure_ms.value_or(0) / 1e3, options_.tries);
  return error(ErrorCode::kDevice,
               "camera '{}': every photo came with an error or too short, {} times: another cable or socket, fewer "
               "devices on its hub",
               id_, options_.tries);
}

}  // namespace

bool has_libcamera() {
  return true;
}

std::vector<LibcameraCamera> list_libcamera_cameras() {
  std::vector<LibcameraCamera> all;
  if (const auto manager = camera_manager(""); manager)
    for (const auto& camera : (*manager)->cameras()) all.push_back(described(**manager, *camera));
  for (LibcameraCamera& closed : closed_media_devices()) all.push_back(std::move(closed));
  return all;
}

std::string why_no_libcamera_camera() {
  if (device_files("/dev/media").empty())
    return "there is no /dev/media device: plug the camera in; `lsusb` shows whether USB sees it; `sudo modprobe "
           "uvcvideo` where the kernel has not loaded its driver";
  if (!fs::exists("/run/udev/control"))
    return "libcamera hears of cameras from udev, which does not run here (a container?): use backend = \"v4l2\"";
  return "there are media devices, but none that libcamera knows (a pipeline or libcamera-ipa may be missing): use "
         "backend = \"v4l2\" where it has a /dev/video node";
}

Result<std::unique_ptr<Camera>> open_libcamera_camera(const std::string& id, const std::string& device,
                                                      const LibcameraOptions& options) {
  CS_TRY(const auto manager, camera_manager(id));
  const auto all = manager->cameras();
  const auto closed = closed_media_devices();
  std::error_code ignored;
  const std::string node = device.starts_with("/") ? fs::weakly_canonical(device, ignored).string() : device;
  std::vector<std::shared_ptr<lc::Camera>> matching;
  std::string found;
  for (const auto& camera : all) {
    const auto nodes = nodes_of(*manager, camera.get());
    if (device.empty() || device == camera->id() || device == name_of(*camera) ||
        std::find(nodes.begin(), nodes.end(), node) != nodes.end())
      matching.push_back(camera);
    found += fmt::format("{}'{}' ({})", found.empty() ? "" : ", ", camera->id(), name_of(*camera));
  }
  if (all.empty())
    return error(ErrorCode::kDevice, "camera '{}': libcamera knows no camera: {}", id,
                 closed.empty() ? why_no_libcamera_camera() : closed[0].hindrance);
  if (matching.empty())
    return error(ErrorCode::kDevice, "camera '{}': libcamera knows no camera '{}'; there is {}", id, device, found);
  if (matching.size() > 1)
    return error(ErrorCode::kBadValue, "camera '{}': device = \"{}\" fits several cameras; name one of {}", id, device,
                 found);
  auto open = std::make_unique<OpenCamera>(id, manager, matching[0], options);
  CS_TRY_VOID(open->set_up());
  return std::unique_ptr<Camera>(std::move(open));
}

#endif

}  // namespace countershade::capture
