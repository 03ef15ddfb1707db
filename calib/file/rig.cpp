#include "calib/file/rig.h"

#include <algorithm>
#include <set>
#include <toml.hpp>

#include "calib/file/file.h"
#include "calib/file/toml_fields.h"

namespace countershade {

namespace {

namespace fs = std::filesystem;
using fields::Field;
using fields::Fields;

// Edit distance (Levenshtein 1966).
int distance(const std::string& a, const std::string& b) {
  std::vector<int> row(b.size() + 1);
  for (std::size_t j = 0; j <= b.size(); ++j) row[j] = static_cast<int>(j);
  for (std::size_t i = 1; i <= a.size(); ++i) {
    int diagonal = row[0];
    row[0] = static_cast<int>(i);
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const int above = row[j];
      row[j] = std::min({row[j] + 1, row[j - 1] + 1, diagonal + (a[i - 1] != b[j - 1])});
      diagonal = above;
    }
  }
  return row[b.size()];
}

std::string nearest(const std::string& name, const std::vector<std::string>& valid) {
  return *std::min_element(valid.begin(), valid.end(), [&](const auto& a, const auto& b) { return distance(name, a) < distance(name, b); });
}

std::string place(const fs::path& path, const toml::value& value) { return fmt::format("{}:{}", path.string(), value.location().line()); }

Error unknown_key(const fs::path& path, const toml::value& value, const std::string& key, const std::string& table, const std::vector<std::string>& valid) {
  return error(ErrorCode::kBadValue, "{}: unknown key '{}' in {}; nearest valid key is '{}'", place(path, value), key, table, nearest(key, valid));
}

Result<void> read_fields(const fs::path& path, const toml::value& table, const std::string& name, const Fields& fields, const std::set<std::string>& elsewhere = {}) {
  if (!table.is_table()) return error(ErrorCode::kBadValue, "{}: {} must be a table", place(path, table), name);
  std::vector<std::string> valid(elsewhere.begin(), elsewhere.end());
  for (const Field& f : fields) valid.push_back(f.name);
  // In the file's order, so that the first mistake is the one reported.
  std::vector<std::pair<std::string, const toml::value*>> entries;
  for (const auto& [key, value] : table.as_table()) entries.emplace_back(key, &value);
  std::sort(entries.begin(), entries.end(), [](const auto& a, const auto& b) { return std::pair(a.second->location().line(), a.first) < std::pair(b.second->location().line(), b.first); });
  for (const auto& [key, value] : entries) {
    if (elsewhere.count(key)) continue;
    const auto field = std::find_if(fields.begin(), fields.end(), [&, k = key](const Field& f) { return f.name == k; });
    if (field == fields.end()) return unknown_key(path, *value, key, name, valid);
    if (const auto wrong = field->read(value)) return error(ErrorCode::kBadValue, "{}: {} in {} {}", place(path, *value), key, name, *wrong);
  }
  for (const Field& f : fields)
    if (f.mandatory && !table.as_table().count(f.name)) return error(ErrorCode::kBadValue, "{}: {} has no '{}' ({})", place(path, table), name, f.name, f.comment);
  return {};
}

template <class T>
Result<void> read_list(const fs::path& path, const toml::value& parent, const std::string& key, const std::string& name, Fields (*fields)(T&), std::vector<T>& out) {
  if (!parent.as_table().count(key)) return {};
  const toml::value& list = parent.as_table().at(key);
  if (!list.is_array()) return error(ErrorCode::kBadValue, "{}: write {} with double brackets", place(path, list), name);
  for (const toml::value& item : list.as_array()) {
    T one;
    CS_TRY_VOID(read_fields(path, item, name, fields(one)));
    for (const T& other : out)
      if (other.id == one.id) return error(ErrorCode::kBadValue, "{}: id '{}' stands in two {} tables; every one needs its own", place(path, item), one.id, name);
    out.push_back(std::move(one));
  }
  return {};
}

Result<toml::value> parse(const fs::path& path) {
  CS_TRY(const std::string text, read_text(path));
  std::istringstream stream(text);
  try {
    return toml::parse(stream, path.string());
  } catch (const std::exception& e) {
    std::string what = e.what();
    return error(ErrorCode::kBadValue, "'{}' is not valid TOML: {}", path.string(), what);
  }
}

Result<void> check_version(const fs::path& path, const toml::value& root) {
  if (!root.as_table().count("format_version")) return {};
  const toml::value& version = root.as_table().at("format_version");
  if (!version.is_integer() || version.as_integer() < 1) return error(ErrorCode::kBadValue, "{}: format_version must be a whole number from 1", place(path, version));
  if (version.as_integer() > 1)
    return error(ErrorCode::kBadValue, "{}: format_version {} is newer than this program, which reads up to 1; use a newer countershade", place(path, version), version.as_integer());
  return {};
}

Result<Simulation> simulation_of(const fs::path& path, const toml::value& root) {
  Simulation s;
  if (!root.as_table().count("simulation"))
    return error(ErrorCode::kBadValue, "'{}' has no [simulation] table, which a simulated device needs; `countershade new two-wall` writes one", path.string());
  const toml::value& table = root.as_table().at("simulation");
  CS_TRY_VOID(read_fields(path, table, "[simulation]", fields::simulation(s), {"camera", "projector"}));
  CS_TRY_VOID(read_list(path, table, "camera", "[[simulation.camera]]", fields::simulated_camera, s.cameras));
  CS_TRY_VOID(read_list(path, table, "projector", "[[simulation.projector]]", fields::simulated_projector, s.projectors));
  return s;
}

void resolve(const fs::path& folder, fs::path& path) {
  if (!path.empty() && path.is_relative()) path = (folder / path).lexically_normal();
}

std::string lines_of(const Fields& fields, bool comments) {
  std::string text;
  for (const Field& f : fields) {
    if (!f.is_set() && !comments) continue;
    const std::string line = fmt::format("{}{} = {}", f.is_set() ? "" : "# ", f.name, f.text());
    text += comments ? fmt::format("{:<44} # {}\n", line, f.comment) : line + "\n";
  }
  return text;
}

std::string text_of_rig(const Rig& given, bool comments) {
  Rig rig = given;  // fields refer to what they write
  std::string text = "format_version = 1\n";
  for (CameraSpec& c : rig.cameras) text += "\n[[camera]]\n" + lines_of(fields::camera(c), comments);
  for (ProjectorSpec& p : rig.projectors) text += "\n[[projector]]\n" + lines_of(fields::projector(p), comments);
  text += "\n[screen]\n" + lines_of(fields::screen(rig.screen), comments);
  if (!rig.board.kind.empty()) text += "\n[board]\n" + lines_of(fields::board(rig.board), comments);
  text += "\n[intent]\n" + lines_of(fields::intent(rig), comments);
  return text;
}

std::string text_of_simulation(const Simulation& given, bool comments) {
  Simulation s = given;
  std::string text = "\n[simulation]\n" + lines_of(fields::simulation(s), comments);
  for (SimulatedCamera& c : s.cameras) text += "\n[[simulation.camera]]\n" + lines_of(fields::simulated_camera(c), comments);
  for (SimulatedProjector& p : s.projectors) text += "\n[[simulation.projector]]\n" + lines_of(fields::simulated_projector(p), comments);
  return text;
}

}  // namespace

