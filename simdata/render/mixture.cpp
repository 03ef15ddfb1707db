// Light of pictures that share an exposure.
#include "simdata/render/simulator.h"
#include "simdata/render/simulator_state.h"

namespace countershade::simdata {

Image Simulator::mixed_light(int camera, std::span<const std::vector<PictureShare>> shown, const View* moved) const {
  CS_CHECK(shown.size() == state_->emitters.size(), "pictures of each projector of the rig");
  std::vector<PictureLight> light;
  for (std::size_t q = 0; q < shown.size(); ++q) {
    const Emitter& emitter = state_->emitters[q];
    if (shown[q].empty()) light.push_back(emitter.light_of({}, Light4::Zero()));
    for (std::size_t i = 0; i < shown[q].size(); ++i) {
      PictureLight one = emitter.light_of(*shown[q][i].picture, shown[q][i].share);
      if (i == 0) {
        light.push_back(std::move(one));
        continue;
      }
      PictureLight& sum = light.back();
      for (std::size_t k = 0; k < sum.blurred.size(); ++k) sum.blurred[k] += one.blurred[k];
      for (std::size_t k = 0; k < sum.block_mean.size(); ++k) sum.block_mean[k] += one.block_mean[k];
    }
  }
  const View& view = moved ? *moved : *state_->views.at(camera);
  return view.total(light, state_->indirect->solve(light, camera), *state_->indirect);
}

}  // namespace countershade::simdata
