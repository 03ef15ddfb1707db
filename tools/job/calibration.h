// From a session to a calibration: decode, geometry, form factors, photometric fit, model.
#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "calib/base/progress.h"
#include "calib/base/result.h"
#include "calib/file/file.h"
#include "calib/file/session.h"
#include "capture/pattern/decode.h"
#include "solver/fit/geometry_fit.h"
#include "solver/fit/patch_data.h"
#include "solver/transport/model.h"

namespace countershade::tools {

struct CalibrateOptions {
  // What the capture has decoded, of camera_to_use; projectors that are not among them are decoded from the photos.
  std::vector<capture::Correspondence> decoded;
  std::array<int, 2> patches{0, 0};  // per surface; {0, 0} = auto: square patches, 32 along the longest chart side
};

// How the decoding of one projector went.
struct DecodeSummary {
  std::string projector;
  double accepted = 0;  // share of the lit pixels
  std::size_t lit = 0;
  std::size_t judged = 0;     // accepted pixels that the photometric block patterns, which decoding does not see, judge
  double wrong = 0;           // share of wrong codes among them (capture/diagnose/held_out.h)
  double expected_wrong = 0;  // share that is more than 1 px off, by their sigma
  std::map<std::string, double> rejected;  // by reason: share of the lit pixels
};

// "phase inconsistent .12 %, mixed pixel .03 %", the most frequent first; empty where nothing was rejected.
std::string rejected_text(const std::map<std::string, double>& rejected);

struct CalibrationSummary {
  std::vector<DecodeSummary> decoded;
  bool has_geometry = false, has_model = false;
  std::vector<double> reprojection_px;  // per projector
  std::vector<double> crease_angle_deg, crease_sigma_deg;
  double chi2 = 0, held_out_error = 0, held_out_p99 = 0;  // fractions of white
  double mean_k[3] = {0, 0, 0};
  double veil = 0;                 // the camera's glare: share of a photo's mean that lies evenly over it
  int frames = 0;                  // photometric ones that were fitted
  int session_frames = 0;          // of the whole capture
  std::vector<std::string> notes;  // what was assumed, what is missing
};

// calibration/ (the folder appears whole):
//   calibration.json   summary; rig.toml; correspondence/<camera>-<projector>.exr, reasons.json, pictures of the
//   reasons model/             see solver/transport/model.h; absent when photos or lens model do not allow it
//   geometry/camera.cameramodel  the camera that the model's world is the frame of
// Sessions of several cameras: the first one with a lens model counts.
Result<CalibrationSummary> calibrate(const std::filesystem::path& session, const std::filesystem::path& out,
                                     const CalibrateOptions& options, Progress& progress,
                                     const FillFolder& record = {});

// The first camera with a lens model, else the first.
const CameraSpec& camera_to_use(const Rig& rig);

// What verify and compensate need of a calibration folder.
struct Calibration {
  Rig rig;
  Device camera;
  std::string camera_id;
  solver::Model model;
  CalibrationSummary summary;
};
// Errors: kBadFile; kRefused when the calibration holds no model (says what was missing).
Result<Calibration> open_calibration(const std::filesystem::path& folder);

// Camera pixels of a calibrated model.
solver::PixelGeometry pixels_of(const Calibration& calibration);

}  // namespace countershade::tools
