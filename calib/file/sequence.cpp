// sequence.json: roles as JSON and back (CONTRACT, `patterns/`).
#include <nlohmann/json.hpp>
#include <set>

#include "calib/file/file.h"
#include "calib/file/session.h"

namespace countershade {

namespace {

using nlohmann::json;

bool has_axis(const std::string& kind) { return kind == "gray" || kind == "phase" || kind == "mask"; }

json json_of(const Role& r) {
  json j = {{"kind", r.kind}};
  if (!r.projector.empty()) j["projector"] = r.projector;
  if (has_axis(r.kind)) j["axis"] = r.axis;
  if (r.kind == "gray") j["bit"] = r.bit, j["inverse"] = r.inverse;
  if ((r.kind == "gray" && r.cell_px != 1) || r.kind == "blocks" || r.kind == "mask") j["cell_px"] = r.cell_px;
  if (r.kind == "blocks") j["inverse"] = r.inverse;
  if (r.kind == "blocks" || r.kind == "primary") j["channel"] = r.channel;
  if (r.kind == "blocks" || r.kind == "held-out") j["seed"] = r.seed;
  if (r.kind == "mask") j["step"] = r.step;
  if (r.kind == "phase") {
    j["period_px"] = r.period_px, j["step"] = r.step, j["steps"] = r.steps;
    if (r.shift_rad) j["shift_rad"] = *r.shift_rad;
    if (r.shown_exponent != 1) j["shown_exponent"] = r.shown_exponent;
  }
  return j;
}

Role role_of(const json& j) {
  Role r;
  r.kind = j.at("kind").get<std::string>();
  r.projector = j.value("projector", "");
  if (has_axis(r.kind)) r.axis = j.at("axis").get<std::string>();
  if (r.kind == "gray") r.bit = j.at("bit").get<int>();
  r.inverse = j.value("inverse", false);
  r.cell_px = j.value("cell_px", 1);
  r.channel = j.value("channel", "rgb");
  r.seed = j.value("seed", 0);
  r.period_px = r.kind == "phase" ? j.at("period_px").get<double>() : 0;
  r.step = j.value("step", 0);
  r.steps = r.kind == "phase" ? j.at("steps").get<int>() : 0;
  if (j.contains("shift_rad")) r.shift_rad = j.at("shift_rad").get<double>();
  r.shown_exponent = j.value("shown_exponent", 1.0);
  return r;
}

std::optional<std::string> wrong_with(const Role& r) {
  if (has_axis(r.kind) && r.axis != "x" && r.axis != "y") return fmt::format("axis '{}' is not x or y", r.axis);
  if (r.kind == "gray" && (r.bit < 0 || r.bit > 30)) return fmt::format("bit {} is not 0 to 30", r.bit);
  if (r.cell_px < 1) return fmt::format("cell_px {} is below 1", r.cell_px);
  if (r.kind == "phase" && (!(r.period_px > 0) || r.steps < 1)) return fmt::format("period_px {} and steps {} must be positive", r.period_px, r.steps);
  return std::nullopt;
}

}  // namespace

std::string Role::name() const {
  std::string text = kind;
  if (has_axis(kind)) text += " " + axis;
  if (kind == "gray") text += fmt::format(" bit {}", bit);
  if (kind == "blocks" || kind == "primary") text += " " + channel;
  if (kind == "phase" || kind == "mask") text += fmt::format(" step {}", step);
  if (inverse) text += " inverse";
  return projector.empty() ? text : text + " of " + projector;
}

Result<Sequence> read_sequence(const std::filesystem::path& path) {
  CS_TRY(const std::string text, read_text(path));
  Sequence sequence;
  int at = -1;
  try {
    const json j = json::parse(text);
    if (const int version = j.value("format_version", 1); version > 1)
      return error(ErrorCode::kBadFile, "'{}' has format_version {}, this program reads up to 1; use a newer countershade", path.string(), version);
    for (const auto& [id, p] : j.at("projectors").items()) {
      const auto resolution = p.at("resolution").get<std::array<int, 2>>();
      if (resolution[0] < 1 || resolution[1] < 1)
        return error(ErrorCode::kBadFile, "'{}': projector '{}' has resolution {} x {}", path.string(), id, resolution[0], resolution[1]);
      sequence.projectors.emplace_back(id, resolution);
    }
    std::set<int> seen;
    for (const json& f : j.at("frames")) {
      at = f.at("index").get<int>();
      const Frame frame{at, role_of(f.at("role"))};
      if (at < 0 || !seen.insert(at).second) return error(ErrorCode::kBadFile, "'{}': frame index {} is negative or stands twice", path.string(), at);
      if (const auto wrong = wrong_with(frame.role)) return error(ErrorCode::kBadFile, "'{}': frame {}: {}", path.string(), at, *wrong);
      sequence.frames.push_back(frame);
    }
  } catch (const json::exception& e) {
    const std::string where = at < 0 ? "" : fmt::format(" near frame {}", at);
    return error(ErrorCode::kBadFile, "'{}' is not a sequence{}: {}", path.string(), where, e.what());
  }
  if (sequence.projectors.empty() || sequence.frames.empty())
    return error(ErrorCode::kBadFile, "'{}' has {} projectors and {} frames; at least one of each is needed", path.string(), sequence.projectors.size(), sequence.frames.size());
  return sequence;
}

std::string sequence_text(const Sequence& sequence) {
  json projectors = json::object(), frames = json::array();
  for (const auto& [id, resolution] : sequence.projectors) projectors[id] = {{"resolution", resolution}};
  for (const Frame& f : sequence.frames) frames.push_back({{"index", f.index}, {"role", json_of(f.role)}});
  return json{{"format_version", 1}, {"projectors", projectors}, {"frames", frames}}.dump(1) + "\n";
}

}  // namespace countershade
