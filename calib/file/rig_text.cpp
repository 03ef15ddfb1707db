// rig.toml as text: commented for the operator, canonical for a session.
#include <algorithm>

#include "calib/file/rig_fields.h"

namespace countershade {

namespace fields {

namespace {

std::string quoted(const std::string& text) {
  std::string out = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\')
      out += std::string("\\") + c;
    else if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f)
      out += fmt::format("\\u{:04x}", static_cast<int>(c));
    else
      out += c;
  }
  return out + "\"";
}

std::string number(int v) {
  return std::to_string(v);
}

// The shortest decimal that reads back equal, always a float to TOML.
std::string number(double v) {
  std::string text = fmt::format("{}", v);
  if (text.find_first_of(".en") == std::string::npos) text += ".0";
  return text;
}

template <class List>
std::string list(const List& values) {
  std::string text;
  for (const auto& v : values) text += (text.empty() ? "" : ", ") + number(v);
  return "[" + text + "]";
}

struct Text {
  std::string operator()(const std::string* v) const { return quoted(*v); }
  std::string operator()(const std::filesystem::path* v) const { return quoted(v->generic_string()); }
  std::string operator()(const int* v) const { return number(*v); }
  // TOML integers have a sign: the upper half of the seeds is written as negative numbers.
  std::string operator()(const std::uint64_t* v) const { return std::to_string(static_cast<std::int64_t>(*v)); }
  std::string operator()(const double* v) const { return number(*v); }
  std::string operator()(const bool* v) const { return *v ? "true" : "false"; }
  std::string operator()(const std::optional<double>* v) const { return *v ? number(**v) : ""; }
  std::string operator()(const std::optional<std::array<double, 2>>* v) const { return *v ? list(**v) : ""; }
  std::string operator()(Patches p) const { return *p.value == std::array<int, 2>{0, 0} ? "\"auto\"" : list(*p.value); }
  std::string operator()(const std::optional<ScreenSpec::KnownLength>* v) const {
    if (!*v) return "";
    ScreenSpec::KnownLength known = **v;
    std::string text;
    for (const Field& f : fields_of(known))
      text += fmt::format("{}{} = {}", text.empty() ? "" : ", ", f.name, value_text(f.slot));
    return "{ " + text + " }";
  }
  template <class List>
  std::string operator()(const List* v) const {
    return list(*v);
  }
};

struct IsSet {
  bool operator()(const std::string* v) const { return !v->empty(); }
  bool operator()(const std::filesystem::path* v) const { return !v->empty(); }
  bool operator()(const std::vector<double>* v) const { return !v->empty(); }
  template <class T>
  bool operator()(const std::optional<T>* v) const {
    return v->has_value();
  }
  template <class T>
  bool operator()(const T*) const {
    return true;
  }
  bool operator()(Patches) const { return true; }
};

}  // namespace

std::string value_text(const Slot& slot) {
  return std::visit(Text{}, slot);
}

bool is_set(const Slot& slot) {
  return std::visit(IsSet{}, slot);
}

}  // namespace fields

