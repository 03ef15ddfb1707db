// Reading and checking rig.toml. What the fields are stands in rig_fields.cpp.
#include "calib/file/rig.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <sstream>
#include <toml.hpp>

#include "calib/file/file.h"
#include "calib/file/nearest.h"
#include "calib/file/rig_fields.h"
#include "calib/photometry/response.h"

namespace countershade {

namespace fs = std::filesystem;
using fields::Field;
using fields::Fields;
using fields::Rule;

namespace {

// ---- one value ----

// What is wrong with a value: "must be ...", to be read after name, value and table.
struct Wrong {
  std::string text;
  ErrorCode code = ErrorCode::kBadValue;
};
using Verdict = std::optional<Wrong>;

std::string comma_list(const std::vector<std::string>& names) {
  std::string text;
  for (const std::string& name : names) text += (text.empty() ? "" : ", ") + name;
  return text;
}

std::string bound_text(const Rule& rule) {
  if (!rule.allowed.empty()) {
    std::string text;
    for (const double v : rule.allowed) text += (text.empty() ? "must be " : " or ") + fmt::format("{}", v);
    return text;
  }
  const std::string low = rule.low_is_open ? fmt::format("more than {}", rule.low) : fmt::format("{}", rule.low);
  if (std::isfinite(rule.high))
    return fmt::format("must be {} and at most {}", rule.low_is_open ? low : "at least " + low, rule.high);
  return fmt::format("must be {}", rule.low_is_open ? low : low + " or more");
}

Verdict check_number(double v, const Rule& rule) {
  if (!std::isfinite(v)) return Wrong{"must be finite"};
  const bool low_ok = rule.low_is_open ? v > rule.low : v >= rule.low;
  const bool listed = rule.allowed.empty() || std::count(rule.allowed.begin(), rule.allowed.end(), v) > 0;
  if (!low_ok || v > rule.high || !listed) return Wrong{bound_text(rule)};
  return std::nullopt;
}

// The id names folders and files, and stands before '=' on the command line.
Verdict check_id(const std::string& id) {
  const bool plain = std::none_of(id.begin(), id.end(), [](unsigned char c) {
    return c < 0x21 || std::string_view("/\\=:*?\"<>|").find(c) != std::string_view::npos;
  });
  if (id.empty() || id[0] == '.' || !plain)
    return Wrong{"must be a name that can be a file's: letters, digits, '-', '_', no spaces, no leading dot"};
  return std::nullopt;
}

Verdict check_text(const std::string& text, const Rule& rule) {
  if (rule.text == Rule::Text::kId) return check_id(text);
  if (rule.text == Rule::Text::kResponse) {
    if (text == "measured")
      return Wrong{"is not available in this version; state linear, srgb or gamma:G", ErrorCode::kUnsupported};
    const auto parsed = Response::parse(text);
    return parsed ? Verdict() : Wrong{"is no response: " + parsed.error().message};
  }
  if (rule.ready.empty() || std::count(rule.ready.begin(), rule.ready.end(), text)) return std::nullopt;
  if (std::count(rule.later.begin(), rule.later.end(), text))
    return Wrong{"is not available in this version; available: " + comma_list(rule.ready), ErrorCode::kUnsupported};
  return Wrong{fmt::format("is not known; use one of: {} (the nearest is '{}')", comma_list(rule.ready),
                           nearest(text, rule.ready))};
}

Verdict read_one(const toml::value& value, const Rule& rule, double& out) {
  if (!value.is_floating() && !value.is_integer()) return Wrong{"must be a number"};
  const double v = value.is_integer() ? static_cast<double>(value.as_integer()) : value.as_floating();
  if (Verdict wrong = check_number(v, rule)) return wrong;
  out = v;
  return std::nullopt;
}

Verdict read_one(const toml::value& value, const Rule& rule, int& out) {
  if (!value.is_integer()) return Wrong{"must be a whole number"};
  const double v = static_cast<double>(value.as_integer());
  if (Verdict wrong = check_number(v, rule)) return wrong;
  out = static_cast<int>(value.as_integer());
  return std::nullopt;
}

template <class T, std::size_t N>
Verdict read_list(const toml::value& value, const Rule& rule, std::array<T, N>& out) {
  if (!value.is_array() || value.as_array().size() != N)
    return Wrong{fmt::format("must be {} numbers in brackets, [{}]", N,
                             N == 2   ? "a, b"
                             : N == 3 ? "a, b, c"
                                      : "a, b, ...")};
  std::array<T, N> list;
  for (std::size_t i = 0; i < N; ++i)
    if (Verdict wrong = read_one(value.as_array()[i], rule, list[i])) return wrong;
  out = list;
  return std::nullopt;
}

// Reads a value into the slot of a field.
struct ReadValue {
  const toml::value& value;
  const Rule& rule;

