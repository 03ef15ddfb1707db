// The verbs of the command line: each is one file that adds its subcommand; main runs what was asked for.
#pragma once

#include <chrono>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "calib/base/progress.h"
#include "calib/base/result.h"
#include "calib/file/file.h"

namespace CLI {
class App;
}

namespace countershade::tools {

// What a verb answers on stdout: text for people, or with --json one document for programs.
struct Answer {
  std::string text, json;
  int exit_code = 0;  // 1: the work was done and the verdict is FAIL
};

// What every verb gets.
struct Context {
  std::string version, command_line;
  Progress* progress = nullptr;
  std::vector<std::pair<std::string, std::string>> options;  // effective ones of the verb: name, value
  std::chrono::steady_clock::time_point started = std::chrono::steady_clock::now();

  double seconds() const;  // since the start
  // provenance.json beside an output (HOUSE.md): version, command, options, seconds, and hashes of the given inputs.
  Result<void> record(const std::filesystem::path& folder, const std::vector<std::filesystem::path>& inputs) const;
  // The same, to be done before an output folder appears (create_folder_atomically).
  FillFolder recorder(std::vector<std::filesystem::path> inputs) const;
};

using Action = std::function<Result<Answer>(const Context&)>;

// Each adds one subcommand, whose callback sets `action`.
void add_new(CLI::App& app, Action& action);
void add_devices(CLI::App& app, Action& action);
void add_check(CLI::App& app, Action& action);
void add_patterns(CLI::App& app, Action& action);
void add_capture(CLI::App& app, Action& action);
void add_import(CLI::App& app, Action& action);
void add_simulate(CLI::App& app, Action& action);
void add_lens(CLI::App& app, Action& action);
void add_calibrate(CLI::App& app, Action& action);
void add_compensate(CLI::App& app, Action& action);
void add_play(CLI::App& app, Action& action);
void add_verify(CLI::App& app, Action& action);
void add_run(CLI::App& app, Action& action);

}  // namespace countershade::tools
