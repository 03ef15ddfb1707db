// The fields of rig.toml: one list per table drives reading, checking and writing. Internal to calib/file.
#pragma once

#include <limits>
#include <string>
#include <variant>
#include <vector>

#include "calib/file/rig.h"

namespace countershade::fields {

// [nu, nv], or {0, 0} written as "auto".
struct Patches {
  std::array<int, 2>* value;
};

// Where a field's value lives, and thereby which type it has in the file.
using Slot = std::variant<std::string*, std::filesystem::path*, int*, std::uint64_t*, double*, std::optional<double>*,
                          std::vector<double>*, std::array<int, 2>*, std::array<double, 2>*,
                          std::optional<std::array<double, 2>>*, std::array<double, 3>*, std::array<double, 5>*,
                          std::array<double, 9>*, bool*, Patches, std::optional<ScreenSpec::KnownLength>*>;

// What a value must fulfil; it holds for each number of a list.
struct Rule {
  double low = -std::numeric_limits<double>::infinity(), high = std::numeric_limits<double>::infinity();
  bool low_is_open = false;        // low itself is not allowed
  std::vector<double> allowed;     // if not empty: one of these
  std::vector<std::string> ready;  // if not empty: one of these texts
  std::vector<std::string> later;  // texts of the format that this version cannot do
  enum class Text { kAny, kId, kResponse } text = Text::kAny;
  bool mandatory = false;
  bool seldom = false;  // not written while it has its default, but for the comment
};

struct Field {
  std::string name;
  Slot slot;
  Rule rule;
  std::string comment;        // meaning, unit
  std::string if_unset = {};  // what holds when the file does not set it, where that is no fixed value
  std::string example = {};   // TOML text that shows an unset field
};
using Fields = std::vector<Field>;

// The lists point into their argument, which must outlive them.
Fields fields_of(CameraSpec& camera);
Fields fields_of(ProjectorSpec& projector);
Fields fields_of(ScreenSpec& screen);
Fields fields_of(ScreenSpec::KnownLength& known);
Fields fields_of(BoardSpec& board);
Fields intent_of(Rig& rig);
Fields fields_of(Simulation& simulation);
// Those that belong to the surface's shape.
Fields fields_of(SimulatedSurface& surface);
Fields fields_of(SimulatedCamera& camera);
Fields fields_of(SimulatedProjector& projector);

// Names of the tables, as the file writes them.
inline constexpr const char* kTables[] = {"format_version", "camera", "projector", "screen",
                                          "board",          "intent", "simulation"};

// TOML text of the current value; is_set: whether there is one (an optional, text or list may have none).
std::string value_text(const Slot& slot);
bool is_set(const Slot& slot);

}  // namespace countershade::fields
