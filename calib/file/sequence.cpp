// sequence.json: roles as JSON and back (CONTRACT, `patterns/`).
#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <set>

#include "calib/file/file.h"
#include "calib/file/nearest.h"
#include "calib/file/session.h"

namespace countershade {

namespace {

// Keeps the order of projectors.
using json = nlohmann::ordered_json;

// What the keys of a kind are. A key that ends in '!' must be there.
const std::map<std::string, std::vector<std::string>>& keys_of_kinds() {
  static const std::map<std::string, std::vector<std::string>> kKeys = {
      {"white", {}},
      {"black", {}},
      {"gray", {"axis!", "bit!", "inverse", "cell_px"}},
      {"xor", {"axis!", "bit!", "base!", "inverse", "cell_px"}},
      {"phase", {"axis!", "period_px!", "step", "steps", "shift_rad", "shown_exponent"}},
      {"blocks", {"channel", "cell_px", "inverse", "seed"}},
      {"primary", {"channel"}},
      {"held-out", {"seed"}},
      {"mask", {"axis!", "cell_px", "step"}},
  };
  return kKeys;
}

const std::vector<std::string> kEveryKey = {"axis", "bit",       "base", "inverse", "cell_px",   "channel",
                                            "seed", "period_px", "step", "steps",   "shift_rad", "shown_exponent"};

// ---- to JSON ----

json value_of(const Role& r, const std::string& key) {
  if (key == "axis") return r.axis;
  if (key == "bit") return r.bit;
  if (key == "base") return r.base;
  if (key == "inverse") return r.inverse;
  if (key == "cell_px") return r.cell_px;
  if (key == "channel") return r.channel;
  if (key == "seed") return r.seed;
  if (key == "period_px") return r.period_px;
  if (key == "step") return r.step;
  if (key == "steps") return r.steps;
  if (key == "shift_rad") return r.shift_rad ? json(*r.shift_rad) : json();
  if (key == "shown_exponent") return r.shown_exponent;
  throw_bug(__FILE__, __LINE__, "key", "a role has no " + key);
}

// Keys of a foreign description that are left out while they say nothing.
bool is_optional(const std::string& kind, const std::string& key) {
  return key == "shift_rad" || key == "shown_exponent" || ((kind == "gray" || kind == "xor") && key == "cell_px");
}

json json_of(const Role& r) {
  json j = {{"kind", r.kind}};
  if (!r.projector.empty()) j["projector"] = r.projector;
  const auto known = keys_of_kinds().find(r.kind);
  const Role plain;
  for (std::string key : known == keys_of_kinds().end() ? kEveryKey : known->second) {
    if (key.back() == '!') key.pop_back();
    const bool leave_out = known == keys_of_kinds().end() || is_optional(r.kind, key);
    if (!leave_out || value_of(r, key) != value_of(plain, key)) j[key] = value_of(r, key);
  }
  return j;
}

// ---- from JSON; what is wrong comes as a text ----

using Wrong = std::optional<std::string>;

Wrong read_whole(const json& j, const char* key, int& out) {
  if (!j.contains(key)) return std::nullopt;
  const json& v = j.at(key);
  const double d = v.is_number() ? v.get<double>() : NAN;
  if (!(std::nearbyint(d) == d && std::abs(d) < 2147483648.0))
    return fmt::format("'{}' is {}, must be a whole number", key, v.dump());
  out = static_cast<int>(d);
  return std::nullopt;
}

Wrong read_real(const json& j, const char* key, double& out) {
  if (!j.contains(key)) return std::nullopt;
  if (!j.at(key).is_number()) return fmt::format("'{}' is {}, must be a number", key, j.at(key).dump());
  out = j.at(key).get<double>();
  return std::nullopt;
}

Wrong read_string(const json& j, const char* key, std::string& out) {
  if (!j.contains(key)) return std::nullopt;
  if (!j.at(key).is_string()) return fmt::format("'{}' is {}, must be text", key, j.at(key).dump());
  out = j.at(key).get<std::string>();
  return std::nullopt;
}

Wrong read_values(const json& j, Role& r) {
  if (Wrong wrong = read_string(j, "projector", r.projector)) return wrong;
  if (Wrong wrong = read_string(j, "axis", r.axis)) return wrong;
  if (Wrong wrong = read_string(j, "channel", r.channel)) return wrong;
  for (const auto& [key, out] : {std::pair("bit", &r.bit), std::pair("base", &r.base), std::pair("cell_px", &r.cell_px),
                                 std::pair("seed", &r.seed), std::pair("step", &r.step), std::pair("steps", &r.steps)})
    if (Wrong wrong = read_whole(j, key, *out)) return wrong;
  if (Wrong wrong = read_real(j, "period_px", r.period_px)) return wrong;
  if (Wrong wrong = read_real(j, "shown_exponent", r.shown_exponent)) return wrong;
  if (j.contains("shift_rad"))
    if (Wrong wrong = read_real(j, "shift_rad", r.shift_rad.emplace())) return wrong;
  if (!j.contains("inverse")) return std::nullopt;
  if (!j.at("inverse").is_boolean())
    return fmt::format("'inverse' is {}, must be true or false", j.at("inverse").dump());
  r.inverse = j.at("inverse").get<bool>();
  return std::nullopt;
}

// Other people's roles may carry remarks of their own; a key that is nearly one of ours is a slip.
Wrong check_keys(const json& j, const std::vector<std::string>& keys) {
  std::vector<std::string> valid = {"kind", "projector"};
  for (std::string key : keys) {
    const bool needed = key.back() == '!';
    if (needed) key.pop_back();
    if (needed && !j.contains(key)) return fmt::format("it has no '{}'", key);
    valid.push_back(key);
  }
  for (const auto& [key, value] : j.items()) {
    const std::string meant = nearest(key, valid);
    if (key != meant && edit_distance(key, meant) <= 2 && key.size() > 3 &&
        !std::count(kEveryKey.begin(), kEveryKey.end(), key))
      return fmt::format("unknown key '{}'; nearest valid key is '{}'", key, meant);
  }
  return std::nullopt;
}

Wrong check_values(const Role& r) {
  const bool has_axis = r.kind == "gray" || r.kind == "xor" || r.kind == "phase" || r.kind == "mask";
  if (has_axis && r.axis != "x" && r.axis != "y") return fmt::format("axis is '{}', must be x or y", r.axis);
  const bool has_bit = r.kind == "gray" || r.kind == "xor";
  if (has_bit && (r.bit < 0 || r.bit > 30)) return fmt::format("bit is {}, must be 0 to 30", r.bit);
  if (r.kind == "xor" && (r.base < 0 || r.base > 30 || r.base == r.bit))
    return fmt::format("base is {}, must be another bit, 0 to 30", r.base);
  if (r.cell_px < 1) return fmt::format("cell_px is {}, must be 1 or more", r.cell_px);
  if ((r.kind == "blocks" || r.kind == "primary") && r.channel != "r" && r.channel != "g" && r.channel != "b" &&
      r.channel != "rgb")
    return fmt::format("channel is '{}', must be r, g, b or rgb", r.channel);
  if (r.kind != "phase") return std::nullopt;
  if (!(r.period_px > 0)) return fmt::format("period_px is {}, must be more than 0", r.period_px);
  if (r.steps < 1 && !r.shift_rad) return fmt::format("steps is {}, must be 1 or more (or give shift_rad)", r.steps);
  if (!(r.shown_exponent > 0)) return fmt::format("shown_exponent is {}, must be more than 0", r.shown_exponent);
  return std::nullopt;
}

Wrong read_role(const json& j, Role& r) {
  if (!j.is_object()) return "its role is no object";
  if (Wrong wrong = read_string(j, "kind", r.kind)) return wrong;
  if (r.kind.empty()) return "its role has no 'kind'";
  const auto known = keys_of_kinds().find(r.kind);
  if (known ==
      keys_of_kinds().end()) {  // somebody else's: whatever reads as ours is kept, the rest is not ours to judge
    for (const std::string& key : kEveryKey) {
      Role trial = r;
      if (j.contains(key) && !read_values(json{{key, j.at(key)}}, trial)) r = trial;
    }
    return read_string(j, "projector", r.projector);
  }
  if (Wrong wrong = check_keys(j, known->second)) return wrong;
  if (Wrong wrong = read_values(j, r)) return wrong;
  return check_values(r);
}

Wrong read_projectors(const json& j, Sequence& sequence) {
  if (!j.is_object() || j.empty()) return "it has no 'projectors'; name at least one with its resolution";
  for (const auto& [id, p] : j.items()) {
    const json size = p.is_object() ? p.value("resolution", json()) : json();
    const bool two = size.is_array() && size.size() == 2 && size[0].is_number_integer() && size[1].is_number_integer();
    if (!two || size[0] < 1 || size[1] < 1 || size[0] > 65536 || size[1] > 65536)
      return fmt::format("projector '{}': resolution is {}, must be [width, height] in pixels", id, size.dump());
    sequence.projectors.emplace_back(id, std::array<int, 2>{size[0].get<int>(), size[1].get<int>()});
  }
  return std::nullopt;
}

Wrong read_frames(const json& j, Sequence& sequence) {
  if (!j.is_array() || j.empty()) return "it has no 'frames'; list at least one";
  std::set<int> seen;
  for (std::size_t i = 0; i < j.size(); ++i) {
    Frame frame;
    frame.index = -1;
    if (!j[i].is_object()) return fmt::format("entry {} of 'frames' is no object", i);
    Wrong wrong = read_whole(j[i], "index", frame.index);
    if (wrong || frame.index < 0) return fmt::format("entry {} of 'frames' has no 'index' that is 0 or more", i);
    if (!seen.insert(frame.index).second)
      return fmt::format("frame {} stands twice; give each its own index", frame.index);
    wrong = read_role(j[i].value("role", json()), frame.role);
    if (wrong) return fmt::format("frame {}: {}", frame.index, *wrong);
    const auto lit = [&](const auto& p) { return p.first == frame.role.projector; };
    if (!frame.role.projector.empty() && std::none_of(sequence.projectors.begin(), sequence.projectors.end(), lit))
      return fmt::format("frame {}: projector '{}' is none of those under 'projectors'", frame.index,
                         frame.role.projector);
    sequence.frames.push_back(std::move(frame));
  }
  return std::nullopt;
}

Wrong read_identity(const json& j, Sequence& sequence) {
  if (!j.is_array()) return "'identity' is no list of squares";
  for (std::size_t i = 0; i < j.size(); ++i) {
    if (!j[i].is_object()) return fmt::format("entry {} of 'identity' is no object", i);
    IdentityMark mark;
    if (Wrong wrong = read_string(j[i], "projector", mark.projector)) return wrong;
    for (const auto& [key, out] :
         {std::pair("x", &mark.x), std::pair("y", &mark.y), std::pair("side_px", &mark.side_px)})
      if (Wrong wrong = read_whole(j[i], key, *out)) return fmt::format("entry {} of 'identity': {}", i, *wrong);
    const auto on = std::find_if(sequence.projectors.begin(), sequence.projectors.end(),
                                 [&](const auto& p) { return p.first == mark.projector; });
    if (on == sequence.projectors.end())
      return fmt::format("entry {} of 'identity': projector '{}' is none of those under 'projectors'", i,
                         mark.projector);
    const auto [width, height] = on->second;
    if (mark.side_px < 1 || mark.x < 0 || mark.y < 0 || mark.x > width - mark.side_px || mark.y > height - mark.side_px)
      return fmt::format(
          "entry {} of 'identity': a square of {} px at ({}, {}) does not lie in the {} x {} pixels of '{}'", i,
          mark.side_px, mark.x, mark.y, width, height, mark.projector);
    sequence.identity.push_back(mark);
  }
  return std::nullopt;
}

}  // namespace

std::string Role::name() const {
  std::string text = kind;
  if (kind == "gray" || kind == "xor" || kind == "phase" || kind == "mask") text += " " + axis;
  if (kind == "gray" || kind == "xor") text += fmt::format(" bit {}", bit);
  if (kind == "blocks" || kind == "primary") text += " " + channel;
  if (kind == "phase" || kind == "mask") text += fmt::format(" step {}", step);
  if (kind == "phase") text += fmt::format(" of {}, period {} px", steps, period_px);
  if (inverse) text += " inverse";
  return projector.empty() ? text : text + " of " + projector;
}

Result<Sequence> read_sequence(const std::filesystem::path& path) {
  CS_TRY(const std::string text, read_text(path));
  json j;
  try {
    j = json::parse(text);
  } catch (const json::exception& e) {
    const std::string what = e.what();  // "[json.exception.parse_error.101] parse error at line 3, ..."
    return error(ErrorCode::kBadFile, "'{}' is not JSON: {}", path.string(), what.substr(what.find("] ") + 2));
  }
  if (!j.is_object()) return error(ErrorCode::kBadFile, "'{}' is no sequence: not a JSON object", path.string());
  int version = 1;
  const Wrong no_version = read_whole(j, "format_version", version);
  if (no_version || version < 1) return error(ErrorCode::kBadFile, "'{}': format_version must be 1", path.string());
  if (version > 1)
    return error(
        ErrorCode::kBadFile,
        "'{}' has format_version {}, newer than 1, the newest that this program reads; use a newer countershade",
        path.string(), version);
  Sequence sequence;
  Wrong wrong = read_projectors(j.value("projectors", json()), sequence);
  if (!wrong) wrong = read_frames(j.value("frames", json()), sequence);
  if (!wrong && j.contains("identity")) wrong = read_identity(j.at("identity"), sequence);
  if (wrong) return error(ErrorCode::kBadFile, "'{}': {}", path.string(), *wrong);
  return sequence;
}

// One line per frame, so that a person finds them.
std::string sequence_text(const Sequence& sequence) {
  json projectors = json::object();
  for (const auto& [id, resolution] : sequence.projectors) projectors[id] = {{"resolution", resolution}};
  std::string frames;
  for (const Frame& f : sequence.frames)
    frames += (frames.empty() ? "\n  " : ",\n  ") +
              json{{"index", f.index}, {"role", json_of(f.role)}}.dump(-1, ' ', false, json::error_handler_t::replace);
  json marks = json::array();
  for (const IdentityMark& m : sequence.identity)
    marks.push_back({{"projector", m.projector}, {"x", m.x}, {"y", m.y}, {"side_px", m.side_px}});
  const std::string identity = marks.empty() ? "" : fmt::format(" \"identity\": {},\n", marks.dump());
  return fmt::format("{{\n \"format_version\": 1,\n \"projectors\": {},\n{} \"frames\": [{}\n ]\n}}\n",
                     projectors.dump(), identity, frames);
}

}  // namespace countershade
