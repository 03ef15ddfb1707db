// The model of a simulated room by its truth instead of by a fit: what perfect measurement would give.
#pragma once

#include "simdata/render/simulator.h"
#include "solver/fit/patch_data.h"
#include "solver/transport/model.h"

namespace countershade::bench {

struct TrueModel {
  solver::Model model;  // world = frame of the first camera
  solver::PixelGeometry pixels;
};
// Patches nu x nv per wall. The direct gains come from the simulator's noise-free direct light.
Result<TrueModel> true_model(const simdata::Simulator& simulator, int nu, int nv, Progress& progress);

// The target of the `direct` intent: direct light of the plain show, through the camera's optics.
Image true_target(const simdata::Simulator& simulator, int camera, std::span<const Picture> pictures);

}  // namespace countershade::bench