  Verdict operator()(std::string* out) const {
    if (!value.is_string()) return Wrong{"must be text in quotes"};
    const std::string& text = value.as_string().str;
    if (Verdict wrong = check_text(text, rule)) return wrong;
    *out = text;
    return std::nullopt;
  }
  Verdict operator()(fs::path* out) const {
    if (!value.is_string()) return Wrong{"must be a path in quotes"};
    *out = value.as_string().str;
    return std::nullopt;
  }
  Verdict operator()(std::uint64_t* out) const {
    if (!value.is_integer()) return Wrong{"must be a whole number"};
    *out = static_cast<std::uint64_t>(value.as_integer());
    return std::nullopt;
  }
  Verdict operator()(bool* out) const {
    if (!value.is_boolean()) return Wrong{"must be true or false"};
    *out = value.as_boolean();
    return std::nullopt;
  }
  Verdict operator()(int* out) const { return read_one(value, rule, *out); }
  Verdict operator()(double* out) const { return read_one(value, rule, *out); }
  Verdict operator()(std::optional<double>* out) const { return read_one(value, rule, out->emplace()); }
  Verdict operator()(std::optional<std::array<double, 2>>* out) const { return read_list(value, rule, out->emplace()); }
  Verdict operator()(std::vector<double>* out) const {
    if (!value.is_array()) return Wrong{"must be a list of numbers, [a, b, ...]"};
    out->resize(value.as_array().size());
    for (std::size_t i = 0; i < out->size(); ++i)
      if (Verdict wrong = read_one(value.as_array()[i], rule, (*out)[i])) return wrong;
    return std::nullopt;
  }
  Verdict operator()(fields::Patches out) const {
    if (!value.is_string()) return read_list(value, rule, *out.value);
    if (value.as_string().str != "auto") return Wrong{"must be \"auto\" or [nu, nv]"};
    *out.value = {0, 0};
    return std::nullopt;
  }
  template <class T, std::size_t N>
  Verdict operator()(std::array<T, N>* out) const {
    return read_list(value, rule, *out);
  }
  Verdict operator()(std::optional<ScreenSpec::KnownLength>*) const {
    return std::nullopt;
  }  // a table: Reader::known_length
};

// ---- the file ----

std::string shown(const toml::value& value) {
  std::string text = value.is_table() ? "{ ... }" : toml::format(value, 1000);
  std::replace(text.begin(), text.end(), '\n', ' ');
  return text.size() > 60 ? text.substr(0, 57) + "..." : text;
}

struct Reader {
  fs::path path;
  toml::value root;

