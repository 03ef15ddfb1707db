// Opens what a rig names: the one place where backends are registered.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>

#include "calib/base/progress.h"
#include "calib/file/rig.h"
#include "capture/device/device.h"
#include "simdata/render/simulator.h"

namespace countershade::tools {

struct OpenDevices {
  capture::Devices devices;
  std::shared_ptr<const simdata::Simulator> simulator;  // null for real devices
};

// Simulated cameras see simulated projectors; those of other backends but folder see projectors whose output is a
// window (opened from the main thread). samples: instead of the [simulation]'s. `simulation_file` is a rig.toml or
// simulation.toml; it is read only if the rig is simulated. Errors: kDevice; kBadValue: no [simulation] for a simulated
// rig, backends or outputs that do not see each other (nothing is opened then).
Result<OpenDevices> open_devices(const Rig& rig, const std::filesystem::path& simulation_file, Progress& progress,
                                 std::vector<simdata::Fault> faults = {}, std::optional<int> samples = {});

// After which a picture is seen on every display that `check` lets pass [ms].
inline constexpr double kSettledMs = 250;

// An exposure as linear light: pedestal subtracted, response undone, 1 = full scale.
Photo photo_of(const capture::Exposure& exposure, const CameraSpec& camera);

}  // namespace countershade::tools
