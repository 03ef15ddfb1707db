#include "simdata/render/simulator.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "calib/base/parallel.h"
#include "calib/base/random.h"
#include "simdata/device/sensor.h"
#include "simdata/render/simulator_state.h"
#include "simdata/room/room_check.h"
#include "simdata/room/rooms.h"

namespace countershade::simdata {

namespace {

// Where a projector's picture meets surfaces.
struct Throw {
  double distance = 0;                        // mean; 0 when it lights none
  std::array<double, 2> depths{HUGE_VAL, 0};  // nearest and farthest, along its axis
};

Throw throw_of(const Device& projector, const Scene& scene) {
  Throw found;
  double sum = 0;
  int count = 0;
  for (int j = 0; j < 9; ++j)
    for (int i = 0; i < 9; ++i) {
      const Eigen::Vector2d pixel((i + 0.5) / 9 * projector.lens.width() - 0.5,
                                  (j + 0.5) / 9 * projector.lens.height() - 0.5);
      const Ray ray = projector.ray(pixel);
      const SceneHit hit = scene.look(ray);
      if (hit.at.surface < 0 || !(hit.front || scene.transmission(hit.at.surface) > 0)) continue;
      sum += (hit.at.x - ray.origin).norm(), ++count;
      const double depth = (projector.device_from_world * hit.at.x).z();
      found.depths = {std::min(found.depths[0], depth), std::max(found.depths[1], depth)};
    }
  if (count == 0) return found;
  found.distance = sum / count;
  // The picture's rim lies half a step beyond the outermost rays.
  const double beyond = (found.depths[1] - found.depths[0]) / 8;
  found.depths = {std::max(found.depths[0] - beyond, 0.5 * found.depths[0]), found.depths[1] + beyond};
  return found;
}

const SimulatedCamera& camera_of(const Simulation& simulation, const std::string& id) {
  return *std::find_if(simulation.cameras.begin(), simulation.cameras.end(), [&](const auto& c) { return c.id == id; });
}

const SimulatedProjector& projector_of(const Simulation& simulation, const std::string& id) {
  return *std::find_if(simulation.projectors.begin(), simulation.projectors.end(),
                       [&](const auto& p) { return p.id == id; });
}

// Exposure: the 99.9th percentile of the brightest channel, all projectors white, comes to white_level.
float exposure_scale(const View& view, const TrueLight& white) {
  const int channels = view.spec().channels;
  std::vector<float> brightest(white.direct.pixels());
  for (std::size_t i = 0; i < brightest.size(); ++i)
    for (int c = 0; c < channels; ++c)
      brightest[i] =
          std::max(brightest[i], white.direct.data()[i * channels + c] + white.indirect.data()[i * channels + c]);
  const std::size_t rank = std::min(brightest.size() - 1, static_cast<std::size_t>(0.999 * brightest.size()));
  std::nth_element(brightest.begin(), brightest.begin() + rank, brightest.end());
  return brightest[rank] > 0 ? static_cast<float>(view.spec().white_level / brightest[rank]) : 0;
}

}  // namespace

Simulator::Simulator(std::unique_ptr<State> state) : state_(std::move(state)) {}
Simulator::~Simulator() = default;

const Rig& Simulator::rig() const {
  return state_->rig;
}
const Simulation& Simulator::simulation() const {
  return state_->simulation;
}
const Screen& Simulator::screen() const {
  return state_->screen;
}
double Simulator::scale(int camera) const {
  return state_->views.at(camera)->scale();
}

Result<std::shared_ptr<Simulator>> Simulator::make(const Rig& rig, const Simulation& simulation, Progress& progress) {
  CS_TRY_VOID(check_room(rig, simulation));
  auto state = std::make_unique<State>(rig, simulation);
  state->screen = room_screen(simulation);
  CS_TRY(std::vector<std::shared_ptr<const Shape>> shapes, make_shapes(simulation));
  CS_TRY_VOID(check_layout(rig, simulation, shapes));
  std::vector<double> transmission;
  for (const SimulatedSurface& s : simulation.surfaces) transmission.push_back(s.transmission);
  CS_TRY(state->scene, Scene::make(std::move(shapes), std::move(transmission)));
  std::vector<Picture> white;
  double power = 0;
  for (const ProjectorSpec& spec : rig.projectors) {
    CS_TRY(const Device device, true_projector(simulation, rig, spec.id));
    const Throw thrown = throw_of(device, *state->scene);
    if (!(thrown.distance > 0))
      return error(ErrorCode::kBadValue,
                   "simulated projector '{}' lights no surface's lit side; turn its target to one, or turn the surface "
                   "round (along_u leads right as seen from the lit side, faces of a mesh run anticlockwise, and "
                   "mesh_scale = 0.001 is for files in millimetres)",
                   spec.id);
    state->emitters.emplace_back(projector_of(simulation, spec.id), device, simulation.block_px, thrown.depths);
    if (power == 0) power = state->emitters.front().power_for(thrown.distance);
    state->emitters.back().set_power(power);
    white.emplace_back(spec.resolution[0], spec.resolution[1], 3, 65535);
  }
  std::vector<Device> cameras;
  std::vector<Eigen::Vector3d> viewers;
  for (const CameraSpec& spec : rig.cameras) {
    CS_TRY(cameras.emplace_back(), true_camera(simulation, spec.id));
    viewers.push_back(cameras.back().position());
  }
  CS_TRY(state->indirect,
         IndirectLight::make(state->scene, state->emitters, state->paint, simulation, std::move(viewers), progress));
  progress.note(state->indirect->effort());
  std::shared_ptr<Simulator> simulator(new Simulator(std::move(state)));
  State& made = *simulator->state_;
  for (const CameraSpec& spec : rig.cameras) {
    progress.step("views", static_cast<double>(made.views.size()), static_cast<double>(rig.cameras.size()));
    const int viewer = static_cast<int>(made.views.size());
    const Device& device = cameras[viewer];
    made.cameras.push_back(spec);
    made.views.push_back(std::make_unique<View>(camera_of(simulation, spec.id), device, *made.scene, made.emitters,
                                                made.paint, *made.indirect, viewer, simulation.ambient));
    View& view = *made.views.back();
    const float scale = exposure_scale(view, simulator->light(viewer, white));
    if (!(scale > 0))
      return error(
          ErrorCode::kBadValue,
          "simulated camera '{}' sees no light: no lit surface is in its picture, or all of them are black; turn its "
          "target to one",
          spec.id);
    view.set_scale(scale);
  }
  progress.step("views", 1, 1);
  return simulator;
}

std::vector<PictureLight> Simulator::State::light_of(std::span<const Picture> pictures) const {
  CS_CHECK(pictures.size() == emitters.size(), "one picture per projector of the rig");
  std::vector<PictureLight> light;
  for (std::size_t q = 0; q < emitters.size(); ++q) light.push_back(emitters[q].light_of(pictures[q]));
  return light;
}

TrueLight Simulator::light(int camera, std::span<const Picture> pictures) const {
  const View& view = *state_->views.at(camera);
  const std::vector<PictureLight> light = state_->light_of(pictures);
  return {view.direct(light, *state_->indirect), view.reflected(state_->indirect->solve(light, camera))};
}

Image Simulator::total_light(int camera, std::span<const Picture> pictures) const {
  const std::vector<PictureLight> light = state_->light_of(pictures);
  return state_->views.at(camera)->total(light, state_->indirect->solve(light, camera), *state_->indirect);
}

std::shared_ptr<const View> Simulator::moved_view(int camera, const Pose& moved_from_camera) const {
  const View& view = *state_->views.at(camera);
  Device device = view.device();
  device.device_from_world = moved_from_camera * device.device_from_world;
  auto moved = std::make_shared<View>(view.spec(), device, *state_->scene, state_->emitters, state_->paint,
                                      *state_->indirect, camera, state_->simulation.ambient);
  moved->set_scale(view.scale());
  return moved;
}

Image Simulator::optics(int camera, const Image& light) const {
  return through_lens(light, state_->views.at(camera)->spec());
}

capture::Exposure Simulator::expose(int camera, const Image& light, double exposure_ms, std::uint64_t draw) const {
  CS_CHECK(exposure_ms > 0, "an exposure takes time");
  const CameraSpec& spec = state_->cameras.at(camera);
  const std::uint64_t sensor = mix(mix(state_->simulation.seed) ^ hash_name(spec.id));
  return simdata::expose(light, state_->views[camera]->spec(), spec, exposure_ms, sensor ^ mix(draw), sensor);
}

TrueGeometry Simulator::geometry(int camera, const View* moved) const {
  const View& view = moved != nullptr ? *moved : *state_->views.at(camera);
  const int width = view.spec().resolution[0], height = view.spec().resolution[1];
  constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();
  const Image nothing(width, height, 1, kNaN);
  TrueGeometry g{nothing,
                 Image(width, height, 3, kNaN),
                 Image(width, height, 1, -1),
                 nothing,
                 nothing,
                 Image(width, height, 3, kNaN),
                 {},
                 {}};
  g.projector_x.assign(state_->emitters.size(), nothing);
  g.projector_y = g.projector_x;
  parallel_for(height, [&](int y) {
    for (int x = 0; x < width; ++x) {
      const SceneHit hit = state_->scene->look(view.device().ray({static_cast<double>(x), static_cast<double>(y)}));
      if (hit.at.surface < 0) continue;
      const double texture = state_->paint.texture(hit.at);
      g.depth.at(x, y) = static_cast<float>(hit.t);
      for (int c = 0; c < 3; ++c) {
        g.normal.at(x, y, c) = static_cast<float>(hit.at.normal[c]);
        g.albedo.at(x, y, c) = hit.front ? static_cast<float>(state_->paint.base()[hit.at.surface][c] * texture) : 0;
      }
      g.surface.at(x, y) = static_cast<float>(hit.at.surface);
      g.u.at(x, y) = static_cast<float>(hit.at.u), g.v.at(x, y) = static_cast<float>(hit.at.v);
      for (std::size_t q = 0; hit.front && q < state_->emitters.size(); ++q)
        if (const auto beam = state_->emitters[q].beam(*state_->scene, hit.at)) {
          g.projector_x[q].at(x, y) = static_cast<float>(beam->pixel.x());
          g.projector_y[q].at(x, y) = static_cast<float>(beam->pixel.y());
        }
    }
  });
  return g;
}

}  // namespace countershade::simdata
