// What a Simulator holds; for its own sources only.
#pragma once

#include <memory>
#include <mutex>
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
  std::vector<std::unique_ptr<View>> views;  // of the cameras, then of moved ones
  std::vector<int> viewers;                  // camera of each view
  std::vector<CameraSpec> cameras;
  std::mutex mutex;  // of views, while a moved one is added

  std::vector<PictureLight> light_of(std::span<const Picture> pictures) const;
};

}  // namespace countershade::simdata
