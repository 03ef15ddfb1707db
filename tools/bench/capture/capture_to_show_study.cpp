// capture-to-show: how long the operator waits beside what exposures and the display's latency take, and from the last
// photo to the compensated picture. In real time: the photos were simulated before, a camera hands them out.
#include <chrono>
#include <cmath>
#include <deque>
#include <map>
#include <string_view>
#include <thread>

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

constexpr double kExposureMs = 1e3 / 60, kRefreshMs = 1e3 / 60;
constexpr double kLatencyMs = 33, kReadOutMs = 1e3 / 60;  // 30 photos a second

double now_ms() {
  return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now().time_since_epoch()).count();
}
void sleep_until(double ms) {
  std::this_thread::sleep_for(std::chrono::duration<double, std::milli>(ms - now_ms()));
}

// What a camera sees of the pictures of all projectors, by their contents.
struct Recording {
  std::map<std::string, Picture> photos;  // stored numbers, full scale 65535
  int width = 0, height = 0, channels = 0;
};

// The pictures of all projectors, which change at one refresh, kLatencyMs late; no time passes while it is recorded.
class Wall {
 public:
  explicit Wall(std::size_t projectors) : handed_(projectors) {}
  void hand_over(std::size_t q, const Picture& picture) {
    handed_[q] = std::hash<std::string_view>()(
        {reinterpret_cast<const char*>(picture.data().data()), picture.data().size() * sizeof(std::uint16_t)});
    if (q + 1 < handed_.size()) return;
    std::string all;
    for (const std::size_t hash : handed_) all += fmt::format("{:x} ", hash);
    seen_.emplace_back((std::floor((now_ms() + kLatencyMs) / kRefreshMs) + 1) * kRefreshMs, all);
    if (seen_.size() > 50) seen_.pop_front();
  }
  void wait_for_refresh() const { sleep_until((std::floor(now_ms() / kRefreshMs) + 1) * kRefreshMs); }
  const std::string& handed() const { return seen_.back().second; }
  // Which pictures are seen for which share of a time.
  std::map<std::string, double> seen(double from_ms, double to_ms) const {
    std::map<std::string, double> shares;
    for (std::size_t i = 0; i < seen_.size(); ++i) {
      const double begin = std::max(from_ms, seen_[i].first);
      const double end = std::min(to_ms, i + 1 < seen_.size() ? seen_[i + 1].first : to_ms);
      if (end > begin) shares[seen_[i].second] += (end - begin) / (to_ms - from_ms);
    }
    return shares;
  }

 private:
  std::vector<std::size_t> handed_;
  std::deque<std::pair<double, std::string>> seen_;  // since when
};

// Simulated devices whose photos are kept.
class Recorder final : public capture::Camera {
 public:
  Recorder(std::unique_ptr<capture::Camera> camera, const Wall& wall, Recording& to)
      : camera_(std::move(camera)), wall_(wall), to_(to) {}
  const std::string& id() const override { return camera_->id(); }
  Result<void> arm(double exposure_ms) override { return camera_->arm(exposure_ms); }
  Result<capture::Exposure> trigger() override {
    CS_TRY(capture::Exposure photo, camera_->trigger());
    to_.width = photo.values.width(), to_.height = photo.values.height(), to_.channels = photo.values.channels();
    Picture& kept = to_.photos[wall_.handed()];
    kept = Picture(to_.width, to_.height, to_.channels);
    for (std::size_t i = 0; i < kept.data().size(); ++i)
      kept.data()[i] = static_cast<std::uint16_t>(std::lround(photo.values.data()[i] / photo.full_scale * 65535));
    return photo;
  }

 private:
  std::unique_ptr<capture::Camera> camera_;
  const Wall& wall_;
  Recording& to_;
};

class Player final : public capture::Camera {
 public:
  Player(std::string id, const Wall& wall, const Recording& from) : id_(std::move(id)), wall_(wall), from_(from) {}
  const std::string& id() const override { return id_; }
  Result<void> arm(double) override { return {}; }
  Result<capture::Exposure> trigger() override {
    const double from = now_ms();
    sleep_until(from + kExposureMs);
    capture::Exposure e;
    e.values = Image(from_.width, from_.height, from_.channels);
    e.exposure_ms = kExposureMs, e.timestamp_s = 1e-3 * from;
    for (const auto& [pictures, share] : wall_.seen(from, from + kExposureMs)) {
      const auto photo = from_.photos.find(pictures);
      CS_CHECK(photo != from_.photos.end(), "a second capture shows what the first one showed");
      const auto weight = static_cast<float>(share);
      for (std::size_t i = 0; i < e.values.data().size(); ++i)
        e.values.data()[i] += weight * static_cast<float>(photo->second.data()[i]);
    }
    sleep_until(from + kExposureMs + kReadOutMs);
    last_ms = now_ms();
    ++photos;
    return e;
  }
  int photos = 0;
  double last_ms = 0;  // when the last one was read out

 private:
  std::string id_;
  const Wall& wall_;
  const Recording& from_;
};

