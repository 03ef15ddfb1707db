// The truth of a simulated room as files beside its session (docs/rooms.md).
#pragma once

#include <filesystem>

#include "calib/base/progress.h"
#include "calib/base/result.h"
#include "calib/file/session.h"
#include "simdata/render/simulator.h"

namespace countershade::tools {

struct TruthOptions {
  std::array<int, 2> patches{16, 12};  // per surface
  int rays = 4096;                     // per patch
  bool light = false;                  // direct and indirect images of every frame, too
};

// Error: kBadValue: more than 4096 patches.
Result<void> check_truth(const Simulation& simulation, const TruthOptions& options);

// Writes a folder of that name, which must not exist yet (kExists):
//   CAMERA.exr             depth [m], nx ny nz, ar ag ab (albedo), surface, u, v per camera pixel centre
//   CAMERA-PROJECTOR.exr   x, y: projector pixel, NaN where it does not light the point
//   patches/               form_factor, form_factor_sigma (N, N), area (N), albedo (N, 3), irradiance,
//                          irradiance_sigma (N, projectors), transport (3, N, N): .npy, as in PatchTruth
//   DEVICE.cameramodel     every device, with its place
//   devices.json           camera scales; reference irradiance; simulation.toml: every parameter
//   light/CAMERA/NNNN.exr  on request: direct and indirect light (dr dg db, ir ig ib) of every frame, before optics
// Errors: check_truth.
Result<void> write_truth(const simdata::Simulator& simulator, const Sequence& sequence,
                         const std::filesystem::path& folder, const TruthOptions& options, Progress& progress);

}  // namespace countershade::tools
