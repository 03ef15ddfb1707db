// sync: is the photographed picture the one that was shown? Displays of every latency with jitter, on the virtual
// clock.
#include <algorithm>
#include <cmath>

#include "calib/image/image_file.h"
#include "capture/session/runner.h"
#include "simdata/render/simulator.h"
#include "simdata/room/rooms.h"
#include "tools/bench/study.h"

namespace countershade::bench {

namespace {

namespace fs = std::filesystem;

constexpr double kExposureMs = 1e3 / 60, kRefreshMs = 1e3 / 60;
constexpr double kReadOutMs = 20;  // of the simulated camera, in which it cannot expose
constexpr int kPatterns = 1000;    // of each display, at least

// A camera that remembers when its photos were begun.
class TimedCamera final : public capture::Camera {
 public:
  TimedCamera(std::unique_ptr<capture::Camera> camera, std::vector<double>& begun_s)
      : camera_(std::move(camera)), begun_s_(begun_s) {}
  const std::string& id() const override { return camera_->id(); }
  Result<void> arm(double exposure_ms) override { return camera_->arm(exposure_ms); }
  Result<capture::Exposure> trigger() override {
    auto taken = camera_->trigger();
    if (taken) begun_s_.push_back(taken->timestamp_s);
    return taken;
  }

 private:
  std::unique_ptr<capture::Camera> camera_;
  std::vector<double>& begun_s_;
};

// A small room without noise, so that a photo is right or it is not.
simdata::RigAndRoom room_with(double latency_ms, double jitter_ms, std::uint64_t seed) {
  simdata::RigAndRoom room = simdata::small_two_wall(8, {160, 100}, 16);
  room.rig.cameras[0].model.clear();
  room.rig.cameras[0].exposures_ms = {kExposureMs};
  room.simulation.seed = seed;
  room.simulation.cameras[0].full_well_e = 1e9, room.simulation.cameras[0].read_noise_e = 0;
  room.simulation.cameras[0].reference_exposure_ms = kExposureMs;
  for (SimulatedProjector& p : room.simulation.projectors) p.latency_ms = latency_ms, p.latency_jitter_ms = jitter_ms;
  return room;
}

struct Captured {
  std::vector<double> begun_s;  // of every photo
  int patterns = 0;
};

Result<Captured> capture_in(const simdata::RigAndRoom& room, const Sequence& sequence, const fs::path& folder) {
  SilentProgress quiet;
  Captured captured;
  captured.patterns = static_cast<int>(sequence.frames.size());
  std::error_code ignored;
  fs::remove_all(folder, ignored);
  CS_TRY(const auto simulator, simdata::Simulator::make(room.rig, room.simulation, quiet));
  capture::Devices devices = simdata::simulated_devices(simulator);
  devices.cameras[0] = std::make_unique<TimedCamera>(std::move(devices.cameras[0]), captured.begun_s);
  CS_TRY_VOID(capture::capture_session(room.rig, "", sequence, devices, folder, {}, quiet));
  return captured;
}

// Photos of `folder` that differ from those of `right` by more than rounding.
Result<int> wrong_photos(const Sequence& sequence, const fs::path& folder, const fs::path& right) {
  int wrong = 0;
  for (const Frame& f : sequence.frames) {
    const std::string name = fmt::format("photos/camera/{:04}.tif", f.index);
    CS_TRY(const StoredImage a, read_image(folder / name));
    CS_TRY(const StoredImage b, read_image(right / name));
    float most = 0;
    for (std::size_t i = 0; i < a.values.data().size(); ++i)
      most = std::max(most, std::abs(a.values.data()[i] - b.values.data()[i]));
    wrong += most > 2 * 65535.0 / 4095;
  }
  return wrong;
}

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

}  // namespace

Result<Study> sync_study(const StudyContext& context) {
  Study study{"Displays that are late: is each stored photo of the picture that was shown?",
              {"latency ms", "jitter ms", "patterns", "wrong", "photos taken again", "median ms per pattern",
               "of these exposure, read-out, latency", "beyond, in refreshes"},
              {},
              {},
              "",
              "",
              false};
  const fs::path folder = context.output / "sync";
  const Sequence sequence = capture::default_sequence(room_with(0, 0, 1).rig);
  CS_TRY(const Captured plain, capture_in(room_with(0, 0, 1), sequence, folder / "right"));
  const int extra = static_cast<int>(plain.begun_s.size()) - plain.patterns;  // before the first
  int patterns = 0, wrong = 0;
  double worst = 0;
  const double latencies[] = {0, 5, 10, 33, 60, 90, 120};
  int done = 0;
  for (const double latency : latencies)
    for (const double jitter : {0.0, kRefreshMs}) {
      context.progress->step("sync", done++, 2 * std::size(latencies));
      int here = 0, wrong_here = 0, again = 0;
      std::vector<double> periods;
      for (std::uint64_t seed = 1; here < kPatterns; ++seed) {
        CS_TRY(const Captured c, capture_in(room_with(latency, jitter, seed), sequence, folder / "session"));
        CS_TRY(const int w, wrong_photos(sequence, folder / "session", folder / "right"));
        here += c.patterns, wrong_here += w;
        again += std::max(0, static_cast<int>(c.begun_s.size()) - c.patterns - extra);
        const std::size_t first = c.begun_s.size() - c.patterns;
        for (std::size_t i = first + 1; i < c.begun_s.size(); ++i)
          periods.push_back(1e3 * (c.begun_s[i] - c.begun_s[i - 1]));
      }
      const double needed = kExposureMs + kReadOutMs + latency;
      const double beyond = (median(periods) - needed) / kRefreshMs;
      worst = std::max(worst, beyond);
      patterns += here, wrong += wrong_here;
      study.rows.push_back({fmt::format("{:.0f}", latency), fmt::format("{:.1f}", jitter), fmt::format("{}", here),
                            fmt::format("{}", wrong_here), fmt::format("{}", again),
                            fmt::format("{:.1f}", median(periods)), fmt::format("{:.1f}", needed),
                            fmt::format("{:.1f}", beyond)});
    }
  context.progress->step("sync", 2 * std::size(latencies), 2 * std::size(latencies));
  study.notes.push_back(
      "photos taken again count those by which the latency is measured at the start; a photo is wrong when a pixel "
      "differs by more than 2 of 4095 from that of a display without latency");
  study.figure = fmt::format("{} wrong of {} patterns; {:.1f} refreshes beyond exposure, read-out and latency at most",
                             wrong, patterns, worst);
  study.bound = "0 of 10,000, <= 2";
  study.ok = wrong == 0 && patterns >= 10000 && worst <= 2;
  return study;
}

}  // namespace countershade::bench
