#include "tools/job/coded_capture.h"

#include <algorithm>

#include <fmt/format.h>

#include "calib/file/file.h"
#include "calib/file/nearest.h"
#include "capture/session/live_decoding.h"
#include "tools/job/calibration.h"

namespace countershade::tools {

namespace fs = std::filesystem;

namespace {

constexpr const char* kChoiceFile = "code-choice.json";

std::vector<std::string> names_of_codes() {
  std::vector<std::string> names = {"auto"};
  for (const auto& [name, what] : capture::codes()) names.push_back(name);
  return names;
}

// Of what several cameras ask for: the forecasts at their worst, chosen anew.
Result<capture::CodeChoice> choose_for_all(const Session& session, const std::string& projector) {
  std::optional<capture::CodeChoice> neediest;
  std::optional<Error> blind;
  for (const CameraSpec& camera : session.rig().cameras) {
    const auto photos = [&](int index) { return session.photo(camera.id, index); };
    const auto choice = capture::choose_code(session.sequence(), photos, projector, {});
    if (!choice) {
      blind = choice.error();  // a camera that does not see this projector has no say
      continue;
    }
    const auto frames = [](const capture::CodeChoice& c) {
      for (const capture::CodeForecast& f : c.forecasts)
        if (f.code == c.code) return f.frames;
      return 0;
    };
    if (!neediest || frames(*choice) > frames(*neediest)) neediest = *choice;
  }
  if (!neediest) return *blind;
  return *std::move(neediest);
}

// The sequence that stands in a session which began with these frames, where it has more than them.
std::optional<Sequence> stored_sequence(const fs::path& folder, const Sequence& base) {
  if (!fs::exists(folder / "sequence.json")) return std::nullopt;
  const auto stored = read_sequence(folder / "sequence.json");
  const bool grown = stored && stored->frames.size() > base.frames.size() && stored->projectors == base.projectors &&
                     std::equal(base.frames.begin(), base.frames.end(), stored->frames.begin(),
                                [](const Frame& a, const Frame& b) { return a.role == b.role; });
  return grown ? std::optional(*stored) : std::nullopt;
}

// Captures what is missing of the sequence, and decodes it meanwhile.
Result<void> capture_and_decode(const Rig& rig, const std::string& simulation_toml, const capture::Devices& devices,
                                const fs::path& folder, bool extend, capture::Lateness& lateness,
                                CodedCapture& captured, Progress& progress) {
  capture::LiveDecoding decoding(folder, captured.sequence, camera_to_use(rig).id);
  capture::CaptureOptions options;
  options.extend = extend;
  options.lateness = &lateness;
  options.stored = [&](int frame) { decoding.stored(frame); };
  options.set_aside = [&] { decoding.restart(); };
  CS_TRY_VOID(capture::capture_session(rig, simulation_toml, captured.sequence, devices, folder, options, progress));
  for (Result<capture::Correspondence>& c : decoding.finish())
    if (c)
      captured.decoded.push_back(*std::move(c));
    else
      captured.undecoded.push_back(c.error().message);
  return {};
}

}  // namespace

Result<CodedCapture> capture_with_code(const Rig& rig, const std::string& simulation_toml, const std::string& code,
                                       const capture::Devices& devices, const fs::path& folder, Progress& progress) {
  const std::vector<std::string> names = names_of_codes();
  if (std::find(names.begin(), names.end(), code) == names.end())
    return error(ErrorCode::kBadValue, "there is no code '{}'; nearest valid name is '{}'", code, nearest(code, names));
  CodedCapture captured;
  capture::Lateness lateness;
  std::vector<std::string> codes(rig.projectors.size(), code);
  if (code == "auto") {
    const Sequence base = capture::base_sequence(rig);
    if (const auto stored = stored_sequence(folder, base)) {
      captured.sequence = *stored;
      CS_TRY_VOID(capture_and_decode(rig, simulation_toml, devices, folder, false, lateness, captured, progress));
      return captured;
    }
    capture::CaptureOptions options;
    options.lateness = &lateness;
    CS_TRY_VOID(capture::capture_session(rig, simulation_toml, base, devices, folder, options, progress));
    CS_TRY(const Session session, Session::open(folder));
    for (std::size_t q = 0; q < codes.size(); ++q) {
      CS_TRY(capture::CodeChoice choice, choose_for_all(session, rig.projectors[q].id));
      codes[q] = choice.code;
      captured.choices.push_back(std::move(choice));
    }
  }
  // Before the sequence grows: a session that has grown has it, whenever the power goes.
  if (!captured.choices.empty())
    CS_TRY_VOID(write_atomically(folder / kChoiceFile, capture::choices_json(captured.choices)));
  CS_TRY(captured.sequence, capture::sequence_with(rig, codes));
  CS_TRY_VOID(capture_and_decode(rig, simulation_toml, devices, folder, code == "auto", lateness, captured, progress));
  return captured;
}

std::string choices_text(const CodedCapture& captured) {
  std::string text;
  for (const capture::CodeChoice& c : captured.choices) text += capture::choice_text(c);
  return text;
}

std::string decoded_text(const CodedCapture& captured) {
  std::string text;
  for (const capture::Correspondence& c : captured.decoded)
    text += fmt::format("decoded {:<12} {:5.1f} % of {} lit pixels\n", c.projector,
                        c.lit ? 100.0 * static_cast<double>(c.accepted) / static_cast<double>(c.lit) : 0.0, c.lit);
  for (const std::string& why : captured.undecoded) text += "not decoded: " + why + "\n";
  return text;
}

}  // namespace countershade::tools