  static Result<Reader> open(const fs::path& path);
  std::string place(const toml::value& value) const {
    return fmt::format("{}:{}", path.string(), value.location().line());
  }
  Result<void> check_top() const;
  Result<void> table(const toml::value& table, const std::string& name, const Fields& fields,
                     const std::vector<std::string>& also = {}) const;
  Result<void> field(const toml::value& value, const std::string& name, const Field& field) const;
  template <class T>
  Result<void> tables(const toml::value& parent, const char* key, const std::string& name, std::vector<T>& out) const;
  Result<void> single(const char* key, const Fields& fields) const;
  Result<Simulation> simulation() const;
  bool has(const char* key) const { return root.as_table().count(key) > 0; }
};

// What the library says, without its own names: "missing key-value separator `=`".
std::string plain(std::string what) {
  what = what.substr(0, what.find('\n'));
  if (const auto at = what.find("[error] "); at != std::string::npos) what = what.substr(at + 8);
  if (what.rfind("toml::", 0) == 0) what = what.substr(what.find(": ") + 2);
  return what;
}

Result<Reader> Reader::open(const fs::path& path) {
  CS_TRY(const std::string text, read_text(path));
  constexpr std::size_t kMostBytes = 256 << 10;  // a rig of a hundred devices has a tenth of that
  if (text.size() > kMostBytes)
    return error(ErrorCode::kBadValue, "'{}' has {} KB; a rig file has at most {}: is it another file?", path.string(),
                 text.size() >> 10, kMostBytes >> 10);
  std::istringstream stream(text);
  try {
    return Reader{path, toml::parse(stream, path.string())};
  } catch (const toml::exception& e) {
    return error(ErrorCode::kBadValue, "{}:{}: not TOML: {}", path.string(), e.location().line(), plain(e.what()));
  } catch (const std::exception& e) {
    return error(ErrorCode::kBadValue, "'{}' is not TOML: {}", path.string(), plain(e.what()));
  }
}

// Entries in the order of the file, so that its first mistake is the one reported.
std::vector<std::pair<std::string, const toml::value*>> in_file_order(const toml::value& table) {
  std::vector<std::pair<std::string, const toml::value*>> entries;
  for (const auto& [key, value] : table.as_table()) entries.emplace_back(key, &value);
  std::sort(entries.begin(), entries.end(), [](const auto& a, const auto& b) {
    return std::pair(a.second->location().line(), a.first) < std::pair(b.second->location().line(), b.first);
  });
  return entries;
}

Result<void> Reader::check_top() const {
  const std::vector<std::string> valid(std::begin(fields::kTables), std::end(fields::kTables));
  for (const auto& [key, value] : in_file_order(root)) {
    if (!std::count(valid.begin(), valid.end(), key))
      return error(ErrorCode::kBadValue, "{}: unknown key '{}' at the top of the file; nearest valid key is '{}'",
                   place(*value), key, nearest(key, valid));
    if (key != "format_version") continue;
    if (!value->is_integer() || value->as_integer() < 1)
      return error(ErrorCode::kBadValue, "{}: format_version = {} must be 1; correct it or remove the line",
                   place(*value), shown(*value));
    if (value->as_integer() > 1)
      return error(
          ErrorCode::kUnsupported,
          "{}: format_version = {} is newer than 1, the newest that this program reads; use a newer countershade",
          place(*value), shown(*value));
  }
  return {};
}

Result<void> Reader::field(const toml::value& value, const std::string& name, const Field& field) const {
  if (auto* slot = std::get_if<std::optional<ScreenSpec::KnownLength>*>(&field.slot)) {
    ScreenSpec::KnownLength known{};
    CS_TRY_VOID(table(value, field.name + " of " + name, fields::fields_of(known)));
    if (known.pixel_a == known.pixel_b)
      return error(ErrorCode::kBadValue,
                   "{}: pixel_a and pixel_b of known_length are the same pixel; name two that are far apart",
                   place(value));
    **slot = known;
    return {};
  }
  const Verdict wrong = std::visit(ReadValue{value, field.rule}, field.slot);
  if (!wrong) return {};
  return error(wrong->code, "{}: {} = {} in {} {} ({})", place(value), field.name, shown(value), name, wrong->text,
               field.comment);
}

Result<void> Reader::table(const toml::value& table, const std::string& name, const Fields& fields,
                           const std::vector<std::string>& also) const {
  if (!table.is_table())
    return error(ErrorCode::kBadValue, "{}: {} = {} must be a table", place(table), name, shown(table));
  std::vector<std::string> valid = also;
  for (const Field& f : fields) valid.push_back(f.name);
  for (const auto& [key, value] : in_file_order(table)) {
    if (std::count(also.begin(), also.end(), key)) continue;
    const auto known = std::find_if(fields.begin(), fields.end(), [&, k = key](const Field& f) { return f.name == k; });
    if (known == fields.end())
      return error(ErrorCode::kBadValue, "{}: unknown key '{}' in {}; nearest valid key is '{}'", place(*value), key,
                   name, nearest(key, valid));
    CS_TRY_VOID(field(*value, name, *known));
  }
  for (const Field& f : fields)
    if (f.rule.mandatory && !table.as_table().count(f.name))
      return error(ErrorCode::kBadValue, "{}: {} has no '{}' ({}); add it", place(table), name, f.name, f.comment);
  return {};
}

// ---- what one field alone cannot show ----

std::optional<std::string> mistake(const CameraSpec& c) {
  if (c.full_scale && c.pedestal >= *c.full_scale)
    return fmt::format("pedestal = {} must be less than full_scale = {}", c.pedestal, *c.full_scale);
  std::vector<double> sorted = c.exposures_ms;
  std::sort(sorted.begin(), sorted.end());
  if (const auto twice = std::adjacent_find(sorted.begin(), sorted.end()); twice != sorted.end())
    return fmt::format("exposures_ms names {} twice; keep one", *twice);
  return std::nullopt;
}

std::optional<std::string> mistake(const ProjectorSpec&) {
  return std::nullopt;
}

std::optional<std::string> mistake(const SimulatedSurface& s) {
  const auto &u = s.along_u, &v = s.along_v;
  const double cross = std::hypot(u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]);
  if (s.shape == "rectangle" && !(cross > 1e-6 * std::hypot(u[0], u[1], u[2]) * std::hypot(v[0], v[1], v[2])))
    return "along_u and along_v span no area; they must point in different directions";
  if (s.shape != "rectangle" && s.shape != "mesh" &&
      !(s.azimuth_deg[1] > s.azimuth_deg[0] && s.azimuth_deg[1] - s.azimuth_deg[0] <= 360))
    return fmt::format("azimuth_deg = [{}, {}] must rise, by 360 at most", s.azimuth_deg[0], s.azimuth_deg[1]);
  if (s.daylight > 0 && !(s.daylight_from[0] < s.daylight_to[0] && s.daylight_from[1] < s.daylight_to[1]))
    return fmt::format("daylight_from = [{}, {}] must be below daylight_to = [{}, {}]", s.daylight_from[0],
                       s.daylight_from[1], s.daylight_to[0], s.daylight_to[1]);
  if (s.shape == "sphere" && !(s.elevation_deg[1] > s.elevation_deg[0]))
    return fmt::format("elevation_deg = [{}, {}] must rise", s.elevation_deg[0], s.elevation_deg[1]);
  return std::nullopt;
}

template <class Simulated>
std::optional<std::string> looks_nowhere(const Simulated& device) {
  if (device.position == device.target) return "position and target are the same point; it looks nowhere";
  return std::nullopt;
}

// What decides which other fields there are.
void prepare(SimulatedSurface& surface, const toml::value& table) {
  if (!table.is_table() || !table.as_table().count("shape")) return;
  if (const toml::value& shape = table.as_table().at("shape"); shape.is_string()) surface.shape = shape.as_string().str;
}
template <class T>
void prepare(T&, const toml::value&) {}

std::optional<std::string> mistake(const SimulatedCamera& c) {
  if (c.bayer != "none" && c.channels != 3)
    return fmt::format("bayer = \"{}\" needs channels = 3, not {}; set one or the other", c.bayer, c.channels);
  return looks_nowhere(c);
}

std::optional<std::string> mistake(const SimulatedProjector& p) {
  for (const auto& [name, curve] : {std::pair{"response_r", &p.response_r}, std::pair{"response_g", &p.response_g},
                                    std::pair{"response_b", &p.response_b}}) {
    if (curve->size() == 1)
      return fmt::format("{} = [{}] is one value; give the light of at least 2, or none for gamma", name,
                         curve->front());
    for (std::size_t i = 1; i < curve->size(); ++i)
      if ((*curve)[i] < (*curve)[i - 1])
        return fmt::format("{} falls from {} to {} at its value {}; it must never fall", name, (*curve)[i - 1],
                           (*curve)[i], i + 1);
    if (curve->size() > 4096) return fmt::format("{} has {} values; 4096 are the most", name, curve->size());
  }
  if ((p.native_resolution[0] == 0) != (p.native_resolution[1] == 0))
    return fmt::format("native_resolution = [{}, {}] has one side of 0; give both, or [0, 0] for none",
                       p.native_resolution[0], p.native_resolution[1]);
  return looks_nowhere(p);
}

void fill_in(SimulatedCamera& camera, const toml::value& table) {
  if (!table.as_table().count("principal"))
    camera.principal = {(camera.resolution[0] - 1) / 2.0, (camera.resolution[1] - 1) / 2.0};
}
template <class T>
void fill_in(T&, const toml::value&) {}

template <class T>
Result<void> Reader::tables(const toml::value& parent, const char* key, const std::string& name,
                            std::vector<T>& out) const {
  if (!parent.as_table().count(key)) return {};
  const toml::value& list = parent.as_table().at(key);
  if (!list.is_array())
    return error(ErrorCode::kBadValue, "{}: '{}' must be written {}, in double brackets: there may be several",
                 place(list), key, name);
  std::map<std::string, const toml::value*> seen;
  for (const toml::value& item : list.as_array()) {
    T one;
    prepare(one, item);
    CS_TRY_VOID(table(item, name, fields::fields_of(one)));
    fill_in(one, item);
    const auto [first, is_new] = seen.emplace(one.id, &item);
    if (!is_new)
      return error(ErrorCode::kBadValue, "{}: id '{}' stands in two {} tables, the first in line {}; give each its own",
                   place(item), one.id, name, first->second->location().line());
    if (const auto wrong = mistake(one))
      return error(ErrorCode::kBadValue, "{}: {} '{}': {}", place(item), name, one.id, *wrong);
    out.push_back(std::move(one));
  }
  return {};
}

Result<void> Reader::single(const char* key, const Fields& fields) const {
  if (!has(key)) return {};
  const toml::value& value = root.as_table().at(key);
  if (value.is_array())
    return error(ErrorCode::kBadValue, "{}: '{}' must be written [{}], in single brackets: there is only one",
                 place(value), key, key);
  return table(value, fmt::format("[{}]", key), fields);
}

Result<Simulation> Reader::simulation() const {
  const toml::value& value = root.as_table().at("simulation");
  Simulation simulation;
  CS_TRY_VOID(table(value, "[simulation]", fields::fields_of(simulation), {"surface", "camera", "projector"}));
  CS_TRY_VOID(tables(value, "surface", "[[simulation.surface]]", simulation.surfaces));
  CS_TRY_VOID(tables(value, "camera", "[[simulation.camera]]", simulation.cameras));
  CS_TRY_VOID(tables(value, "projector", "[[simulation.projector]]", simulation.projectors));
  return simulation;
}

void resolve(const fs::path& folder, fs::path& path) {
  if (!path.empty() && path.is_relative()) path = (folder / path).lexically_normal();
}

template <class T>
const T* find_id(const std::vector<T>& all, const std::string& id) {
  const auto found = std::find_if(all.begin(), all.end(), [&](const T& one) { return one.id == id; });
  return found == all.end() ? nullptr : &*found;
}

}  // namespace

