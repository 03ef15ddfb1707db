// Light out and light in for the session runner: shows pictures on all projectors, photographs them with all cameras,
// and knows how late the display is.
#pragma once

#include <array>
#include <chrono>
#include <vector>

#include "calib/base/progress.h"
#include "capture/session/frame_judge.h"
#include "capture/session/latency.h"
#include "capture/session/runner.h"

namespace countershade::capture {

using Pictures = std::vector<Picture>;  // per projector of the sequence

struct CameraSlot {
  Camera* device = nullptr;
  const CameraSpec* spec = nullptr;
  std::vector<double> exposures;  // at least one; 0 = the device's default
};

// Photos of one frame by one camera.
struct Shot {
  std::vector<Image> stored;            // per exposure; empty image = was not wanted
  Bins bins;                            // first exposure
  double from_ms = 0, exposure_ms = 0;  // of it, by the camera's clock
};
using Wanted = std::vector<std::vector<bool>>;  // [camera][exposure]

Views views_of(const std::vector<Shot>& shots);

class Stage {
 public:
  // All of them must outlive it. `judge` is told what was seen last and how noisy it is.
  Stage(const Rig& rig, const Sequence& sequence, const Devices& devices, const CaptureOptions& options,
        FrameJudge& judge, Progress& progress)
      : rig_(rig), sequence_(sequence), devices_(devices), options_(options), judge_(judge), progress_(progress) {}

  // Arms every camera of the rig, finds every projector of the sequence. Error: kDevice.
  Result<void> find_devices();
  const std::vector<CameraSlot>& cameras() const { return cameras_; }
  // Width, height, channels of a camera's photos; width 0 = not known yet. Photos of another size are an error.
  std::array<int, 3>& size(std::size_t camera) { return size_[camera]; }

  Result<Pictures> pictures_of(const Frame& frame) const;
  Pictures plain(std::uint16_t value) const;

  // Hands the pictures over, waits, and returns once the displays have taken them.
  Result<void> show(const Pictures& pictures, double wait_ms);
  // As a frame is shown before its photo: as often and as long before as the display is late; `late` times later yet.
  Result<void> show_for_photo(const Pictures& pictures, int shows, int late);
  // The same in two halves, for a frame that is shown once: between them there is time for other work.
  Result<void> show_ahead(const Pictures& pictures);
  Result<void> await_photo(int late = 0);
  Result<std::vector<Shot>> photograph(const Wanted& wanted);
  // Photographs what is shown; first exposures only.
  Result<std::vector<Shot>> look() { return photograph(first_exposures()); }
  // Shows so often and so long before that no latency is left, and looks twice to learn the noise.
  Result<std::vector<Shot>> settle(const Pictures& pictures);

  // How late the display is, by steps between these pictures; `former` is what is seen when it is called.
  Result<void> measure_latency(const Pictures& pictures, const Pictures& former);
  // A frame was seen at the n-th retake only (0 = at once).
  void came_late(int attempt);
  int shows() const { return lateness_.shows; }
  const Lateness& lateness() const { return lateness_; }
  int lost() const { return lost_; }  // photos that a camera had to take again since they did not arrive whole

 private:
  struct Arrival {
    bool seen = false;
    Appearance appeared;  // since the first photo's start
    double exposure_ms = 0;
    Views settled;
  };
  Result<void> hand_over(const Pictures& pictures);
  Result<void> wait_until_taken(double wait_ms);
  Result<Exposure> expose(const CameraSlot& camera, std::size_t e);
  Wanted first_exposures() const;
  Result<Arrival> wait_for(const Pictures& pictures, int shows, double wait_ms);
  Result<void> count_shows(const Pictures& pictures);

  const Rig& rig_;
  const Sequence& sequence_;
  const Devices& devices_;
  const CaptureOptions& options_;
  FrameJudge& judge_;
  Progress& progress_;
  std::vector<CameraSlot> cameras_;
  std::vector<Projector*> projectors_;
  std::vector<std::array<int, 3>> size_;
  Lateness lateness_{1, 0};
  bool late_ = false;  // the former frame came late
  int lost_ = 0;
  std::chrono::steady_clock::time_point ahead_since_;  // when pictures were shown ahead
};

}  // namespace countershade::capture
