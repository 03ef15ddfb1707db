// Capture with the code that the scene needs.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "capture/device/device.h"
#include "capture/pattern/choose.h"
#include "capture/pattern/decode.h"
#include "capture/session/runner.h"

namespace countershade::tools {

struct CodedCapture {
  Sequence sequence;                         // what was captured
  std::vector<capture::CodeChoice> choices;  // per projector; empty where the code was given or is known already
  // Of the camera that calibrate uses, decoded while the photos were taken; and why other projectors could not be.
  std::vector<capture::Correspondence> decoded;
  std::vector<std::string> undecoded;
};

// Captures a session into `folder` (capture_session). code: a name of capture::codes(), or "auto": then the frames of
// base_sequence are captured first, choose_code judges them for each projector (with several cameras: the code that the
// neediest of them asks for), and the session goes on with what is left; code-choice.json in the folder says why. A
// session that stands there and has its whole sequence already is resumed with it. Errors: as capture_session,
// choose_code, kBadValue for an unknown code (names the nearest).
Result<CodedCapture> capture_with_code(const Rig& rig, const std::string& simulation_toml, const std::string& code,
                                       const capture::Devices& devices, const std::filesystem::path& folder,
                                       Progress& progress);

// What people are told of the choices (empty where there are none), and of what was decoded.
std::string choices_text(const CodedCapture& captured);
std::string decoded_text(const CodedCapture& captured);

}  // namespace countershade::tools