const ProjectorSpec* Rig::projector(const std::string& id) const {
  return find_id(projectors, id);
}
const CameraSpec* Rig::camera(const std::string& id) const {
  return find_id(cameras, id);
}

Result<Rig> read_rig(const fs::path& path) {
  CS_TRY(const Reader reader, Reader::open(path));
  CS_TRY_VOID(reader.check_top());
  Rig rig;
  CS_TRY_VOID(reader.tables(reader.root, "camera", "[[camera]]", rig.cameras));
  CS_TRY_VOID(reader.tables(reader.root, "projector", "[[projector]]", rig.projectors));
  CS_TRY_VOID(reader.single("screen", fields::fields_of(rig.screen)));
  CS_TRY_VOID(reader.single("board", fields::fields_of(rig.board)));
  CS_TRY_VOID(reader.single("intent", fields::intent_of(rig)));
  if (rig.cameras.empty())
    return error(ErrorCode::kBadValue, "'{}' names no camera; add a table [[camera]] with an id", path.string());
  if (rig.projectors.empty())
    return error(ErrorCode::kBadValue, "'{}' names no projector; add a table [[projector]] with an id and a resolution",
                 path.string());
  if (reader.has("simulation")) {
    CS_TRY(const Simulation checked, reader.simulation());
  }
  for (CameraSpec& camera : rig.cameras) resolve(path.parent_path(), camera.model);
  for (ProjectorSpec& projector : rig.projectors) resolve(path.parent_path(), projector.model);
  return rig;
}

