// A true window on a true display, whose scan-out reaches the wall late: is each stored photo of the picture that was
// shown? In real time; the study sync asks the same of thousands of photos on the virtual clock.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <deque>
#include <mutex>
#include <thread>

#include "calib/base/random.h"
#include "calib/file/file.h"
#include "calib/image/image_file.h"
#include "capture/device/window.h"
#include "capture/session/runner.h"
#include "tests/support/cli.h"
#include "tests/support/xvfb.h"

namespace countershade::testing {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

constexpr int kWidth = 128, kHeight = 80, kProjectors = 2;  // side by side
constexpr double kRefreshMs = 1e3 / 60, kExposureMs = 1e3 / 60, kReadOutMs = 10;

double now_ms() {
  return std::chrono::duration<double, std::milli>(Clock::now().time_since_epoch()).count();
}
void sleep_until(double ms) {
  std::this_thread::sleep_for(std::chrono::duration<double, std::milli>(ms - now_ms()));
}

// What a camera sees of pictures next to each other: each where it falls, and some of all of it everywhere.
std::vector<double> light_of(const std::vector<std::uint8_t>& rgb) {
  const int width = kProjectors * kWidth;
  std::vector<double> light(static_cast<std::size_t>(width) * kHeight);
  double mean = 0;
  for (std::size_t i = 0; i < light.size(); ++i) {
    for (int c = 0; c < 3; ++c) light[i] += rgb[3 * i + c] * rgb[3 * i + c] / (3 * 255.0 * 255.0);
    mean += light[i] / static_cast<double>(light.size());
  }
  for (std::size_t i = 0; i < light.size(); ++i)
    light[i] = 0.01 + (0.6 + 0.2 * static_cast<double>(i % width) / width) * light[i] + 0.1 * mean;
  return light;
}

std::uint16_t stored(double light) {
  return static_cast<std::uint16_t>(std::lround(65535 * std::min(1.0, light)));
}

// Reads a display's memory at each refresh; what it read is seen `latency` ms and up to `jitter` ms later.
class LateWall {
 public:
  LateWall(const XvfbDisplay& display, double latency_ms, double jitter_ms)
      : display_(display), latency_ms_(latency_ms), jitter_ms_(jitter_ms), thread_([this] { scan_out(); }) {}
  ~LateWall() {
    done_ = true;
    thread_.join();
  }
  // Mean light between two moments, the second not in the future.
  std::vector<double> light(double from_ms, double to_ms) {
    while (scanned_ms() < to_ms) sleep_until(now_ms() + 1);
    const std::lock_guard lock(mutex_);
    std::vector<double> sum(static_cast<std::size_t>(kProjectors) * kWidth * kHeight);
    for (std::size_t i = 0; i < seen_.size(); ++i) {
      const double begin = std::max(from_ms, seen_[i].from_ms);
      const double end = std::min(to_ms, i + 1 < seen_.size() ? seen_[i + 1].from_ms : to_ms);
      if (end > begin)
        for (std::size_t k = 0; k < sum.size(); ++k) sum[k] += seen_[i].light[k] * (end - begin) / (to_ms - from_ms);
    }
    return sum;
  }
  // By how much the thread that stands for the display was late of late: a fault of this machine, not of the display.
  double stalled_ms() {
    const std::lock_guard lock(mutex_);
    return *std::max_element(stalls_.begin(), stalls_.end());
  }

 private:
  struct Seen {
    double from_ms;
    std::vector<double> light;
  };
  double scanned_ms() {
    const std::lock_guard lock(mutex_);
    return scanned_ms_;
  }
  void scan_out() {
    Random random(hash_name("late wall"));
    std::vector<std::uint8_t> former;
    for (double at = now_ms(); !done_; at = std::max(at + kRefreshMs, now_ms())) {
      sleep_until(at);
      const double begun = now_ms();
      std::vector<std::uint8_t> pixels = display_.pixels(kProjectors * kWidth, kHeight);
      const double late = latency_ms_ + jitter_ms_ * random.uniform();
      const std::lock_guard lock(mutex_);
      stalls_.push_back(now_ms() - at);
      if (stalls_.size() > 20) stalls_.pop_front();
      if (pixels != former) {
        const double from = seen_.empty() ? begun + late : std::max(begun + late, seen_.back().from_ms);
        seen_.push_back({from, light_of(pixels)});
        former = std::move(pixels);
      }
      while (seen_.size() > 40) seen_.pop_front();
      scanned_ms_ = now_ms();
    }
  }

  const XvfbDisplay& display_;
  const double latency_ms_, jitter_ms_;
  std::mutex mutex_;
  std::deque<Seen> seen_;
  std::deque<double> stalls_{0};
  double scanned_ms_ = 0;
  std::atomic<bool> done_ = false;
  std::thread thread_;  // last: it uses all of the above
};

class WallCamera final : public capture::Camera {
 public:
  WallCamera(std::string id, LateWall& wall) : id_(std::move(id)), wall_(wall) {}
  const std::string& id() const override { return id_; }
  Result<void> arm(double) override { return {}; }
  Result<capture::Exposure> trigger() override {
    sleep_until(now_ms() + wall_.stalled_ms());
    const double from = now_ms();
    sleep_until(from + kExposureMs + kReadOutMs);
    const std::vector<double> light = wall_.light(from, from + kExposureMs);
    capture::Exposure e;
    e.values = Image(kProjectors * kWidth, kHeight, 1);
    std::transform(light.begin(), light.end(), e.values.data().begin(), stored);
    e.exposure_ms = kExposureMs;
    e.timestamp_s = 1e-3 * from;
    return e;
  }

