// What a Simulator holds; for its own sources only.
#pragma once

#include <memory>
#include <vector>

#include "simdata/render/simulator.h"
#include "simdata/render/view.h"

namespace countershade::simdata {

struct Simulator::State {
  State(const Rig& given_rig, const Simulation& given) : rig(given_rig), simulation(given), paint(given) {}
  Rig rig;
  Simulation simulation;
  Paint paint;
  Screen screen;
  std::shared_ptr<const Scene> scene;
  std::vector<Emitter> emitters;
  std::unique_ptr<IndirectLight> indirect;
  std::vector<std::unique_ptr<View>> views;
  std::vector<CameraSpec> cameras;

  std::vector<PictureLight> light_of(std::span<const Picture> pictures) const;
};

}  // namespace countershade::simdata