Result<Simulation> read_simulation(const fs::path& path) {
  CS_TRY(const Reader reader, Reader::open(path));
  CS_TRY_VOID(reader.check_top());
  if (!reader.has("simulation"))
    return error(ErrorCode::kBadValue,
                 "'{}' has no table [simulation], which simulated devices need; `countershade new two-wall` writes one",
                 path.string());
  CS_TRY(Simulation simulation, reader.simulation());
  for (SimulatedSurface& surface : simulation.surfaces) resolve(path.parent_path(), surface.mesh);
  for (SimulatedCamera& camera : simulation.cameras) resolve(path.parent_path(), camera.lens);
  return simulation;
}

namespace {

// Checks the value in the slot of a field, as ReadValue does.
struct CheckValue {
  const Rule& rule;

  Verdict operator()(std::string* v) const { return check_text(*v, rule); }
  Verdict operator()(int* v) const { return check_number(*v, rule); }
  Verdict operator()(double* v) const { return check_number(*v, rule); }
  Verdict operator()(std::vector<double>* v) const { return all(*v); }
  template <class T, std::size_t N>
  Verdict operator()(std::array<T, N>* v) const {
    return all(*v);
  }
  // Paths, seeds and switches may be anything; the others do not occur in a simulation.
  template <class T>
  Verdict operator()(const T&) const {
    return std::nullopt;
  }

