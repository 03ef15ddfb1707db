#include "tools/job/devices.h"

#include <algorithm>
#include <cmath>

#include "calib/photometry/response.h"
#include "capture/device/aravis/aravis.h"
#include "capture/device/command.h"
#include "capture/device/health.h"
#include "capture/device/video/libcamera.h"
#include "capture/device/video/v4l2.h"
#include "capture/device/window.h"

namespace countershade::tools {

namespace {

// What no camera could see, or nobody could trigger, before anything is opened.
Result<void> check_real(const Rig& rig) {
  for (const CameraSpec& camera : rig.cameras) {
    if (camera.backend == "simulated")
      return error(ErrorCode::kBadValue,
                   "camera '{}' is simulated, another one of the rig is not: none would see the other's light; state "
                   "one backend for all",
                   camera.id);
    if (camera.backend == "folder")
      return error(ErrorCode::kDevice,
                   "camera '{}': backend '{}' cannot be triggered by this program; state the command that takes a "
                   "photo (backend = \"command\"), or photograph the pictures that `countershade patterns` writes by "
                   "hand and use `countershade import`",
                   camera.id, camera.backend);
  }
  for (const ProjectorSpec& p : rig.projectors)
    if (p.output != "window")
      return error(ErrorCode::kBadValue,
                   "projector '{}': output = \"{}\" lights nothing that camera '{}' could see; set output = \"window\" "
                   "and monitor as `countershade devices` lists it",
                   p.id, p.output, rig.cameras[0].id);
  return {};
}

Result<std::unique_ptr<capture::Camera>> open_camera(const CameraSpec& camera) {
  if (camera.backend == "v4l2") return capture::open_v4l2_camera(camera.id, camera.device);
  if (camera.backend == "libcamera") return capture::open_libcamera_camera(camera.id, camera.device);
  if (camera.backend == "command") return capture::open_command_camera(camera.id, camera.device);
  return capture::open_aravis_camera(camera.id, camera.device);
}

// Cameras that photograph what monitors of this computer show.
Result<capture::Devices> open_real(const Rig& rig) {
  CS_TRY_VOID(check_real(rig));
  capture::Devices devices;
  for (const CameraSpec& camera : rig.cameras) {
    CS_TRY(auto opened, open_camera(camera));
    devices.cameras.push_back(std::move(opened));
  }
  int left = 0;  // of windows that have no monitor
  for (const ProjectorSpec& p : rig.projectors) {
    CS_TRY(auto opened, capture::open_window_projector(p.id, p.resolution[0], p.resolution[1], p.monitor,
                                                       "countershade " + p.id, left));
    if (p.monitor.empty()) left += p.resolution[0];
    devices.projectors.push_back(std::move(opened));
  }
  return devices;
}

void watch(capture::Devices& devices) {
  for (auto& camera : devices.cameras) camera = capture::watched(std::move(camera));
}

}  // namespace

Result<OpenDevices> open_devices(const Rig& rig, const std::filesystem::path& simulation_file, Progress& progress,
                                 std::vector<simdata::Fault> faults, std::optional<int> samples) {
  const bool simulated =
      std::all_of(rig.cameras.begin(), rig.cameras.end(), [](const CameraSpec& c) { return c.backend == "simulated"; });
  if (!simulated) {
    OpenDevices open;
    CS_TRY(open.devices, open_real(rig));
    watch(open.devices);
    return open;
  }
  CS_TRY(Simulation simulation, read_simulation(simulation_file));
  simulation.samples = samples.value_or(simulation.samples);
  CS_TRY(std::shared_ptr<simdata::Simulator> simulator, simdata::Simulator::make(rig, simulation, progress));
  OpenDevices open;
  open.devices = simdata::simulated_devices(simulator, std::move(faults));
  watch(open.devices);
  open.simulator = std::move(simulator);
  return open;
}

Photo photo_of(const capture::Exposure& exposure, const CameraSpec& camera) {
  const double full = camera.full_scale.value_or(exposure.full_scale);
  const Response response = Response::parse(camera.response).value();
  Photo photo;
  photo.exposure_ms = exposure.exposure_ms;
  photo.value = Image(exposure.values.width(), exposure.values.height(), exposure.values.channels());
  photo.valid = Mask(exposure.values.width(), exposure.values.height(), 1, 1);
  const int channels = exposure.values.channels();
  const bool linear = camera.response == "linear";
  for (std::size_t i = 0; i < exposure.values.data().size(); ++i) {
    const double stored = exposure.values.data()[i];
    const double fraction = (stored - camera.pedestal) / (full - camera.pedestal);
    photo.value.data()[i] = static_cast<float>(linear ? fraction : response.decode(fraction));
    if (stored >= 0.995 * full) photo.valid.data()[i / channels] = 0;
  }
  return photo;
}

}  // namespace countershade::tools
