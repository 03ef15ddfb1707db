#include "capture/device/aravis/aravis.h"

#ifdef COUNTERSHADE_ARAVIS
#include <arv.h>
#endif

#include <algorithm>
#include <chrono>
#include <cmath>
#include <mutex>

#include "calib/base/check.h"
#include "capture/device/aravis/free_run.h"
#include "capture/device/aravis/genicam_check.h"
#include "capture/device/aravis/gige_network.h"
#include "capture/device/aravis/gvsp_filter.h"
#include "capture/device/pixel_format.h"

namespace countershade::capture {

#ifndef COUNTERSHADE_ARAVIS

bool has_aravis() {
  return false;
}
std::vector<AravisCamera> list_aravis_cameras() {
  return {};
}
Result<std::unique_ptr<Camera>> open_aravis_camera(const std::string& id, const std::string&, const AravisOptions&) {
  return error(ErrorCode::kUnsupported,
               "camera '{}': this program was built without Aravis; install libaravis-dev and build again", id);
}

#else

namespace {

constexpr double kExposureTolerance = 0.01;  // what a camera may round an exposure by
constexpr unsigned kSmallPacket = 1400;      // bytes: what every network lets through
constexpr int kBuffers = 4;
// Of a camera that runs freely: photos that may be held inside it, and after a change of exposure, which many cameras
// obey late; those after which it is given up that one is new.
constexpr int kInFlight = 2, kUntilExposed = 4, kMostOld = 200;
constexpr std::size_t kMostBytes = std::size_t{1} << 30;  // of a photo: more, and the camera is wrong about itself
constexpr std::size_t kBesides = 1 << 20;                 // bytes that a camera may send with a photo

// A call of Aravis that may fail.
class Failure {
 public:
  ~Failure() { g_clear_error(&error_); }
  Failure() = default;
  Failure(const Failure&) = delete;
  Failure& operator=(const Failure&) = delete;
  GError** out() {
    g_clear_error(&error_);
    return &error_;
  }
  explicit operator bool() const { return error_ != nullptr; }
  std::string text() const { return error_ ? error_->message : "failed"; }

 private:
  GError* error_ = nullptr;
};

struct Unref {
  void operator()(void* object) const { g_object_unref(object); }
};
template <class T>
using Owned = std::unique_ptr<T, Unref>;

std::string or_empty(const char* text) {
  return text ? text : "";
}

std::mutex& system_mutex() {  // Aravis' list of devices is one for the whole process
  static std::mutex mutex;
  return mutex;
}

double monotonic_s() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}
double wall_s() {  // as Aravis dates photos
  return 1e-6 * static_cast<double>(g_get_real_time());
}

class OpenCamera final : public Camera {
 public:
  OpenCamera(std::string id, Owned<ArvCamera> camera, const AravisOptions& options)
      : id_(std::move(id)), options_(options), camera_(std::move(camera)) {}
  ~OpenCamera() override { stop(); }

  const std::string& id() const override { return id_; }
  Result<void> set_up();
  Result<void> arm(double exposure_ms) override;
  Result<Exposure> trigger() override;

 private:
  Error failed(const std::string& what, const Failure& failure) const {
    return error(ErrorCode::kDevice, "camera '{}': {}: {}", id_, what, failure.text());
  }
  bool has(const char* feature) const {
    Failure failure;
    return arv_camera_is_feature_available(camera_.get(), feature, failure.out()) && !failure;
  }
  // Sets an automatic to Off, where there is one.
  Result<void> switch_off(const char* feature);
  Result<void> choose_format();
  Result<void> negotiate_packets();
  Result<std::size_t> photo_bytes();
  Result<void> start();
  Result<void> guard_stream(std::size_t bytes);
  void stop();
  ArvBuffer* next_photo();
  Result<std::optional<Exposure>> take_whole();
  Result<Exposure> read_out(ArvBuffer* buffer);
  Error is_gone(const Failure& failure);