 private:
  template <class List>
  Verdict all(const List& list) const {
    for (const auto& v : list)
      if (Verdict wrong = check_number(v, rule)) return wrong;
    return std::nullopt;
  }
};

Result<void> check_fields(const Fields& fields, const std::string& name) {
  for (const Field& f : fields)
    if (const Verdict wrong = std::visit(CheckValue{f.rule}, f.slot))
      return error(wrong->code, "{}: {} = {} {} ({})", name, f.name, fields::value_text(f.slot), wrong->text,
                   f.comment);
  return {};
}

// By value: the fields want something they could write to.
template <class T>
Result<void> check_tables(std::vector<T> tables, const char* name) {
  for (T& one : tables) {
    const std::string which = fmt::format("{} '{}'", name, one.id);
    CS_TRY_VOID(check_fields(fields::fields_of(one), which));
    if (const auto wrong = mistake(one)) return error(ErrorCode::kBadValue, "{}: {}", which, *wrong);
  }
  return {};
}

}  // namespace

Result<void> check_values(const Simulation& simulation) {
  Simulation copy = simulation;
  CS_TRY_VOID(check_fields(fields::fields_of(copy), "[simulation]"));
  CS_TRY_VOID(check_tables(simulation.surfaces, "[[simulation.surface]]"));
  CS_TRY_VOID(check_tables(simulation.cameras, "[[simulation.camera]]"));
  return check_tables(simulation.projectors, "[[simulation.projector]]");
}

Result<bool> has_simulation(const fs::path& path) {
  CS_TRY(const Reader reader, Reader::open(path));
  return reader.has("simulation");
}

}  // namespace countershade