class WallProjector final : public capture::Projector {
 public:
  // simulated: shows the same, in no time; null = in real time.
  WallProjector(const ProjectorSpec& spec, Wall& wall, std::size_t at, std::unique_ptr<capture::Projector> simulated)
      : spec_(spec), wall_(wall), at_(at), simulated_(std::move(simulated)) {}
  const std::string& id() const override { return spec_.id; }
  int width() const override { return spec_.resolution[0]; }
  int height() const override { return spec_.resolution[1]; }
  double refresh_hz() const override { return 1e3 / kRefreshMs; }
  Result<void> show(const Picture& picture) override {
    CS_TRY_VOID(hand_over(picture));
    return taken();
  }
  Result<void> hand_over(const Picture& picture) override {
    wall_.hand_over(at_, picture);
    return simulated_ ? simulated_->show(picture) : Result<void>();
  }
  Result<void> taken() override {
    if (!simulated_ && at_ == 0) wall_.wait_for_refresh();
    return {};
  }

 private:
  ProjectorSpec spec_;
  Wall& wall_;
  std::size_t at_;
  std::unique_ptr<capture::Projector> simulated_;
};

// The documentation's room in front of a 1080p camera.
simdata::RigAndRoom room_of_study() {
  simdata::RigAndRoom room = simdata::default_two_wall();
  room.simulation.cameras[0].resolution = {1920, 1080};
  room.rig.cameras[0].exposures_ms = {kExposureMs};
  room.simulation.cameras[0].reference_exposure_ms = kExposureMs;
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
  Recording recording;
  {
    Wall wall(room.rig.projectors.size());
    capture::Devices devices = simdata::simulated_devices(simulator);
    devices.cameras[0] = std::make_unique<Recorder>(std::move(devices.cameras[0]), wall, recording);
    for (std::size_t q = 0; q < devices.projectors.size(); ++q)
      devices.projectors[q] =
          std::make_unique<WallProjector>(room.rig.projectors[q], wall, q, std::move(devices.projectors[q]));
    CS_TRY_VOID(tools::capture_with_code(room.rig, "", "auto", devices, folder / "recorded", *context.progress));
    fs::remove_all(folder / "recorded", code);
  }
  Wall wall(room.rig.projectors.size());
  capture::Devices devices;
  auto player = std::make_unique<Player>(room.rig.cameras[0].id, wall, recording);
  const Player& camera = *player;
  devices.cameras.push_back(std::move(player));
  for (std::size_t q = 0; q < room.rig.projectors.size(); ++q)
    devices.projectors.push_back(std::make_unique<WallProjector>(room.rig.projectors[q], wall, q, nullptr));
  room.rig.cameras[0].full_scale.reset();  // the recording has 16 bits
  room.rig.cameras[0].pedestal *= 65535.0 / 4095;

  const double begun = now_ms();
  CS_TRY(const tools::CodedCapture captured,
         tools::capture_with_code(room.rig, "", "auto", devices, folder / "session", *context.progress));
  const double stored = now_ms(), last = camera.last_ms;
  tools::CalibrateOptions options;
  options.decoded = captured.decoded;
  CS_TRY(const tools::CalibrationSummary summary,
         tools::calibrate(folder / "session", folder / "calibration", options, *context.progress));
  const double calibrated = now_ms();
  CS_TRY(const tools::Calibration calibration, tools::open_calibration(folder / "calibration"));
  CS_TRY(const std::vector<Picture> pictures, tools::test_pictures(calibration.model, "photo"));
  CS_TRY(const tools::Show show,
         tools::compensate_show(calibration.model, pictures, {}, tools::Engine::kAuto, *context.progress));
  CS_TRY_VOID(tools::write_show(calibration.model, show, 8, folder / "out"));
  const double shown = now_ms();
  fs::remove_all(folder / "session", code);  // gigabytes

  const auto frames = static_cast<double>(captured.sequence.frames.size());
  const double session = (stored - begun) / 1e3, needed = frames * (kExposureMs + kReadOutMs + kLatencyMs) / 1e3;
  const double to_show = (shown - stored) / 1e3;
  const auto row = [&](const std::string& what, double seconds, const std::string& of) {
    study.rows.push_back({what, fmt::format("{:.2f}", seconds), of});
  };
  row("frames: exposure, read-out, latency", needed, fmt::format("{:.0f} frames", frames));
  row("first to last photo", (last - begun) / 1e3,
      fmt::format("{} photos, those that measure latency and noise too", camera.photos));
  row("to the end of live decoding", (stored - last) / 1e3, "");
  row("last photo to calibration", (calibrated - stored) / 1e3, "");
  row("calibration to compensated pictures", (shown - calibrated) / 1e3, show.engine);
  study.figure = fmt::format(
      "last photo to compensated pictures {:.1f} s; the session takes {:.1f} s, {:.1f} s of which are exposures, "
      "read-outs and latencies of its frames",
      to_show, session, needed);
  study.bound = "<= 10 s, <= 15 % more";
  study.ok = to_show <= 10 && session <= 1.15 * needed;
  return study;
}

}  // namespace countershade::bench
