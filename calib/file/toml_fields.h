// Fields of rig.toml: one list per table drives reading, checking and writing.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "calib/file/rig.h"

namespace countershade::fields {

// One key of a table. `read` gets the value as the TOML library sees it (opaque here) and answers with what is wrong.
struct Field {
  std::string name, comment;  // the comment says meaning, unit, default
  std::function<std::optional<std::string>(const void* toml_value)> read;
  std::function<std::string()> text;    // TOML text of the current value
  std::function<bool()> is_set;         // false: written as a comment
  bool mandatory = false;
};
using Fields = std::vector<Field>;

Fields camera(CameraSpec& c);
Fields projector(ProjectorSpec& p);
Fields screen(ScreenSpec& s);
Fields board(BoardSpec& b);
Fields intent(Rig& r);
Fields simulation(Simulation& s);
Fields simulated_camera(SimulatedCamera& c);
Fields simulated_projector(SimulatedProjector& p);

}  // namespace countershade::fields
