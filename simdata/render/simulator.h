// Photographs of a room that never was. Primary hits and direct light exact per pixel; indirect light by ray casting
// with any number of bounces, once per block of projector pixels, and reused for every pattern, since a photo is linear
// in it.
#pragma once

#include <memory>
#include <span>

#include "calib/base/progress.h"
#include "calib/file/rig.h"
#include "calib/geometry/lens.h"
#include "calib/geometry/screen.h"
#include "capture/device/device.h"
#include "simdata/device/colour_path.h"
#include "simdata/device/faults.h"

namespace countershade::simdata {

// Noise-free light on a camera, in units of full scale at the reference exposure, each (height, width, channels).
struct TrueLight {
  Image direct;    // first hit from projectors, black level included, and from the surround
  Image indirect;  // everything that bounced
};

// Truth beside the photos, per camera pixel centre.
struct TrueGeometry {
  Image depth;                                  // distance along the ray [m], NaN where nothing is hit
  Image normal;                                 // (height, width, 3), world
  Image surface, u, v;                          // chart point, surface -1 where nothing is hit
  Image albedo;                                 // (height, width, 3), NaN where nothing is hit
  std::vector<Image> projector_x, projector_y;  // per projector, NaN where it does not light the point
};

class View;
struct PatchTruth;

class Simulator {
 public:
  // Traces everything that does not depend on a pattern. Cameras and projectors are the simulated ones of the rig, in
  // its order. Errors: kBadValue for impossible rooms.
  static Result<std::shared_ptr<Simulator>> make(const Rig& rig, const Simulation& simulation, Progress& progress);
  ~Simulator();

  const Rig& rig() const;
  const Simulation& simulation() const;
  // The surfaces as planes with charts; empty for a room that has others.
  const Screen& screen() const;
  // Full-scale units per radiosity 1 (reference irradiance, albedo 1) of a camera at the middle of its picture.
  double scale(int camera) const;
  // From where the camera stands, or from where it was moved to (moved_view).
  TrueGeometry geometry(int camera, const View* moved = nullptr) const;
  // pictures[q]: what projector q of the rig is sent; empty = black.
  TrueLight light(int camera, std::span<const Picture> pictures) const;
  // Direct and indirect light together, at less cost.
  Image total_light(int camera, std::span<const Picture> pictures) const;
  // The same of an exposure during which each projector shows its pictures for shares of the time (of r, g, b). One
  // without pictures is dark, which is less than black.
  struct PictureShare {
    const Picture* picture;
    Light4 share;
  };
  // From where the camera stands, or from where it was moved to.
  Image mixed_light(int camera, std::span<const std::vector<PictureShare>> shown, const View* moved = nullptr) const;
  // What a camera sees after somebody has moved it: moved_from_camera in its own coordinates (x right, y down, z
  // forward; m). What gloss mirrors is still that towards the old place.
  std::shared_ptr<const View> moved_view(int camera, const Pose& moved_from_camera) const;
  // What the lens makes of light: through_lens of the camera.
  Image optics(int camera, const Image& light) const;
  // One exposure of light after optics(): photon and read noise, quantisation. `draw` numbers the noise.
  capture::Exposure expose(int camera, const Image& light, double exposure_ms, std::uint64_t draw) const;
  // Full path tracing of the indirect light at given camera pixels (the check of the shortcut), `paths` per pixel:
  // mean and standard error, (pixels, channels).
  struct Traced {
    std::vector<double> mean, standard_error;
  };
  Traced trace_indirect(int camera, std::span<const Picture> pictures, std::span<const Eigen::Vector2d> pixels,
                        int paths) const;

  // Form factors and transfer of nu x nv patches per surface, by `rays` per patch, at least 100. Gloss and
  // light-directing screens count as diffuse.
  PatchTruth patch_truth(int nu, int nv, int rays, Progress& progress) const;

 private:
  struct State;
  explicit Simulator(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

// Cameras and projectors of a simulated rig, sharing one room and one clock, which show(), trigger() and
// Devices::wait() move on: show() to the projector's next refresh, trigger() by its exposure, rolling shutter and 20 ms
// of reading out. A photo is the mean of what was visible while each row was exposed (Timeline). The noise of a photo
// depends on the seed, the camera, the pictures seen, the exposure and the number of photos of that exposure since the
// last show(), so a session that was interrupted and resumed has the same bytes as one that was not, unless the time
// itself is seen (wheel, pulses, jitter, warm-up, lamps on the mains); faults, which act on photos by number, begin
// anew.
capture::Devices simulated_devices(std::shared_ptr<const Simulator> simulator, std::vector<Fault> faults = {});

}  // namespace countershade::simdata