  std::string id_;
  AravisOptions options_;
  Owned<ArvCamera> camera_;
  Owned<ArvStream> stream_;
  PixelFormat format_;
  int width_ = 0, height_ = 0;
  double exposure_ms_ = 0, begun_s_ = 0;  // begun: when the latest photo was, by the monotonic clock
  bool armed_ = false, gone_ = false;
  bool runs_freely_ = false;              // it cannot be triggered
  int in_flight_ = kInFlight;             // where it runs freely
  bool came_ = false;                     // the latest photo, if not whole
  bool owed_ = false;                     // a photo that was asked for has not come
  std::uint64_t photos_ = 0, block_ = 0;  // given; the number that the camera gave the latest (0 is none)
};

Result<void> OpenCamera::switch_off(const char* feature) {
  if (!has(feature)) return {};
  Failure failure;
  arv_camera_set_string(camera_.get(), feature, "Off", failure.out());
  if (failure) return failed(fmt::format("{} cannot be switched off", feature), failure);
  const std::string now = or_empty(arv_camera_get_string(camera_.get(), feature, failure.out()));
  if (failure || now != "Off")
    return error(ErrorCode::kDevice,
                 "camera '{}': {} was set to Off and reads back {}; switch it off by the maker's tool", id_, feature,
                 now.empty() ? "nothing" : now);
  return {};
}

Result<void> OpenCamera::choose_format() {
  Failure failure;
  guint count = 0;
  const std::unique_ptr<const char*, decltype(&g_free)> names(
      arv_camera_dup_available_pixel_formats_as_strings(camera_.get(), &count, failure.out()), &g_free);
  if (failure) return failed("its pixel formats cannot be listed", failure);
  const std::vector<std::string> offered(names.get(), names.get() + count);
  const auto best = best_format(offered);
  if (!best)
    return error(ErrorCode::kUnsupported,
                 "camera '{}' offers the pixel formats {}, of which this program reads none; it reads Mono8 to Mono16 "
                 "(packed too), Bayer of 8 to 16 bits and RGB8",
                 id_, fmt::join(offered, ", "));
  arv_camera_set_pixel_format_from_string(camera_.get(), best->name.c_str(), failure.out());
  if (failure) return failed("pixel format " + best->name, failure);
  const std::string now = or_empty(arv_camera_get_pixel_format_as_string(camera_.get(), failure.out()));
  if (failure || now != best->name)
    return error(ErrorCode::kDevice, "camera '{}': pixel format {} was asked for, {} reads back", id_, best->name, now);
  format_ = *best;
  return {};
}

// The largest packets that come through; where the camera cannot try, those that every network takes.
Result<void> OpenCamera::negotiate_packets() {
  if (!arv_camera_is_gv_device(camera_.get())) return {};
  Failure failure;
  arv_camera_gv_auto_packet_size(camera_.get(), failure.out());
  if (!failure) return {};
  arv_camera_gv_set_packet_size(camera_.get(), kSmallPacket, failure.out());
  if (failure) return failed("packet size", failure);
  return {};
}

Result<void> OpenCamera::set_up() {
  arv_device_set_range_check_policy(arv_camera_get_device(camera_.get()), ARV_RANGE_CHECK_POLICY_ENABLE);
  CS_TRY_VOID(choose_format());
  for (const char* automatic : {"ExposureAuto", "GainAuto", "BalanceWhiteAuto", "BlackLevelAuto"})
    CS_TRY_VOID(switch_off(automatic));
  Failure failure;
  if (has("GammaEnable")) arv_camera_set_boolean(camera_.get(), "GammaEnable", FALSE, failure.out());
  if (failure) return failed("gamma cannot be switched off", failure);
  if (has("Gamma") && !has("GammaEnable")) arv_camera_set_float(camera_.get(), "Gamma", 1, failure.out());
  if (failure) return failed("gamma cannot be set to 1", failure);
  CS_TRY_VOID(negotiate_packets());
  arv_camera_set_acquisition_mode(camera_.get(), ARV_ACQUISITION_MODE_CONTINUOUS, failure.out());
  if (failure) return failed("acquisition mode", failure);
  runs_freely_ = !arv_camera_is_software_trigger_supported(camera_.get(), failure.out());
  if (failure) return failed("whether it can be triggered by software cannot be asked", failure);
  if (!runs_freely_)
    arv_camera_set_trigger(camera_.get(), "Software", failure.out());
  else if (has("TriggerMode"))
    arv_camera_clear_triggers(camera_.get(), failure.out());
  if (failure) return failed("its trigger cannot be set", failure);
  return {};
}

// What the camera says that it sends for a photo, if that can be.
Result<std::size_t> OpenCamera::photo_bytes() {
  Failure failure;
  gint x = 0, y = 0;
  const std::size_t payload = arv_camera_get_payload(camera_.get(), failure.out());
  if (failure) return failed("size of a photo", failure);
  arv_camera_get_region(camera_.get(), &x, &y, &width_, &height_, failure.out());
  if (failure) return failed("width and height of a photo", failure);
  const bool possible = width_ > 0 && height_ > 0 && kMostBytes / width_ / height_ > 0;
  const std::size_t image = possible ? format_.bytes(width_, height_) : 0;
  if (!possible || payload < image || payload > 2 * image + kBesides)
    return error(ErrorCode::kDevice,
                 "camera '{}' says that its photos have {} x {} pixels in {} and {} bytes, which cannot be: load its "
                 "default settings by the maker's tool",
                 id_, width_, height_, format_.name, payload);
  return payload;
}

Result<void> OpenCamera::guard_stream(std::size_t bytes) {
  if (!ARV_IS_GV_STREAM(stream_.get())) return {};
  // A camera that runs freely sends another photo anyway; and the first packet of a photo, if it was asked for again,
  // would come late and make an old photo look new.
  g_object_set(stream_.get(), "packet-resend",
               runs_freely_ ? ARV_GV_STREAM_PACKET_RESEND_NEVER : ARV_GV_STREAM_PACKET_RESEND_ALWAYS, "packet-timeout",
               20000u, "frame-retention", runs_freely_ ? 20000u : 100000u, nullptr);
  Failure failure;
  const guint packet = arv_camera_gv_get_packet_size(camera_.get(), failure.out());
  if (failure || packet < 128)
    return error(ErrorCode::kDevice, "camera '{}': its packets have {} bytes{}; set GevSCPSPacketSize to 1400", id_,
                 packet, failure ? ": " + failure.text() : "");
  const auto filtered =
      filter_stream({arv_gv_stream_get_port(ARV_GV_STREAM(stream_.get())), packet,
                     static_cast<std::uint32_t>(format_.bytes(width_, height_)), static_cast<std::uint32_t>(bytes)});
  if (!filtered) return error(filtered.error().code, "camera '{}': {}", id_, filtered.error().message);
  return {};
}

Result<void> OpenCamera::start() {
  CS_TRY(const std::size_t bytes, photo_bytes());
  Failure failure;
  // Received as by any program: Aravis would take whole frames of the network card where it may, past our filter.
  if (arv_camera_is_gv_device(camera_.get()))
    arv_camera_gv_set_stream_options(camera_.get(), ARV_GV_STREAM_OPTION_PACKET_SOCKET_DISABLED);
  stream_.reset(arv_camera_create_stream(camera_.get(), nullptr, nullptr, failure.out()));
  if (!stream_ || failure)
    return error(
        ErrorCode::kDevice,
        "camera '{}': no stream: {}. Does another program have it? One that crashed keeps it for some seconds: "
        "try again",
        id_, failure.text());
  CS_TRY_VOID(guard_stream(bytes));
  for (int i = 0; i < (runs_freely_ ? 2 * kBuffers : kBuffers); ++i)
    arv_stream_push_buffer(stream_.get(), arv_buffer_new(bytes, nullptr));
  arv_camera_start_acquisition(camera_.get(), failure.out());
  if (failure) return failed("it does not start", failure);
  return {};
}

void OpenCamera::stop() {
  if (!stream_) return;
  if (!gone_) arv_camera_stop_acquisition(camera_.get(), nullptr);
  stream_.reset();
}

Result<void> OpenCamera::arm(double exposure_ms) {
  if (!(exposure_ms >= 0) || !std::isfinite(exposure_ms))
    return error(ErrorCode::kBadValue, "camera '{}': an exposure of {} ms is none; give 0 (the camera's own) or more",
                 id_, exposure_ms);
  Failure failure;
  if (exposure_ms > 0) {
    double least = 0, most = HUGE_VAL;
    arv_camera_get_exposure_time_bounds(camera_.get(), &least, &most, failure.out());
    if (!failure && (1e3 * exposure_ms < least || 1e3 * exposure_ms > most))
      return error(ErrorCode::kBadValue,
                   "camera '{}': exposures_ms = {} is outside what it can do, {} to {} ms; correct the rig", id_,
                   exposure_ms, least / 1e3, most / 1e3);
    if (exposure_ms != exposure_ms_) in_flight_ = kUntilExposed;
    arv_camera_set_exposure_time(camera_.get(), 1e3 * exposure_ms, failure.out());
    if (failure) return failed(fmt::format("an exposure of {} ms", exposure_ms), failure);
  }
  const double now = arv_camera_get_exposure_time(camera_.get(), failure.out()) / 1e3;
  if (failure) return failed("its exposure cannot be read", failure);
  if (exposure_ms > 0 && std::abs(now - exposure_ms) > kExposureTolerance * exposure_ms) {
    exposure_ms_ = now;
    return error(ErrorCode::kDevice,
                 "camera '{}': an exposure of {} ms was asked for, it reads back {} ms; write that into the rig", id_,
                 exposure_ms, now);
  }
  exposure_ms_ = now;
  if (!stream_) CS_TRY_VOID(start());
  armed_ = true;
  return {};
}

Error OpenCamera::is_gone(const Failure& failure) {
  gone_ = true;
  return error(ErrorCode::kDevice, "camera '{}' is gone ({}); is it plugged in and powered?", id_, failure.text());
}

Result<Exposure> OpenCamera::read_out(ArvBuffer* buffer) {
  std::size_t size = 0;
  const void* data = arv_buffer_get_data(buffer, &size);
  const auto format = pixel_format(arv_buffer_get_image_pixel_format(buffer));
  if (!format || format->code != format_.code)
    return error(ErrorCode::kDevice, "camera '{}': {} was set, a photo in {} came", id_, format_.name,
                 format ? format->name : fmt::format("format {:#x}", arv_buffer_get_image_pixel_format(buffer)));
  const int width = arv_buffer_get_image_width(buffer), height = arv_buffer_get_image_height(buffer);
  gint beside = 0, below = 0;
  arv_buffer_get_image_padding(buffer, &beside, &below);
  if (width != width_ || height != height_ || beside != 0)
    return error(ErrorCode::kDevice,
                 "camera '{}': photos of {} x {} pixels were set, one of {} x {} with {} bytes between its rows came; "
                 "load its default settings by the maker's tool",
                 id_, width_, height_, width, height, beside);
  auto values = unpack(*format, {static_cast<const std::byte*>(data), size}, width, height);
  if (!values) return error(ErrorCode::kDevice, "camera '{}': {}", id_, values.error().message);
  Exposure exposure;
  exposure.values = std::move(*values);
  exposure.full_scale = format->full_scale();
  exposure.exposure_ms = exposure_ms_;
  exposure.timestamp_s = begun_s_;
  exposure.counter = photos_++;
  exposure.saturated = saturated_share(exposure.values, exposure.full_scale);
  return exposure;
}

// The next one; of a camera that runs freely the next that was begun after now, by the wall clock's time at which its
// first packet came, and those held inside a camera are passed over, too. Null where none comes.
ArvBuffer* OpenCamera::next_photo() {
  const auto wait_us = static_cast<guint64>(1e6 * options_.timeout_s + 1e3 * exposure_ms_);
  FreeRun free_run;
  free_run.ask(wall_s(), monotonic_s(), in_flight_);
  for (int i = 0; i < kMostOld; ++i) {
    ArvBuffer* buffer = arv_stream_timeout_pop_buffer(stream_.get(), wait_us);
    if (buffer == nullptr || !runs_freely_) return buffer;
    const double came_s = 1e-9 * static_cast<double>(arv_buffer_get_system_timestamp(buffer));
    if (const auto begun = free_run.begun(came_s, 1e-3 * exposure_ms_, wall_s(), monotonic_s())) {
      in_flight_ = kInFlight, begun_s_ = *begun;
      return buffer;
    }
    arv_stream_push_buffer(stream_.get(), buffer);
  }
  return nullptr;
}

// One photo; none where it did not come, or parts of it were lost. After one that did not come the stream is begun
// anew: it could come instead of the next one, and Aravis takes block numbers that jump back for photos of the past.
Result<std::optional<Exposure>> OpenCamera::take_whole() {
  Failure failure;
  if (!stream_) {
    arv_camera_get_exposure_time(camera_.get(), failure.out());
    if (failure) return is_gone(failure);
    CS_TRY_VOID(start());
  }
  while (ArvBuffer* old = arv_stream_try_pop_buffer(stream_.get())) arv_stream_push_buffer(stream_.get(), old);
  begun_s_ = monotonic_s();
  if (!runs_freely_) arv_camera_software_trigger(camera_.get(), failure.out());
  if (failure) return is_gone(failure);
  ArvBuffer* buffer = next_photo();
  came_ = buffer != nullptr;
  if (!came_) {  // of a camera that sends nothing, only an answer to a question tells whether it is there
    arv_camera_get_exposure_time(camera_.get(), failure.out());
    if (failure) return is_gone(failure);
    stop();
    owed_ = true;
    return std::optional<Exposure>();
  }
  std::optional<Result<Exposure>> read;
  const guint64 block = arv_buffer_get_frame_id(buffer);
  if (arv_buffer_get_status(buffer) == ARV_BUFFER_STATUS_SUCCESS && block != block_) {
    read = read_out(buffer);
    block_ = block;
  }
  arv_stream_push_buffer(stream_.get(), buffer);
  if (std::exchange(owed_, false)) stop();  // this one may be the former's, and its own be on the way
  if (!read) return std::optional<Exposure>();
  if (!*read) return read->error();
  return std::optional<Exposure>(std::move(**read));
}

Result<Exposure> OpenCamera::trigger() {
  CS_CHECK(armed_, "camera '" + id_ + "' is triggered before it is armed");
  for (int i = 0; i < options_.tries; ++i) {
    CS_TRY(std::optional<Exposure> whole, take_whole());
    if (!whole) continue;
    whole->lost = i;
    return std::move(*whole);
  }
  if (!came_)
    return error(
        ErrorCode::kDevice,
        "camera '{}' answers, but in {} tries{} no photo came, each within {:.1f} s: a firewall that keeps its "
        "packets out, another network card that they go to, or a trigger mode that is not kept",
        id_, options_.tries, runs_freely_ ? " (it has no software trigger and should run freely)" : "",
        options_.timeout_s + exposure_ms_ / 1e3);
  return error(
      ErrorCode::kDevice,
      "camera '{}': parts of every photo were lost on the way, or do not fit it, {} times: check cable and network "
      "card, or give the network larger receive buffers (sysctl net.core.rmem_max)",
      id_, options_.tries);
}

bool names(const AravisCamera& camera, const std::string& full_id, const std::string& device) {
  return device == camera.device || device == camera.address || device == camera.name || device == full_id;
}

struct Listed {
  AravisCamera camera;
  std::string full_id;
};
std::vector<Listed> listed() {
  arv_update_device_list();
  std::vector<Listed> all;
  for (unsigned i = 0; i < arv_get_n_devices(); ++i) {
    const std::string serial = or_empty(arv_get_device_serial_nbr(i)), address = or_empty(arv_get_device_address(i));
    Listed l;
    l.camera.device = serial.empty() ? address : serial;
    l.camera.name = or_empty(arv_get_device_vendor(i)) + " " + or_empty(arv_get_device_model(i));
    l.camera.protocol = or_empty(arv_get_device_protocol(i)), l.camera.address = address;
    l.full_id = or_empty(arv_get_device_id(i));
    all.push_back(std::move(l));
  }
  return all;
}

// One that stands on the list, once its description has been looked through.
Result<Owned<ArvCamera>> opened(const Listed& l) {
  const bool network = l.camera.protocol == "GigEVision";
  const auto unusable = [](const Error& why) {
    return error(why.code, "{}; give it another firmware, by the maker's tool", why.message);
  };
  if (network)
    if (const auto file = check_description_file(l.camera.address); !file) return unusable(file.error());
  Failure failure;
  const Owned<ArvDevice> device(arv_open_device((network ? l.camera.address : l.full_id).c_str(), failure.out()));
  if (device && !failure)
    if (const auto checked = check_description(device.get()); !checked) return unusable(checked.error());
  Owned<ArvCamera> camera(device && !failure ? arv_camera_new_with_device(device.get(), failure.out()) : nullptr);
  if (!camera || failure)
    return error(ErrorCode::kDevice,
                 "cannot be opened: {}. Does another program have it? One that crashed keeps it for some seconds: try "
                 "again",
                 failure.text());
  return camera;
}

void look_at(Listed& l, const std::vector<NetworkCard>& cards) {
  AravisCamera& c = l.camera;
  if (c.protocol == "GigEVision") {
    c.hindrance = subnet_hindrance(c.address, cards), c.advice = packet_advice(c.address, cards);
    if (c.hindrance.empty() && is_controlled(c.address))
      c.hindrance = "another program has it: close that; one that crashed keeps it for three seconds";
  }
  if (!c.hindrance.empty()) return;
  const auto camera = opened(l);
  if (!camera) {
    c.hindrance = camera.error().message;
    return;
  }
  Failure failure;
  guint count = 0;
  const std::unique_ptr<const char*, decltype(&g_free)> names(
      arv_camera_dup_available_pixel_formats_as_strings(camera->get(), &count, failure.out()), &g_free);
  for (guint i = 0; !failure && i < count; ++i)
    if (best_format({names.get()[i]})) c.formats.emplace_back(names.get()[i]);
  double least = 0, most = 0;
  arv_camera_get_exposure_time_bounds(camera->get(), &least, &most, failure.out());
  if (!failure && most > 0) c.exposures_ms = {least / 1e3, most / 1e3};
}

}  // namespace