namespace {

using fields::Field;
using fields::Fields;

// A longer setting has its comment above it, a shorter one beside it.
constexpr std::size_t kLongSetting = 44;

enum class Style { kCanonical, kCommented };

std::string comment_of(const Field& field, const Field& fresh) {
  if (field.rule.mandatory) return field.comment;
  if (field.name == "shape") return field.comment + "; default: \"rectangle\"";  // `fresh` has the shape of its fields
  const std::string fallback = field.if_unset.empty() ? value_text(fresh.slot) : field.if_unset;
  return fmt::format("{}; default: {}", field.comment, fallback);
}

// `fresh`: the same fields of a table that holds nothing but defaults.
std::string lines(const Fields& fields, const Fields& fresh, Style style, bool all_unset = false) {
  std::vector<std::string> settings;
  std::vector<bool> set;
  std::size_t width = 0;
  for (std::size_t i = 0; i < fields.size(); ++i) {
    const Field& f = fields[i];
    const bool left_out = all_unset || (f.rule.seldom && value_text(f.slot) == value_text(fresh[i].slot));
    set.push_back(is_set(f.slot) && !left_out);
    const std::string value = is_set(f.slot) ? value_text(f.slot) : f.example;
    settings.push_back(fmt::format("{}{} = {}", set[i] ? "" : "# ", f.name, value));
    if (settings.back().size() <= kLongSetting) width = std::max(width, settings.back().size());
  }
  std::string text;
  for (std::size_t i = 0; i < fields.size(); ++i) {
    if (style == Style::kCommented && settings[i].size() > kLongSetting)
      text += fmt::format("# {}\n{}\n", comment_of(fields[i], fresh[i]), settings[i]);
    else if (style == Style::kCommented)
      text += fmt::format("{:<{}}  # {}\n", settings[i], width, comment_of(fields[i], fresh[i]));
    else if (set[i])
      text += settings[i] + "\n";
  }
  return text;
}

template <class T>
T fresh_like(const T&) {
  return {};
}
SimulatedSurface fresh_like(const SimulatedSurface& surface) {
  SimulatedSurface fresh;
  fresh.shape = surface.shape;  // says which fields there are
  return fresh;
}

template <class T>
std::string table(const std::string& name, T& values, Style style) {
  T fresh = fresh_like(values);
  return "\n" + name + "\n" + lines(fields::fields_of(values), fields::fields_of(fresh), style);
}

std::string heading(const char* text, Style style) {
  return style == Style::kCommented ? fmt::format("\n# {}", text) : "";
}

std::string board_text(BoardSpec& board, Style style) {
  if (!board.kind.empty()) return table("[board]", board, style);
  if (style == Style::kCanonical) return "";
  BoardSpec fresh;
  return "\n# [board]\n" + lines(fields::fields_of(board), fields::fields_of(fresh), style, true);
}

// By value: the fields want something they could write to.
std::string text_of(Rig rig, Style style) {
  std::string text = "format_version = 1\n";
  text += heading("The cameras, one table each.", style);
  for (CameraSpec& camera : rig.cameras) text += table("[[camera]]", camera, style);
  text += heading("The projectors, one table each.", style);
  for (ProjectorSpec& projector : rig.projectors) text += table("[[projector]]", projector, style);
  text += heading("What they light.", style);
  text += table("[screen]", rig.screen, style);
  text += heading("The board that was photographed, if one was.", style);
  text += board_text(rig.board, style);
  text += heading("What the audience shall see.", style);
  Rig fresh;
  text += "\n[intent]\n" + lines(fields::intent_of(rig), fields::intent_of(fresh), style);
  return text;
}

std::string text_of(Simulation simulation, Style style) {
  std::string text = table("[simulation]", simulation, style);
  for (SimulatedSurface& surface : simulation.surfaces) text += table("[[simulation.surface]]", surface, style);
  for (SimulatedCamera& camera : simulation.cameras) text += table("[[simulation.camera]]", camera, style);
  for (SimulatedProjector& projector : simulation.projectors)
    text += table("[[simulation.projector]]", projector, style);
  return text;
}

constexpr const char* kPreamble =
    "# The rig: what is known of cameras, projectors and screen.\n"
    "# Needed are the ids and the projectors' resolutions; all else has the default that its comment names.\n"
    "# A line '# name = value' shows a setting that is not set: take the # away and edit the value.\n"
    "# The centre of the first pixel is (0, 0). Encoded values and light count from 0 to 1.\n";

}  // namespace

std::string rig_text(const Rig& rig, const Simulation* simulation) {
  std::string text = kPreamble + text_of(rig, Style::kCommented);
  if (simulation != nullptr) {
    text +=
        heading("The truth of a room made of light that never was. Only the simulator reads it.", Style::kCommented);
    text += text_of(*simulation, Style::kCommented);
  }
  return text;
}

std::string canonical_rig_text(const Rig& rig) {
  return text_of(rig, Style::kCanonical);
}

std::string simulation_text(const Simulation& simulation) {
  return "format_version = 1\n" + text_of(simulation, Style::kCanonical);
}

}  // namespace countershade
