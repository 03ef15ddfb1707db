// Light out, light in: the two interfaces that every camera and every projector output stands behind.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "calib/base/result.h"
#include "calib/image/image.h"

namespace countershade::capture {

// One exposure as the camera gave it: stored numbers, before any interpretation.
struct Exposure {
  Image values;  // (height, width, 1 or 3), 0..full_scale
  double full_scale = 65535;
  double exposure_ms = 0;
  double timestamp_s = 0;  // device clock
  std::uint64_t counter = 0;
  double saturated = 0;  // share of pixels at full scale
  int lost = 0;          // photos before this one that did not arrive whole, and were taken again
};

// What a camera has been like since it was opened.
struct Health {
  int photos = 0;       // that came
  int again = 0;        // that did not arrive whole and were taken again
  int clock_back = 0;   // whose time was before that of the photo before
  std::string failure;  // why the last thing that was asked of it failed; empty: it did not
  // Why its photos, or those that are to come, are not to be trusted; empty: they are.
  std::string unhealthy() const;
};

class Camera {
 public:
  virtual ~Camera() = default;
  virtual const std::string& id() const = 0;
  // Locks exposure and everything automatic; `exposure_ms` 0 = the device's default.
  virtual Result<void> arm(double exposure_ms) = 0;
  // Exposes once, now, and returns the photo. Requires arm().
  virtual Result<Exposure> trigger() = 0;
  // Of a camera that is watched (health.h); else nothing is known, which is taken for health.
  virtual Health health() const { return {}; }
};

class Projector {
 public:
  virtual ~Projector() = default;
  virtual const std::string& id() const = 0;
  virtual int width() const = 0;
  virtual int height() const = 0;
  virtual double refresh_hz() const { return 0; }  // 0 = unknown
  // Shows a picture (encoded, own resolution: a Bug otherwise) and returns once the display has taken it; a slow
  // display shows it later.
  virtual Result<void> show(const Picture& picture) = 0;
  // The two halves of show(), so that several projectors change at one refresh: the picture is handed over; the display
  // has taken it.
  virtual Result<void> hand_over(const Picture& picture) { return show(picture); }
  virtual Result<void> taken() { return {}; }
  // Shows a picture per eye, in turns. Errors: kUnsupported where both eyes see the same.
  virtual Result<void> show_stereo(const Picture& left, const Picture& right);
};

// All devices of a rig, opened.
struct Devices {
  std::vector<std::unique_ptr<Camera>> cameras;
  std::vector<std::unique_ptr<Projector>> projectors;
  std::function<void(double ms)> clock;  // how time passes for them; empty = as for everybody
  Projector* projector(const std::string& id) const;
  // Time between two refreshes of the slowest display; that of 60 Hz where none is known.
  double refresh_ms() const;
  // Returns when that much of their time has passed.
  void wait(double ms) const;
};

}  // namespace countershade::capture
