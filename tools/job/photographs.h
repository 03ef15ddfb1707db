// The three photographs that tell whether a compensation works: plain show, compensated show, and the measured target.
#pragma once

#include <span>
#include <vector>

#include "calib/base/progress.h"
#include "calib/base/result.h"
#include "calib/file/rig.h"
#include "capture/device/device.h"
#include "solver/fit/patch_data.h"

namespace countershade::tools {

// Averages of linear photos, (height, width, 3 or 1), 1 = full scale.
struct Photographs {
  Image uncompensated, compensated, target;
  Image black;             // of all projectors, which is part of the target; empty: of photos from elsewhere
  double pixel_noise = 0;  // standard deviation of one pixel of the averages, at mid level
  int exposures = 0;       // taken in all
};

// Mean of `count` exposures of what the projectors show now, saturated pixels included as they are.
Result<Image> average_exposure(capture::Camera& camera, const CameraSpec& spec, int count);

// The target is photographed, never computed: each projector alone shows its picture behind four stripe masks shifted
// by half a stripe. Where a pixel is well inside a stripe, lit minus dark is its direct light, since the indirect light
// of complementary fine stripes is the same (Nayar et al. 2006). Sum over projectors, plus black, in which the light of
// the room and of black has bounced, too: no mask tells that (verification.h).
// veil: the camera's glare by its calibration (PhotometricFit::veil), taken out of every photo.
Result<Photographs> photograph(const capture::Devices& devices, const CameraSpec& camera,
                               const solver::PixelGeometry& pixels, std::span<const Picture> plain,
                               std::span<const Picture> compensated, double veil, int exposures, Progress& progress);

}  // namespace countershade::tools
