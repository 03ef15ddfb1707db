// The files of a simulated rig, as an operator would have them.
#pragma once

#include "calib/file/file.h"
#include "calib/file/rig.h"
#include "simdata/render/simulator.h"
#include "simdata/room/rooms.h"

namespace countershade::testing {

// folder/rig.toml with its [simulation], and the lens model of its first camera.
inline void write_rig(const std::filesystem::path& folder, const simdata::RigAndRoom& room) {
  Device lens = simdata::true_camera(room.simulation, room.rig.cameras[0].id).value();
  lens.device_from_world = {};
  write_cameramodel(folder / room.rig.cameras[0].model, lens).value();
  write_atomically(folder / "rig.toml", rig_text(room.rig, &room.simulation)).value();
}

}  // namespace countershade::testing
