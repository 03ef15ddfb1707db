// capture-to-show: how long the operator waits beside what exposures and the display's latency take, and from the last
// photo to the compensated picture.
#include <chrono>
#include <cmath>

#include "calib/file/file.h"
#include "simdata/room/rooms.h"
#include "tools/bench/study.h"
#include "tools/job/calibration.h"
#include "tools/job/coded_capture.h"
#include "tools/job/devices.h"
#include "tools/job/show.h"

namespace countershade::bench {

namespace {

namespace fs = std::filesystem;

constexpr double kExposureMs = 1e3 / 60, kLatencyMs = 33, kReadOutMs = 20;  // the simulated camera's: 27 photos a second

double now_s() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

// Seconds spent in the devices, which on a site pass by themselves, and the times of photos.
struct InDevices {
  double seconds = 0;
  double first_photo_s = NAN, last_photo_s = NAN;  // by the camera's clock
  int photos = 0;
  template <class Call>
  auto timed(Call call) {
    const double from = now_s();
    auto result = call();
    seconds += now_s() - from;
    return result;
  }
};

class TimedCamera final : public capture::Camera {
 public:
  TimedCamera(std::unique_ptr<capture::Camera> camera, InDevices& times) : camera_(std::move(camera)), times_(times) {}
  const std::string& id() const override { return camera_->id(); }
  Result<void> arm(double exposure_ms) override {
    return times_.timed([&] { return camera_->arm(exposure_ms); });
  }
  Result<capture::Exposure> trigger() override {
    auto photo = times_.timed([&] { return camera_->trigger(); });
    if (photo) {
      if (times_.photos++ == 0) times_.first_photo_s = photo->timestamp_s;
      times_.last_photo_s = photo->timestamp_s;
    }
    return photo;
  }

 private:
  std::unique_ptr<capture::Camera> camera_;
  InDevices& times_;
};

class TimedProjector final : public capture::Projector {
 public:
  TimedProjector(std::unique_ptr<capture::Projector> projector, InDevices& times)
      : projector_(std::move(projector)), times_(times) {}
  const std::string& id() const override { return projector_->id(); }
  int width() const override { return projector_->width(); }
  int height() const override { return projector_->height(); }
  double refresh_hz() const override { return projector_->refresh_hz(); }
  Result<void> show(const Picture& picture) override {
    return times_.timed([&] { return projector_->show(picture); });
  }
  Result<void> hand_over(const Picture& picture) override {
    return times_.timed([&] { return projector_->hand_over(picture); });
  }
  Result<void> taken() override {
    return times_.timed([&] { return projector_->taken(); });
  }

 private:
  std::unique_ptr<capture::Projector> projector_;
  InDevices& times_;
};

// The documentation's room in front of a 1080p camera and displays that are two refreshes late.
simdata::RigAndRoom room_of_study() {
  simdata::RigAndRoom room = simdata::default_two_wall();
  room.simulation.cameras[0].resolution = {1920, 1080};
  room.rig.cameras[0].exposures_ms = {kExposureMs};
  room.simulation.cameras[0].reference_exposure_ms = kExposureMs;
  for (SimulatedProjector& p : room.simulation.projectors) p.latency_ms = kLatencyMs;
  return room;
}

}  // namespace

Result<Study> capture_to_show(const StudyContext& context) {
  Study study{"A whole session by defaults: two projectors 1280 x 800 that are 33 ms late, a camera of 1920 x 1080",
              {"what", "seconds", "of"},
              {},
              {},
              "",
              "",
              false};
  const fs::path folder = context.output / "capture-to-show";
  std::error_code code;
  fs::remove_all(folder, code);
  fs::create_directories(folder, code);
  simdata::RigAndRoom room = room_of_study();
  CS_TRY(Device lens, simdata::true_camera(room.simulation, room.rig.cameras[0].id));
  lens.device_from_world = {};
  room.rig.cameras[0].model = folder / "camera.cameramodel";
  CS_TRY_VOID(write_cameramodel(room.rig.cameras[0].model, lens));
  CS_TRY(const auto simulator, simdata::Simulator::make(room.rig, room.simulation, *context.progress));
  InDevices times;
  capture::Devices devices = simdata::simulated_devices(simulator);
  devices.cameras[0] = std::make_unique<TimedCamera>(std::move(devices.cameras[0]), times);
  for (auto& p : devices.projectors) p = std::make_unique<TimedProjector>(std::move(p), times);

  const double begun = now_s();
  CS_TRY(const tools::CodedCapture captured,
         tools::capture_with_code(room.rig, "", "auto", devices, folder / "session", *context.progress));
  const double ours = now_s() - begun - times.seconds;
  const double stored = now_s();
  tools::CalibrateOptions options;
  options.decoded = captured.decoded;
  CS_TRY(const tools::CalibrationSummary summary,
         tools::calibrate(folder / "session", folder / "calibration", options, *context.progress));
  const double calibrated = now_s();
  CS_TRY(const tools::Calibration calibration, tools::open_calibration(folder / "calibration"));
  CS_TRY(const std::vector<Picture> pictures, tools::test_pictures(calibration.model, "photo"));
  CS_TRY(const tools::Show show,
         tools::compensate_show(calibration.model, pictures, {}, tools::Engine::kAuto, *context.progress));
  CS_TRY_VOID(tools::write_show(calibration.model, show, 8, folder / "out"));
  const double shown = now_s();
  fs::remove_all(folder / "session", code);  // gigabytes

  const auto frames = static_cast<double>(captured.sequence.frames.size());
  const double of_devices = times.last_photo_s - times.first_photo_s;
  const double needed = frames * (kExposureMs + kReadOutMs + kLatencyMs) / 1e3;
  const auto row = [&](const std::string& what, double seconds, const std::string& of) {
    study.rows.push_back({what, fmt::format("{:.2f}", seconds), of});
  };
  row("frames: exposure, read-out, latency", needed, fmt::format("{:.0f} frames", frames));
  row("on the devices' clock", of_devices, fmt::format("{} photos, those that measure latency and noise too", times.photos));
  row("computing and storing between them", ours, fmt::format("{:.0f} ms a frame", 1e3 * ours / frames));
  row("last photo to calibration", calibrated - stored, "");
  row("calibration to compensated pictures", shown - calibrated, show.engine);
  study.notes.push_back(
      "the devices are simulated on a clock of their own; what they take of this computer is not counted, but they and "
      "the decoder share its cores");
  const double computing = ours / of_devices, session = (of_devices + ours) / needed - 1;
  study.figure = fmt::format(
      "last photo to compensated pictures {:.1f} s; between photos computing takes {:.0f} % of the devices' time; the "
      "whole session {:.0f} % more than exposures, read-outs and latencies",
      shown - stored, 100 * computing, 100 * session);
  study.bound = "<= 10 s, <= 15 %";
  study.ok = shown - stored <= 10 && session <= 0.15;
  return study;
}

}  // namespace countershade::bench