bool has_aravis() {
  return true;
}

std::vector<AravisCamera> list_aravis_cameras() {
  const std::lock_guard lock(system_mutex());
  std::vector<AravisCamera> cameras;
  const std::vector<NetworkCard> cards = network_cards();
  for (Listed& l : listed()) {
    look_at(l, cards);
    cameras.push_back(std::move(l.camera));
  }
  return cameras;
}

Result<std::unique_ptr<Camera>> open_aravis_camera(const std::string& id, const std::string& device,
                                                   const AravisOptions& options) {
  const std::lock_guard lock(system_mutex());
  const std::vector<Listed> all = listed();
  std::vector<const Listed*> matching;
  std::string found;
  for (const Listed& l : all) {
    if (device.empty() || names(l.camera, l.full_id, device)) matching.push_back(&l);
    found +=
        fmt::format("{}'{}' ({}, {})", found.empty() ? "" : ", ", l.camera.device, l.camera.name, l.camera.address);
  }
  if (all.empty())
    return error(ErrorCode::kDevice,
                 "camera '{}': no GigE Vision or USB3 Vision camera answers. Is it powered and plugged in, in the same "
                 "subnet as this computer's network card, and does the firewall let UDP port 3956 through? Of USB: may "
                 "you read and write its device node (udev rule)?",
                 id);
  if (matching.empty())
    return error(ErrorCode::kDevice, "camera '{}': no camera is called '{}'; those that answer are {}", id, device,
                 found);
  if (matching.size() > 1)
    return error(ErrorCode::kDevice, "camera '{}': device = \"{}\" fits several cameras; name one of {}", id, device,
                 found);
  const Listed& l = *matching[0];
  auto camera = opened(l);
  if (!camera) return error(camera.error().code, "camera '{}': '{}': {}", id, l.camera.device, camera.error().message);
  auto open = std::make_unique<OpenCamera>(id, std::move(*camera), options);
  CS_TRY_VOID(open->set_up());
  return std::unique_ptr<Camera>(std::move(open));
}

#endif

}  // namespace countershade::capture
