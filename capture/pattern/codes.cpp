// The frames of each code, in order (encode).
#include <cmath>
#include <numbers>

#include "calib/file/nearest.h"
#include "capture/pattern/pattern.h"

namespace countershade::capture {

namespace {

constexpr double kMadeFor = 1 / 2.2;  // sinusoids of light on a projector of this inverse exponent

// Every bit of the Gray code with its inverse, coarse ones first; those above `base` in exclusive or with it.
void add_bits(const Role& axis, int length, int base, std::vector<Role>& roles) {
  Role role = axis;
  for (int bit = gray_bits(length) - 1; bit >= 0; --bit)
    for (const bool inverse : {false, true}) {
      role.kind = base >= 0 && bit > base ? "xor" : "gray";
      role.bit = bit, role.inverse = inverse, role.base = bit > base ? std::max(base, 0) : 0;
      roles.push_back(role);
    }
}

void add_wave(const Role& axis, double period_px, double shift_rad, std::vector<Role>& roles) {
  Role role = axis;
  role.kind = "phase", role.period_px = period_px, role.shift_rad = shift_rad, role.shown_exponent = kMadeFor;
  role.steps = 1;
  roles.push_back(role);
}

void add_base(const Role& axis, std::vector<Role>& roles) {
  for (int step = 0; step < 3; ++step) add_wave(axis, 16, step * 2 * std::numbers::pi / 3, roles);
}

// Periods whose phases, all together with the base's, come near each other again as late as possible: within 2048 px no
// two columns a turn apart are closer than .47 amplitudes in the space of the frames, with the fourth period 1.0 (.82
// within 4096 px). Searched in steps of .1 px; the test Codes.MicroPhaseTellsColumnsApart measures it.
void add_micro_phase(const Role& axis, int length, bool more, std::vector<Role>& roles) {
  std::vector<double> others = {22.1, 23.3};
  if (length > 2048)
    others.push_back(23.4);
  else if (more)
    others.push_back(26.8);
  for (const double period : others)
    for (int step = 0; step < 2; ++step) add_wave(axis, period, step * std::numbers::pi / 2, roles);
}

// Three periods near the base's, whose beats with it are a period of the whole axis and the geometric mean of the two
// (embedded phase shifting, Moreno et al. 2015).
void add_embedded(const Role& axis, int length, std::vector<Role>& roles) {
  constexpr double kBase = 16;
  const double ratio = std::sqrt(length / kBase + 1);  // a turn more than the axis has
  for (const double beat : {kBase * ratio, kBase * ratio * ratio})
    for (int step = 0; step < 3; ++step)
      add_wave(axis, 1 / (1 / kBase + 1 / beat), step * 2 * std::numbers::pi / 3, roles);
}

// Each period a fifth of the one before, as far as noise lets a phase of the longer count the turns of the shorter.
void add_ladder(const Role& axis, int length, std::vector<Role>& roles) {
  constexpr double kShortest = 20;
  const int rungs = std::max(1, static_cast<int>(std::ceil(std::log(length / kShortest) / std::log(5.0))));
  const double ratio = std::pow(length / kShortest, 1.0 / rungs);
  for (int rung = 0; rung <= rungs; ++rung)
    for (int step = 0; step < 4; ++step)
      add_wave(axis, length / std::pow(ratio, rung), step * std::numbers::pi / 2, roles);
}

}  // namespace

const std::vector<std::pair<std::string, std::string>>& codes() {
  static const std::vector<std::pair<std::string, std::string>> kCodes = {
      {"gray", "Gray code with inverse"},
      {"xor-02", "Gray code in exclusive or with its finest bit, with inverse"},
      {"xor-04", "Gray code in exclusive or with its second finest bit, with inverse"},
      {"micro-phase", "sinusoids of 16 to 24 px that share offset and amplitude"},
      {"micro-phase-9", "the same with one more period, for weak light"},
      {"embedded", "sinusoids of nearly one period, whose beats are long ones: a baseline"},
      {"phase", "four-step sinusoids of a ladder of periods"},
  };
  return kCodes;
}

namespace {

Role axis_of(const ProjectorSpec& projector, int a) {
  Role axis;
  axis.projector = projector.id, axis.axis = a ? "y" : "x";
  return axis;
}

}  // namespace

std::vector<Role> base_roles(const ProjectorSpec& projector) {
  std::vector<Role> roles;
  Role role;
  role.projector = projector.id;
  for (const char* kind : {"white", "black"}) role.kind = kind, roles.push_back(role);
  for (int a = 0; a < 2; ++a) add_base(axis_of(projector, a), roles);
  return roles;
}

Result<std::vector<Role>> code_roles(const std::string& code, const ProjectorSpec& projector) {
  std::vector<Role> roles;
  for (int a = 0; a < 2; ++a) {
    const Role axis = axis_of(projector, a);
    const int length = projector.resolution[a];
    if (code == "gray")
      add_bits(axis, length, -1, roles);
    else if (code == "xor-02" || code == "xor-04")
      add_bits(axis, length, code == "xor-02" ? 0 : 1, roles);
    else if (code == "micro-phase" || code == "micro-phase-9")
      add_base(axis, roles), add_micro_phase(axis, length, code == "micro-phase-9", roles);
    else if (code == "embedded")
      add_base(axis, roles), add_embedded(axis, length, roles);
    else if (code == "phase")
      add_ladder(axis, length, roles);
  }
  if (!roles.empty()) return roles;
  std::vector<std::string> names;
  for (const auto& [name, what] : codes()) names.push_back(name);
  return error(ErrorCode::kBadValue, "there is no code '{}'; nearest valid name is '{}'", code, nearest(code, names));
}

}  // namespace countershade::capture
