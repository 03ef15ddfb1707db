// countershade: measure, model, compensate, photograph, verify. Exit codes: 0 done, 1 the world (or the verdict)
// failed, 2 wrong usage, 70 a bug of ours.
#include <CLI/CLI.hpp>
#include <cstdio>

#include "tools/countershade/console.h"
#include "tools/countershade/verbs.h"

namespace countershade::tools {

namespace {

std::string joined(int argc, char** argv) {
  std::string line;
  for (int i = 0; i < argc; ++i) line += (i ? " " : "") + std::string(argv[i]);
  return line;
}

// Name and value of every option of the verb, as given or by default.
std::vector<std::pair<std::string, std::string>> effective_options(const CLI::App& app) {
  std::vector<std::pair<std::string, std::string>> options;
  for (const CLI::App* verb : app.get_subcommands())
    for (const CLI::Option* option : verb->get_options()) {
      if (option->get_name(false, true) == "--help") continue;
      std::string value = option->get_default_str();
      if (option->count() > 0) value = fmt::format("{}", fmt::join(option->results(), ", "));
      if (!value.empty()) options.emplace_back(option->get_single_name(), value);
    }
  return options;
}

int run(int argc, char** argv) {
  CLI::App app("Measures how a concave projection screen lights itself, and compensates it.", "countershade");
  app.set_version_flag("--version", COUNTERSHADE_VERSION);
  app.require_subcommand(1);
  app.fallthrough();
  bool as_json = false;
  app.add_flag("--json", as_json, "answer as one JSON document on stdout, progress as JSON lines on stderr");
  Action action;
  for (auto add : {add_new, add_devices, add_check, add_patterns, add_capture, add_import, add_simulate, add_lens,
                   add_calibrate, add_compensate, add_play, add_verify, add_run})
    add(app, action);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    return app.exit(e) == 0 ? 0 : 2;
  }
  ConsoleProgress progress(as_json ? ConsoleMode::kJson : default_console_mode());
  const Context context{COUNTERSHADE_VERSION, joined(argc, argv), &progress, effective_options(app)};
  const Result<Answer> answer = action(context);
  progress.finish();
  if (!answer) {
    std::fprintf(stderr, "countershade: %s\n", answer.error().message.c_str());
    return 1;
  }
  std::fputs((as_json ? answer->json : answer->text).c_str(), stdout);
  return answer->exit_code;
}

}  // namespace

}  // namespace countershade::tools

int main(int argc, char** argv) {
  countershade::tools::keep_memory();
  try {
    return countershade::tools::run(argc, argv);
  } catch (const std::exception& e) {
    std::fprintf(stderr, "countershade: this is a bug of countershade, please report it: %s\n", e.what());
    return 70;
  }
}
