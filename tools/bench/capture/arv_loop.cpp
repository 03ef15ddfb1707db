#include "tools/bench/capture/arv_loop.h"

#ifdef COUNTERSHADE_ARAVIS
#include <arv.h>
#endif

namespace countershade::bench {

#ifndef COUNTERSHADE_ARAVIS

Result<std::unique_ptr<ArvLoop>> ArvLoop::open(const std::string&) {
  return error(ErrorCode::kUnsupported, "this program was built without Aravis");
}

#else

namespace {

class Loop final : public ArvLoop {
 public:
  Loop(ArvCamera* camera, ArvStream* stream) : camera_(camera), stream_(stream) {}
  ~Loop() override {
    arv_camera_stop_acquisition(camera_, nullptr);
    g_object_unref(stream_);
    g_object_unref(camera_);
  }
  Result<bool> photo() override {
    GError* failure = nullptr;
    arv_camera_software_trigger(camera_, &failure);
    if (failure != nullptr) {
      const Error said = error(ErrorCode::kDevice, "Aravis' loop: {}", failure->message);
      g_error_free(failure);
      return said;
    }
    ArvBuffer* buffer = arv_stream_timeout_pop_buffer(stream_, 2000000);
    const bool whole = buffer != nullptr && arv_buffer_get_status(buffer) == ARV_BUFFER_STATUS_SUCCESS;
    if (buffer != nullptr) arv_stream_push_buffer(stream_, buffer);
    return whole;
  }

 private:
  ArvCamera* camera_;
  ArvStream* stream_;
};

}  // namespace

Result<std::unique_ptr<ArvLoop>> ArvLoop::open(const std::string& address) {
  ArvCamera* camera = arv_camera_new(address.c_str(), nullptr);
  if (camera == nullptr) return error(ErrorCode::kDevice, "Aravis opens no camera at {}", address);
  arv_camera_set_pixel_format(camera, ARV_PIXEL_FORMAT_MONO_8, nullptr);
  arv_camera_set_exposure_time_auto(camera, ARV_AUTO_OFF, nullptr);
  arv_camera_set_exposure_time(camera, 1e3 * kArvLoopExposureMs, nullptr);
  arv_camera_set_acquisition_mode(camera, ARV_ACQUISITION_MODE_CONTINUOUS, nullptr);
  arv_camera_set_trigger(camera, "Software", nullptr);
  arv_camera_gv_auto_packet_size(camera, nullptr);
  ArvStream* stream = arv_camera_create_stream(camera, nullptr, nullptr, nullptr);
  if (stream == nullptr) {
    g_object_unref(camera);
    return error(ErrorCode::kDevice, "Aravis opens no stream of the camera at {}", address);
  }
  const guint payload = arv_camera_get_payload(camera, nullptr);
  for (int i = 0; i < 4; ++i) arv_stream_push_buffer(stream, arv_buffer_new(payload, nullptr));
  arv_camera_start_acquisition(camera, nullptr);
  return std::unique_ptr<ArvLoop>(new Loop(camera, stream));
}

#endif

}  // namespace countershade::bench
