#include "capture/pattern/plan.h"

#include <algorithm>

#include "capture/pattern/pattern.h"
#include "capture/pattern/read/phase.h"

namespace countershade::capture {

namespace {

void add_to_plan(const Frame& frame, CodePlan& plan) {
  const Role& role = frame.role;
  if (role.kind == "white" && plan.white < 0) plan.white = frame.index;
  if (role.kind == "black" && plan.black < 0) plan.black = frame.index;
  AxisCode& code = plan.axis[role.axis == "x" ? 0 : 1];
  if (role.kind == "gray" || role.kind == "xor") {
    code.cell_px = role.cell_px;
    code.bits.resize(std::max<std::size_t>(code.bits.size(), role.bit + 1));
    BitFrames& bit = code.bits[role.bit];
    (role.inverse ? bit.inverse : bit.plain) = frame.index;
    if (role.kind == "xor") bit.base = role.base;
  }
  if (role.kind == "phase") code.waves.push_back({frame.index, role.period_px, wave_shift(role)});
}

Result<void> check_bits(const AxisCode& code, const std::string& projector, const char* axis) {
  for (std::size_t b = 0; b < code.bits.size(); ++b) {
    const BitFrames& bit = code.bits[b];
    if (bit.plain < 0 || bit.inverse < 0)
      return error(ErrorCode::kRefused,
                   "projector '{}': Gray code bit {} of axis {} lacks its {} frame; this decoder needs every bit "
                   "with its inverse",
                   projector, b, axis, bit.plain < 0 ? "plain" : "inverse");
    if (bit.base >= 0 && (bit.base >= static_cast<int>(code.bits.size()) || code.bits[bit.base].base >= 0))
      return error(ErrorCode::kRefused,
                   "projector '{}': bit {} of axis {} was shown in exclusive or with bit {}, which the sequence has no "
                   "plain Gray frames of",
                   projector, b, axis, bit.base);
  }
  return {};
}

}  // namespace

Result<CodePlan> plan_code(const Sequence& sequence, const std::string& projector) {
  CodePlan plan;
  for (const auto& [id, resolution] : sequence.projectors)
    if (id == projector) plan.axis[0].length_px = resolution[0], plan.axis[1].length_px = resolution[1];
  const bool alone = sequence.projectors.size() == 1;
  for (const Frame& frame : sequence.frames)
    if (frame.role.projector == projector || (alone && frame.role.projector.empty())) add_to_plan(frame, plan);
  if (!plan.axis[0].exists() && !plan.axis[1].exists())
    return error(ErrorCode::kRefused,
                 "the sequence has no code for projector '{}'; its frames' roles must be {{\"kind\":\"gray\"}}, "
                 "{{\"kind\":\"xor\"}} or {{\"kind\":\"phase\"}} with projector '{}'",
                 projector, projector);
  for (int a = 0; a < 2; ++a) {
    CS_TRY_VOID(check_bits(plan.axis[a], projector, a ? "y" : "x"));
    if (!plan.axis[a].waves.empty()) CS_TRY_VOID(check_waves(plan.axis[a], projector, a ? "y" : "x"));
  }
  return plan;
}

}  // namespace countershade::capture
