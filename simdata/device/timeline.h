// What one projector shows when. Pictures change at refreshes, a while after they were sent; the primaries may take
// turns and the light may pulse. All times are seconds of one clock that runs from when the devices were switched on.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "calib/file/rig.h"
#include "simdata/device/colour_path.h"

namespace countershade::simdata {

struct Shown {
  std::shared_ptr<const Picture> picture;
  std::uint64_t hash = 0;  // equal pictures have equal ones
};

// Row y of `rows` is exposed from start + y / (rows - 1) rolling on.
struct RowExposure {
  double start = 0, exposure = 0, rolling = 0;
  int rows = 1;
};

// Share of the light of each eye's refreshes that reaches a camera.
struct Glasses {
  double left = 1, right = 1;
};

class Timeline {
 public:
  // Shows `black` since ever.
  Timeline(const SimulatedProjector& spec, std::uint64_t seed, Shown black);

  // Sends a picture per eye (equal ones where there is no stereo) at time `now`. It is seen from the first refresh
  // after now + latency + jitter on, never before one that was sent earlier. Returns the first refresh after now, when
  // the computer goes on.
  double show(Shown left, Shown right, double now);

  // One picture and its share of an exposure, of r, g, b: one for all rows, or one per row where they differ. 1 = seen
  // all the time, in all of its light.
  struct Part {
    Shown shown;
    std::vector<Light4> share;
  };
  // Everything that is seen during an exposure: the mean over each row's time of what is visible, times
  //
  //   wheel    3 while the primary's third of a turn is in the light, else 0
  //   pulses   2 during the first half of a period, else 0
  //   glasses  that of the eye whose refresh it is, left at even ones
  //   lamp     1 - warm_up exp(-t / warm_up_s), taken at the middle of the photo
  //
  // so whole turns, or whole periods, make no difference (both together do: pulses may miss a primary). Of wheels and
  // pulses with more than 20,000 edges per photo the mean is taken. `without_newest`: as if the last picture had not
  // been sent.
  std::vector<Part> parts(const RowExposure& exposure, const Glasses& glasses, bool without_newest = false) const;

 private:
  struct Sent {
    double from;
    Shown left, right;
  };
  double first_refresh_after(double time) const;

  SimulatedProjector spec_;
  std::uint64_t seed_, sent_count_ = 0;
  std::vector<Sent> sent_;  // by time; the first is the one visible when the last was sent
};

}  // namespace countershade::simdata