 private:
  std::string id_;
  LateWall& wall_;
};

// A window whose pictures are in the display's memory when it has handed them over: how busy this machine is may not
// count as the display's lateness.
class PromptWindow final : public capture::Projector {
 public:
  PromptWindow(std::unique_ptr<capture::Projector> window, const XvfbDisplay& display, int left)
      : window_(std::move(window)), display_(display), left_(left) {}
  const std::string& id() const override { return window_->id(); }
  int width() const override { return window_->width(); }
  int height() const override { return window_->height(); }
  double refresh_hz() const override { return window_->refresh_hz(); }
  Result<void> show(const Picture& picture) override {
    CS_TRY_VOID(hand_over(picture));
    return taken();
  }
  Result<void> hand_over(const Picture& picture) override {
    CS_TRY_VOID(window_->hand_over(picture));
    std::vector<std::uint8_t> bytes;
    for (const std::uint16_t v : picture.data()) bytes.push_back(static_cast<std::uint8_t>((v + 128) / 257));
    for (const double until = now_ms() + 2000; display_.pixels(kWidth, kHeight, left_) != bytes;) {
      if (now_ms() > until) return error(ErrorCode::kDevice, "the display does not show what it was handed");
      sleep_until(now_ms() + 1);
    }
    return {};
  }
  Result<void> taken() override { return window_->taken(); }

 private:
  std::unique_ptr<capture::Projector> window_;
  const XvfbDisplay& display_;
  int left_;
};

Rig rig() {
  Rig rig;
  rig.cameras.resize(1);
  rig.cameras[0].id = "camera";
  for (const char* id : {"left", "right"}) {
    ProjectorSpec p;
    p.id = id, p.resolution = {kWidth, kHeight};
    rig.projectors.push_back(p);
  }
  return rig;
}

// Captures in this process, whose windows are on `display`; what went wrong.
std::string capture_on(const XvfbDisplay& display, double latency_ms, double jitter_ms, const fs::path& folder) {
  setenv("DISPLAY", display.name().c_str(), 1);
  unsetenv("WAYLAND_DISPLAY");
  LateWall wall(display, latency_ms, jitter_ms);
  capture::Devices devices;
  for (int q = 0; q < kProjectors; ++q) {
    const std::string id = rig().projectors[q].id;
    auto window = capture::open_window_projector(id, kWidth, kHeight, "", id, q * kWidth);
    if (!window) return window.error().message;
    devices.projectors.push_back(std::make_unique<PromptWindow>(std::move(*window), display, q * kWidth));
  }
  devices.cameras.push_back(std::make_unique<WallCamera>("camera", wall));
  SilentProgress quiet;
  const auto done = capture::capture_session(rig(), "", capture::default_sequence(rig()), devices, folder, {}, quiet);
  return done ? "" : done.error().message;
}

// Photos of the session that are not of their frame.
int wrong_photos(const Sequence& sequence, const fs::path& folder) {
  int wrong = 0;
  for (const Frame& frame : sequence.frames) {
    std::vector<std::uint8_t> rgb(static_cast<std::size_t>(3) * kProjectors * kWidth * kHeight);
    for (int q = 0; q < kProjectors; ++q) {
      const Picture picture = capture::render_role(frame.role, rig().projectors[q].id, kWidth, kHeight).value();
      for (int y = 0; y < kHeight; ++y)
        for (int x = 0; x < 3 * kWidth; ++x)
          rgb[3 * (static_cast<std::size_t>(y) * kProjectors * kWidth + q * kWidth) + x] =
              static_cast<std::uint8_t>((picture.row(y)[x] + 128) / 257);
    }
    const std::vector<double> light = light_of(rgb);
    const auto photo = read_image(folder / fmt::format("photos/camera/{:04}.tif", frame.index));
    bool right = photo.has_value();
    for (std::size_t i = 0; right && i < light.size(); ++i)
      right = std::abs(photo->values.data()[i] - stored(light[i])) < 2;  // it is rounded twice
    wrong += !right;
  }
  return wrong;
}

// Latency and up to how much more [ms].
constexpr std::pair<double, double> kDisplays[] = {
    {10, 0}, {33, kRefreshMs}, {60, 0}, {60, kRefreshMs}, {120, kRefreshMs}};

// All at once, since most of the time they wait.
TEST(LateDisplay, EachStoredPhotoIsOfThePictureThatWasShown) {
  const TemporaryFolder folder;
  std::vector<std::unique_ptr<XvfbDisplay>> displays;
  std::vector<pid_t> processes;
  for (const auto& [latency_ms, jitter_ms] : kDisplays) {
    const std::string name = std::to_string(displays.size());
    displays.push_back(std::make_unique<XvfbDisplay>(folder / ("display" + name), kProjectors * kWidth, kHeight));
    if (!displays.back()->running()) GTEST_SKIP() << "Xvfb is not installed";
    processes.push_back(fork());  // windows belong to the main thread of a process, and to one display
    if (processes.back() == 0) {
      const std::string error = capture_on(*displays.back(), latency_ms, jitter_ms, folder / name);
      if (!error.empty()) fmt::print(stderr, "{}\n", error);
      _exit(error.empty() ? 0 : 1);
    }
  }
  const Sequence sequence = capture::default_sequence(rig());
  EXPECT_GE(sequence.frames.size() * std::size(kDisplays), 300u);
  for (std::size_t i = 0; i < processes.size(); ++i) {
    int status = -1;
    waitpid(processes[i], &status, 0);
    EXPECT_EQ(status, 0) << kDisplays[i].first;
    EXPECT_EQ(wrong_photos(sequence, folder / std::to_string(i)), 0) << kDisplays[i].first;
  }
}

}  // namespace
}  // namespace countershade::testing