const ProjectorSpec* Rig::projector(const std::string& id) const {
  const auto found = std::find_if(projectors.begin(), projectors.end(), [&](const auto& p) { return p.id == id; });
  return found == projectors.end() ? nullptr : &*found;
}

const CameraSpec* Rig::camera(const std::string& id) const {
  const auto found = std::find_if(cameras.begin(), cameras.end(), [&](const auto& c) { return c.id == id; });
  return found == cameras.end() ? nullptr : &*found;
}

Result<Rig> read_rig(const fs::path& path) {
  CS_TRY(const toml::value root, parse(path));
  CS_TRY_VOID(check_version(path, root));
  static const std::vector<std::string> kTables = {"format_version", "camera", "projector", "screen", "board", "intent", "simulation"};
  for (const auto& [key, value] : root.as_table())
    if (std::find(kTables.begin(), kTables.end(), key) == kTables.end()) return unknown_key(path, value, key, "the file", kTables);
  Rig rig;
  CS_TRY_VOID(read_list(path, root, "camera", "[[camera]]", fields::camera, rig.cameras));
  CS_TRY_VOID(read_list(path, root, "projector", "[[projector]]", fields::projector, rig.projectors));
  const auto table = [&](const char* key, const Fields& f) -> Result<void> {
    if (!root.as_table().count(key)) return {};
    return read_fields(path, root.as_table().at(key), fmt::format("[{}]", key), f);
  };
  CS_TRY_VOID(table("screen", fields::screen(rig.screen)));
  CS_TRY_VOID(table("board", fields::board(rig.board)));
  CS_TRY_VOID(table("intent", fields::intent(rig)));
  if (rig.cameras.empty()) return error(ErrorCode::kBadValue, "'{}' names no camera; add [[camera]] with an id", path.string());
  if (rig.projectors.empty()) return error(ErrorCode::kBadValue, "'{}' names no projector; add [[projector]] with an id and a resolution", path.string());
  if (root.as_table().count("simulation")) {
    CS_TRY(const Simulation checked, simulation_of(path, root));
  }
  for (CameraSpec& c : rig.cameras) resolve(path.parent_path(), c.model);
  for (ProjectorSpec& p : rig.projectors) resolve(path.parent_path(), p.model);
  return rig;
}

Result<Simulation> read_simulation(const fs::path& path) {
  CS_TRY(const toml::value root, parse(path));
  return simulation_of(path, root);
}

Result<bool> has_simulation(const fs::path& path) {
  CS_TRY(const toml::value root, parse(path));
  return root.as_table().count("simulation") > 0;
}

std::string rig_text(const Rig& rig, const Simulation* simulation) {
  std::string text = "# What the operator knows of the rig. Lines that begin with # show a field that is not set.\n" + text_of_rig(rig, true);
  if (simulation) text += "\n# The truth of a simulated room; only the simulator reads it.\n" + text_of_simulation(*simulation, true).substr(1);
  return text;
}

std::string canonical_rig_text(const Rig& rig) { return text_of_rig(rig, false); }

std::string simulation_text(const Simulation& simulation) { return text_of_simulation(simulation, false).substr(1); }

}  // namespace countershade
