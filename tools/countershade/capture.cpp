// capture, simulate, patterns, import: everything that makes sessions or what they are made of.
#include "capture/session/runner.h"

#include <CLI/CLI.hpp>

#include "calib/file/file.h"
#include "capture/pattern/identity.h"
#include "tools/countershade/verbs.h"
#include "tools/job/coded_capture.h"
#include "tools/job/devices.h"
#include "tools/job/truth_files.h"

namespace countershade::tools {

namespace {

namespace fs = std::filesystem;

struct Options {
  fs::path rig, out, photos, sequence;
  std::string faults, code = "auto";
  std::optional<int> samples;
  fs::path truth;
  TruthOptions truth_options;
  bool identity = false;
  capture::MarkLayout marks;
};

Answer session_answer(const fs::path& session, std::size_t frames, const std::string& before = "") {
  return {before + fmt::format("session {} is complete: {} frames\nnext: countershade calibrate {} -o calibration/\n",
                               session.string(), frames, session.string()),
          fmt::format("{{\"session\": \"{}\", \"frames\": {}}}\n", session.string(), frames)};
}

Answer list_faults() {
  std::string text = fmt::format("{:<18}{:<20}{:>8}  {:<14}{:>6}  {}\n", "fault", "unit", "default", "range", "photo",
                                 "what it imitates");
  std::string rows;
  for (const simdata::FaultKind& k : simdata::fault_kinds()) {
    text += fmt::format("{:<18}{:<20}{:>8}  {:<14}{:>6}  {}\n", k.name, k.unit, k.value,
                        fmt::format("{} to {}", k.low, k.high), k.photo, k.what);
    rows += fmt::format(
        "{}{{\"name\": \"{}\", \"unit\": \"{}\", \"default\": {}, \"low\": {}, \"high\": {}, \"photo\": {}, "
        "\"what\": \"{}\"}}",
        rows.empty() ? "" : ", ", k.name, k.unit, k.value, k.low, k.high, k.photo, k.what);
  }
  return {text + "--faults name=value@photo,... : several at once; photo = the first one that it acts on\n",
          "[" + rows + "]\n"};
}

Result<Answer> run_capture(const Options& options, bool simulate, const Context& context) {
  if (options.faults == "list") return list_faults();
  std::vector<simdata::Fault> faults;
  if (!options.faults.empty()) {
    CS_TRY(faults, simdata::parse_faults(options.faults));
  }
  if (options.rig.empty())
    return error(ErrorCode::kBadValue, "which rig? countershade simulate RIG.toml (countershade new writes one)");
  if (options.truth_options.light && options.truth.empty())
    return error(ErrorCode::kBadValue, "--truth-light says what --truth shall write; add --truth FOLDER");
  if (!options.truth.empty() && fs::exists(options.truth))
    return error(ErrorCode::kExists, "'{}' exists already; choose another name with --truth or remove it",
                 options.truth.string());
  if (!options.truth.empty()) {
    const fs::path inside = fs::absolute(options.truth).lexically_relative(fs::absolute(options.out));
    if (!inside.empty() && *inside.begin() != "..")
      return error(ErrorCode::kBadValue,
                   "--truth '{}' lies in the session '{}', which shall not know it; choose another",
                   options.truth.string(), options.out.string());
  }
  CS_TRY(Rig rig, read_rig(options.rig));
  if (simulate)
    for (CameraSpec& camera : rig.cameras) camera.backend = "simulated";
  CS_TRY(const OpenDevices open, open_devices(rig, options.rig, *context.progress, std::move(faults), options.samples));
  const std::string simulation = open.simulator ? simulation_text(open.simulator->simulation()) : "";
  if (!options.truth.empty()) CS_TRY_VOID(check_truth(open.simulator->simulation(), options.truth_options));
  CS_TRY(const CodedCapture captured,
         capture_with_code(rig, simulation, options.code, open.devices, options.out, *context.progress));
  if (!options.truth.empty())
    CS_TRY_VOID(
        write_truth(*open.simulator, captured.sequence, options.truth, options.truth_options, *context.progress));
  CS_TRY_VOID(context.record(options.out, {options.rig}));
  return session_answer(options.out, captured.sequence.frames.size(), choices_text(captured) + decoded_text(captured));
}

Result<Answer> run_patterns(const Options& options, const Context& context) {
  CS_TRY(const Rig rig, read_rig(options.rig));
  Sequence sequence = capture::default_sequence(rig);
  if (options.identity) {
    CS_TRY(sequence.identity, capture::identity_marks(sequence, options.marks));
  }
  CS_TRY_VOID(capture::write_patterns(sequence, options.out, context.recorder({options.rig})));
  const std::string out = options.out.string();
  const std::string next =
      options.identity
          ? fmt::format(
                "play {}/NNNN/<projector>.png in order, at any time and as often as you like, photograph, then\n"
                "countershade import {} --sequence {}/sequence.json --photos FOLDER",
                out, options.rig.string(), out)
          : fmt::format("show {}/NNNN/<projector>.png on each projector, photograph, then countershade import", out);
  return Answer{fmt::format("wrote {} frames to {}: {}\n", sequence.frames.size(), out, next),
                fmt::format("{{\"patterns\": \"{}\", \"frames\": {}}}\n", out, sequence.frames.size())};
}

Result<Answer> run_import(const Options& options, const Context& context) {
  CS_TRY(const Rig rig, read_rig(options.rig));
  Sequence sequence = capture::default_sequence(rig);
  fs::path file = options.sequence;
  if (file.empty() && fs::exists(options.photos / "sequence.json")) file = options.photos / "sequence.json";
  if (!file.empty()) {
    CS_TRY(sequence, read_sequence(file));
  }
  CS_TRY_VOID(capture::import_session(rig, sequence, options.photos, options.out, *context.progress,
                                      context.recorder({options.rig})));
  return session_answer(options.out, sequence.frames.size());
}

void add_code(CLI::App* verb, Options& options) {
  verb->add_option("--code", options.code,
                   "how projector pixels are told apart: auto (the cheapest that the first photos say will do), gray, "
                   "xor-02, xor-04, micro-phase, micro-phase-9, embedded, phase")
      ->capture_default_str();
}

CLI::App* add_verb(CLI::App& app, const char* name, const char* what, Options& options, const char* out) {
  auto* verb = app.add_subcommand(name, what);
  verb->add_option("rig", options.rig, "rig.toml")->required();
  options.out = out;
  verb->add_option("-o,--output", options.out, "folder to write")->capture_default_str();
  return verb;
}

}  // namespace

void add_capture(CLI::App& app, Action& action) {
  auto options = std::make_shared<Options>();
  auto* verb = add_verb(app, "capture", "show, photograph, store; resumes where it was stopped", *options, "session");
  add_code(verb, *options);
  verb->callback(
      [options, &action] { action = [options](const Context& c) { return run_capture(*options, false, c); }; });
}

void add_simulate(CLI::App& app, Action& action) {
  auto options = std::make_shared<Options>();
  auto* verb = add_verb(app, "simulate", "capture the same rig made of light that never was ([simulation] of rig.toml)",
                        *options, "session");
  add_code(verb, *options);
  verb->get_option("rig")->required(false);  // not for `--faults list`
  verb->add_option("--faults", options->faults, "what goes wrong: name=value@photo,...; `list` shows them all");
  verb->add_option(
      "--samples", options->samples,
      "instead of the rig's: strata by which a point looks at the room, 16 to 65536; fewer than 1024 are a "
      "draft");
  verb->add_option("--truth", options->truth,
                   "folder to write the room's truth to: geometry, correspondences, form factors, transport, devices");
  verb->add_option("--truth-patches", options->truth_options.patches, "patches per surface along u and v")
      ->delimiter(',')
      ->check(CLI::Range(1, 4096))
      ->capture_default_str();
  verb->add_option("--truth-rays", options->truth_options.rays, "rays per patch")
      ->check(CLI::Range(100, 10000000))
      ->capture_default_str();
  verb->add_flag("--truth-light", options->truth_options.light, "direct and indirect light of every frame, too");
  verb->callback(
      [options, &action] { action = [options](const Context& c) { return run_capture(*options, true, c); }; });
}

void add_patterns(CLI::App& app, Action& action) {
  auto options = std::make_shared<Options>();
  auto* verb =
      add_verb(app, "patterns", "write every picture to show, for photographing by hand", *options, "patterns");
  verb->add_flag("--identity", options->identity,
                 "each picture says by itself which one it is, by marks in squares that it gives up: for pictures that "
                 "somebody else plays");
  verb->add_option("--identity-corners", options->marks.corners,
                   "marks are near: top-left, top-right, bottom-left, bottom-right; two at least, on the screen, where "
                   "the camera sees them")
      ->delimiter(',')
      ->capture_default_str();
  verb->add_option("--identity-inset", options->marks.inset,
                   "from there to the picture's edges, of its width and height")
      ->capture_default_str();
  verb->add_option("--identity-px", options->marks.side_px,
                   "edge of a mark [default: a twelfth of the picture's height, 44 px at least]");
  verb->callback([options, &action] { action = [options](const Context& c) { return run_patterns(*options, c); }; });
}

void add_import(CLI::App& app, Action& action) {
  auto options = std::make_shared<Options>();
  auto* verb = add_verb(app, "import", "make a session from photos taken elsewhere", *options, "session");
  verb->add_option("--photos", options->photos,
                   "folder of photos: NNNN.png|tif|exr, or <camera id>/NNNN.*; with any name where the sequence has "
                   "marks of identity (patterns --identity)")
      ->required();
  verb->add_option(
      "--sequence", options->sequence,
      "sequence.json that says what the photos show [default: photos/sequence.json, else our own sequence]");
  verb->callback([options, &action] { action = [options](const Context& c) { return run_import(*options, c); }; });
}

}  // namespace countershade::tools
