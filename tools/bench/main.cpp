#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "calib/file/file.h"
#include "calib/file/nearest.h"
#include "tools/bench/study.h"
#include "tools/bench/sweep/sweep.h"
#include "tools/countershade/console.h"

namespace countershade::bench {

namespace {

const std::vector<std::pair<std::string, StudyFunction>> kStudies = {
    {"form-factors", form_factors},
    {"closed-form", closed_form},
    {"first-speed", first_speed},
    {"decode-real", decode_real},
    {"two-wall-loop", two_wall_loop},
    {"verify-honest", verify_honest},
    {"sim-faults", sim_faults},
    {"sim-speed", sim_speed},
    {"sim-truth", sim_truth},
    {"decode-hard", decode_hard},
    {"decode-economy", decode_economy},
    {"pre-scan", pre_scan},
    {"decode-speed", decode_speed},
    {"lens", lens_calibration},
    {"kill", kill_study},
    {"sync", sync_study},
    {"capture-to-show", capture_to_show},
    {"camera-throughput", camera_throughput},
    {"loss", loss_study},
};

void print(const Study& study) {
  std::vector<std::size_t> width;
  for (const auto& c : study.columns) width.push_back(c.size());
  for (const auto& row : study.rows)
    for (std::size_t i = 0; i < row.size() && i < width.size(); ++i) width[i] = std::max(width[i], row[i].size());
  const auto line = [&](const std::vector<std::string>& cells) {
    for (std::size_t i = 0; i < cells.size(); ++i) std::printf("%-*s  ", static_cast<int>(width[i]), cells[i].c_str());
    std::printf("\n");
  };
  std::printf("\n%s\n", study.title.c_str());
  line(study.columns);
  for (const auto& row : study.rows) line(row);
  for (const auto& note : study.notes) std::printf("note: %s\n", note.c_str());
}

// Prints a study and writes NAME.json and NAME.csv; whether it is ok.
Result<bool> publish(const std::string& name, const Study& study, const StudyContext& context) {
  print(study);
  nlohmann::json document = {{"study", name},        {"title", study.title}, {"columns", study.columns},
                             {"rows", study.rows},   {"notes", study.notes}, {"figure", study.figure},
                             {"bound", study.bound}, {"ok", study.ok}};
  for (const auto& [label, text] : study.labels) document["labels"][label] = text;
  CS_TRY_VOID(write_atomically(context.output / (name + ".json"), document.dump(1) + "\n"));
  CS_TRY_VOID(write_atomically(context.output / (name + ".csv"), csv_of(study)));
  std::printf("%s: %s (%s) %s\n", name.c_str(), study.figure.c_str(), study.bound.c_str(), study.ok ? "ok" : "short");
  std::fflush(stdout);
  return study.ok;
}

Result<bool> run_one(const std::string& name, StudyFunction function, const StudyContext& context) {
  CS_TRY(const Study study, function(context));
  return publish(name, study, context);
}

// 0: all ok; 1: some are short; 2: the harness failed or does not know a name.
int run_sweeps(const std::vector<std::string>& names, bool quick, const StudyContext& context) {
  std::vector<std::string> known{"all"};
  for (const Sweep& s : sweeps()) known.push_back(s.name);
  for (const std::string& name : names)
    if (std::find(known.begin(), known.end(), name) == known.end()) {
      std::fprintf(stderr, "no sweep '%s'; the nearest is '%s' (`sweep` without a name lists them)\n", name.c_str(),
                   nearest(name, known).c_str());
      return 2;
    }
  const bool all = std::find(names.begin(), names.end(), "all") != names.end();
  int status = 0;
  for (const Sweep& s : sweeps()) {
    if (names.empty()) std::printf("%-10s %s: %s\n", s.name.c_str(), s.title.c_str(), s.predictor_name.c_str());
    if (!all && std::find(names.begin(), names.end(), s.name) == names.end()) continue;
    const Result<Study> study = run_sweep(s, quick, context);
    const Result<bool> ok = study ? publish(s.name, *study, context) : Result<bool>(study.error());
    if (!ok) std::fprintf(stderr, "%s: %s\n", s.name.c_str(), ok.error().message.c_str());
    status = std::max(status, !ok ? 2 : *ok ? 0 : 1);
  }
  return status;
}

int run(int argc, char** argv) {
  CLI::App app("Measures the figures that the project claims.");
  std::vector<std::string> names;
  std::filesystem::path output = "bench";
  app.add_option("names", names, "studies to run; all without a name");
  app.add_option("--output", output, "folder for NAME.json and NAME.csv")->capture_default_str();
  auto* sweep =
      app.add_subcommand("sweep", "where the method fails, and whether it says so; lists them without a name");
  std::vector<std::string> swept;
  bool quick = false;
  sweep->add_option("names", swept, "sweeps to run, or `all`");
  sweep->add_flag("--quick", quick, "few points in a smaller room");
  sweep->fallthrough();
  auto* gallery = app.add_subcommand("gallery", "render the rooms of docs/rooms.md");
  gallery->fallthrough();
  CLI11_PARSE(app, argc, argv);
  tools::ConsoleProgress progress(tools::default_console_mode());
  std::error_code code;
  std::filesystem::create_directories(output, code);
  if (*gallery) {
    const Result<void> made = render_gallery({output, &progress});
    progress.finish();
    if (!made) std::fprintf(stderr, "gallery: %s\n", made.error().message.c_str());
    return made ? 0 : 1;
  }
  if (*sweep) return run_sweeps(swept, quick, {output, &progress});
  bool all_ok = true;
  for (const std::string& name : names)
    if (std::none_of(kStudies.begin(), kStudies.end(), [&](const auto& s) { return s.first == name; })) {
      std::fprintf(stderr, "no study '%s'; there are:", name.c_str());
      for (const auto& [known, function] : kStudies) std::fprintf(stderr, " %s", known.c_str());
      std::fprintf(stderr, "\n");
      return 2;
    }
  for (const auto& [name, function] : kStudies) {
    if (!names.empty() && std::find(names.begin(), names.end(), name) == names.end()) continue;
    const Result<bool> ok = run_one(name, function, {output, &progress});
    progress.finish();
    if (!ok) std::fprintf(stderr, "%s: %s\n", name.c_str(), ok.error().message.c_str());
    all_ok = all_ok && ok && *ok;
  }
  return all_ok ? 0 : 1;
}

}  // namespace

}  // namespace countershade::bench

int main(int argc, char** argv) {
  countershade::tools::keep_memory();
  return countershade::bench::run(argc, argv);
}
