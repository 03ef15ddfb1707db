#include "tools/bench/truth.h"

#include <algorithm>

#include "simdata/room/rooms.h"
#include "solver/transport/form_factor.h"

namespace countershade::bench {

namespace {

// The walls of the room in the camera's frame.
void add_walls(const simdata::Simulator& simulator, const Pose& camera_from_world, solver::GeometryFit& geometry) {
  geometry.screen = {};
  for (const auto& surface : simulator.screen().surfaces) {
    const Eigen::Vector3d o = surface->point(0, 0), u = surface->point(1, 0) - o, v = surface->point(0, 1) - o;
    geometry.planes.push_back(std::make_shared<PlaneSurface>(camera_from_world * o, camera_from_world.rotation * u,
                                                             camera_from_world.rotation * v));
    geometry.screen.surfaces.push_back(geometry.planes.back());
  }
  geometry.screen.creases = simulator.screen().creases;
}

Photo clean_photo(const Image& light) {
  return {light, Mask(light.width(), light.height(), 1, 1), 0};
}

}  // namespace

Image true_target(const simdata::Simulator& simulator, int camera, std::span<const Picture> pictures) {
  return simulator.optics(camera, simulator.light(camera, pictures).direct);
}

Result<TrueModel> true_model(const simdata::Simulator& simulator, int nu, int nv, Progress& progress) {
  const Simulation& room = simulator.simulation();
  const Rig& rig = simulator.rig();
  CS_TRY(const Device camera, simdata::true_camera(room, rig.cameras[0].id));
  const Pose camera_from_world = camera.device_from_world;
  solver::GeometryFit geometry;
  add_walls(simulator, camera_from_world, geometry);
  TrueModel result;
  solver::Model& model = result.model;
  model.screen = geometry.screen;
  model.planes = geometry.planes;
  model.patches = Patches(std::vector<std::pair<int, int>>(geometry.planes.size(), {nu, nv}));
  model.F = solver::form_factors(model.screen, model.patches, solver::FormFactorMethod::kExact, progress);
  model.G = solver::receiver_form_factors(model.screen, model.patches,
                                          solver::receiver_points(model.patches, model.receiver_factor), progress);
  model.k = model.e = solver::Radiosity::Zero(model.patches.size(), 3);
  for (int i = 0; i < model.patches.size(); ++i)
    for (int c = 0; c < 3; ++c)
      model.k(i, c) = static_cast<float>(room.surfaces[model.patches.surface_of(i)].albedo[c]);
  for (const ProjectorSpec& spec : rig.projectors) {
    CS_TRY(Device device, simdata::true_projector(room, rig, spec.id));
    device.device_from_world = device.device_from_world * camera_from_world.inverse();
    geometry.projectors.push_back({spec.id, device, 0, {}});
    solver::ProjectorModel projector;
    projector.id = spec.id;
    CS_TRY(projector.response.curve, Response::parse(spec.response));
    projector.response.black_level = spec.black_level;
    projector.device = device;
    projector.map = solver::pixel_map(device, model.screen);
    model.projectors.push_back(std::move(projector));
  }
  const Device at_origin{camera.lens, {}};
  result.pixels = solver::pixel_geometry(at_origin, geometry, model.patches);
  const solver::PatchFrame dark{solver::Radiosity::Zero(model.patches.size(), 3), {}, {}, {true, true, true}};
  for (std::size_t q = 0; q < model.projectors.size(); ++q) {
    std::vector<Picture> white(model.projectors.size()), black(model.projectors.size());
    const Lens& lens = model.projectors[q].device.lens;
    white[q] = Picture(lens.width(), lens.height(), 3, 65535);
    const Photo lit = clean_photo(simulator.light(0, white).direct),
                unlit = clean_photo(simulator.light(0, black).direct);
    model.projectors[q].gain = solver::gain_charts(result.pixels, model, static_cast<int>(q), lit, unlit, dark, dark);
  }
  model.white = 0;
  for (const solver::ProjectorModel& p : model.projectors)
    for (const Image& gain : p.gain)
      model.white = std::max<double>(model.white, *std::max_element(gain.data().begin(), gain.data().end()));
  return result;
}

}  // namespace countershade::bench
