// Where everything is: projectors, planes and chart extents from correspondences alone (Ceres inside).
#pragma once

#include <Eigen/Dense>
#include <optional>
#include <string>
#include <vector>

#include "calib/base/progress.h"
#include "calib/base/result.h"
#include "calib/file/rig.h"
#include "calib/geometry/lens.h"
#include "calib/geometry/screen.h"
#include "calib/image/image.h"

namespace countershade::solver {

// What the fit needs of one projector's correspondences: maps of the camera's size (NaN = none).
struct ProjectorObservation {
  ProjectorSpec spec;
  const Image* x = nullptr;      // projector column per camera pixel [px]
  const Image* y = nullptr;      // row
  const Image* sigma = nullptr;  // [projector px]
};

struct ProjectorFit {
  std::string id;
  Device device;      // world = camera frame
  double rms_px = 0;  // reprojection residual, projector pixels
  Eigen::Vector4d sigma =
      Eigen::Vector4d::Zero();  // of focal [px], principal column, principal row [px], distance [rel]
};

struct GeometryFit {
  std::vector<ProjectorFit> projectors;
  Screen screen;                                            // in the camera frame
  std::vector<std::shared_ptr<const PlaneSurface>> planes;  // the same surfaces
  double scale_known = 0;                                   // 1 when metres are known, else 0 (arbitrary scale)
  std::vector<double> angle_sigma;                          // per crease [rad]
  double rms_px = 0;                                        // over all projectors
  std::vector<std::string> notes;                           // what was assumed, what is weak
};

struct GeometryOptions {
  int planes = 0;  // 0 = found (each must explain >= min_plane_share of some projector's decoded pixels)
  double min_plane_share = 0.03;
  int max_points = 6000;  // correspondences in the bundle adjustment
  unsigned seed = 1;
};

// Fits projectors (focal length, principal point, pose; square pixels, no distortion) and planes to correspondences by
// bundle adjustment with the camera at the origin. The principal column has the prior of rig.toml (default: centred, 2
// % of the width; PHYSICS 6 says why). Scale: known_length if given, else the distance of the first plane is 1. Errors:
// kRefused, naming what is missing: too few decoded pixels; one plane per projector without a stated throw ratio and
// lens shift; no consistent pose.
Result<GeometryFit> fit_geometry(const Device& camera, const std::vector<ProjectorObservation>& observations,
                                 const ScreenSpec& screen, const GeometryOptions& options, Progress& progress);

}  // namespace countershade::solver
