// kill: the power goes, or the disk is full or read-only, at every moment at which a session or a calibration is
// written; the same command is given again, and the result is compared with an undisturbed one.
#include <algorithm>
#include <cerrno>
#include <map>

#include "calib/file/file.h"
#include "calib/geometry/lens.h"
#include "simdata/room/rooms.h"
#include "tools/bench/kill/write_calls.h"
#include "tools/bench/study.h"

namespace countershade::bench {

namespace {

namespace fs = std::filesystem;

// Hash of every file below a folder by its relative name, hidden ones too; "" of those that hold how long it took.
std::map<std::string, std::string> tree(const fs::path& folder) {
  std::map<std::string, std::string> files;
  std::error_code ignored;
  for (const auto& entry : fs::recursive_directory_iterator(folder, ignored))
    if (entry.is_regular_file()) {
      const std::string name = entry.path().filename().string();
      const bool timed = name == "provenance.json" || name == "report.html" || name == "numbers.json";
      const auto hash = timed ? Result<std::string>("") : hash_file(entry.path());
      files[fs::relative(entry.path(), folder).string()] = hash ? *hash : "unreadable";
    }
  return files;
}

bool is_photo(const std::string& name) {
  return name.ends_with(".tif") && name.find("/.") == std::string::npos;
}

// One command that writes one folder, and what it leaves there when nothing happens.
struct Job {
  std::string name;
  std::vector<std::string> command;  // ends in -o FOLDER
  fs::path scratch, output;
  std::map<std::string, std::string> expected;
  std::vector<std::string> calls;
  std::string elsewhere;  // calls on what has this in its path are tried by another job
  std::size_t every = 1;  // n-th call
};

struct Score {
  int disasters = 0, lost_sessions = 0, lost_photos = 0, wrong_photos = 0, unlike = 0, unsaid = 0;
  std::string first;  // what went wrong first
  void blame(const Job& job, std::size_t at, const std::string& what) {
    if (first.empty()) first = fmt::format("{} at call {} ({}): {}", job.name, at, job.calls[at], what);
  }
};

Result<Ending> run(const Job& job, const Doom& doom) {
  return run_to_disaster(job.command, job.scratch, doom);
}

void empty(const fs::path& folder) {
  std::error_code ignored;
  fs::remove_all(folder, ignored);
  fs::create_directories(folder, ignored);
}

Result<Job> rehearsed(Job job) {
  empty(job.scratch);
  CS_TRY(const Ending ending, run(job, {}));
  if (ending.exit_code != 0)
    return error(ErrorCode::kRefused, "{}, undisturbed: exit code {}: {}", job.name, ending.exit_code, ending.output);
  job.expected = tree(job.output);
  job.calls = ending.calls;
  return job;
}

// What stands there after the disaster: only whole photos under their own names, and all that were stored before it.
void look_after(const Job& job, std::size_t at, const Ending& ending, Score& score) {
  const auto found = tree(job.output);
  int photos = 0, wrong = 0;
  for (const auto& [name, hash] : found) {
    if (!is_photo(name)) continue;
    const auto whole = job.expected.find(name);
    ++photos;
    wrong += whole == job.expected.end() || whole->second != hash;
  }
  // A photo that has its name is stored.
  int renamed = 0;
  for (std::size_t i = 0; i < std::min(at, ending.calls.size()); ++i)
    renamed += ending.calls[i].starts_with("rename") && ending.calls[i].ends_with(".tif");
  score.wrong_photos += wrong;
  score.lost_photos += std::max(0, renamed - photos);
  if (wrong) score.blame(job, at, fmt::format("{} photos are not what was photographed", wrong));
  if (renamed > photos) score.blame(job, at, fmt::format("{} of {} photos are gone", renamed - photos, renamed));
}

// The same command again: it ends well, and the folder is as if nothing had happened.
Result<void> look_again(const Job& job, std::size_t at, Score& score) {
  const bool whole = tree(job.output) == job.expected;
  CS_TRY(const Ending ending, run(job, {}));
  // What is finished is not done again: it says so.
  const bool finished = whole && ending.output.find("exists already") != std::string::npos;
  if (ending.exit_code != 0 && !finished) {
    ++score.lost_sessions;
    score.blame(job, at, fmt::format("again: exit code {}: {}", ending.exit_code, ending.output));
    return {};
  }
  // Beside the output nothing is left, either.
  const auto all = tree(job.scratch);
  const bool same = tree(job.output) == job.expected && all.size() == job.expected.size();
  score.unlike += !same;
  if (same) return {};
  std::string difference;
  for (const auto& [name, hash] : tree(job.output))
    if (!job.expected.contains(name) || job.expected.at(name) != hash) difference += " " + name;
  for (const auto& [name, hash] : job.expected)
    if (!fs::exists(job.output / name)) difference += " (without) " + name;
  if (difference.empty()) difference = fmt::format("{} files beside it", all.size() - job.expected.size());
  score.blame(job, at, "again, it differs:" + difference);
  return {};
}

Result<void> suffer(const Job& job, const Doom& doom, Score& score) {
  empty(job.scratch);
  CS_TRY(const Ending ending, run(job, doom));
  ++score.disasters;
  look_after(job, doom.at, ending, score);
  if (doom.disaster == Disaster::kFail && !ending.killed && ending.exit_code != 0) {
    const char* reason = doom.error == ENOSPC ? "No space left" : "Read-only file system";
    if (ending.exit_code != 1 || ending.output.find(reason) == std::string::npos) {
      ++score.unsaid;
      score.blame(job, doom.at, fmt::format("exit code {} and no reason: {}", ending.exit_code, ending.output));
    }
  }
  return look_again(job, doom.at, score);
}

struct Kind {
  std::string name;
  Doom doom;
  std::size_t every;  // n-th call of those it can happen to
};

Result<Score> suffer_all(const Job& job, const Kind& kind, Progress& progress) {
  Score score;
  std::size_t met = 0;
  for (std::size_t at = 0; at < job.calls.size(); ++at) {
    progress.step(job.name + ": " + kind.name, at, job.calls.size());
    // Between two calls nothing changes: a kill after one is a kill before the next, but for a write that is cut.
    if (kind.doom.disaster == Disaster::kTear && !job.calls[at].starts_with("write ")) continue;
    if (!job.elsewhere.empty() && job.calls[at].find(job.elsewhere) != std::string::npos) continue;
    if (met++ % (kind.every * job.every) != 0) continue;
    Doom doom = kind.doom;
    doom.at = at;
    CS_TRY_VOID(suffer(job, doom, score));
  }
  progress.step(job.name + ": " + kind.name, job.calls.size(), job.calls.size());
  return score;
}

}  // namespace

Result<Study> kill_study(const StudyContext& context) {
  Study study{"Power cut, full disk and read-only disk at every moment of a session and of a calibration",
              {"job", "disaster", "calls", "disasters", "sessions lost", "photos lost", "wrong photos",
               "not the same bytes", "no reason given"},
              {},
              {},
              "",
              "",
              false};
  const fs::path folder = fs::absolute(context.output / "kill");
  empty(folder);
  simdata::RigAndRoom room = simdata::small_two_wall(8, {160, 100}, 64);
  CS_TRY(Device lens, simdata::true_camera(room.simulation, room.rig.cameras[0].id));
  lens.device_from_world = {};
  CS_TRY_VOID(write_cameramodel(folder / room.rig.cameras[0].model, lens));
  room.rig.cameras[0].exposures_ms = {10, 5};
  CS_TRY_VOID(write_atomically(folder / "rig.toml", rig_text(room.rig, &room.simulation)));
  const std::string program = (fs::read_symlink("/proc/self/exe").parent_path() / "countershade").string();
  const auto job = [&](const std::string& verb, const fs::path& input) {
    Job j{verb, {program, verb, input.string(), "-o"}, folder / verb, folder / verb / "out", {}, {}, "", 1};
    j.command.push_back(j.output.string());
    return rehearsed(j);
  };
  CS_TRY(const Job capture, job("simulate", folder / "rig.toml"));
  CS_TRY(Job whole, job("run", folder / "rig.toml"));
  whole.elsewhere = "out/session/", whole.every = 2;
  std::error_code code;
  fs::rename(capture.output, folder / "session", code);
  if (code) return error(ErrorCode::kIo, "'{}' cannot be renamed: {}", capture.output.string(), code.message());
  CS_TRY(const Job calibrate, job("calibrate", folder / "session"));

  int kills = 0, bad = 0;
  for (const Job* j : {&capture, &calibrate, static_cast<const Job*>(&whole)})
    for (const Kind& kind :
         {Kind{"killed", {Disaster::kKill, 0, 0}, 1}, Kind{"killed in a write", {Disaster::kTear, 0, 0}, 1},
          Kind{"disk full", {Disaster::kFail, 0, ENOSPC}, 8}, Kind{"disk read-only", {Disaster::kFail, 0, EROFS}, 8}}) {
      CS_TRY(const Score s, suffer_all(*j, kind, *context.progress));
      if (kind.doom.disaster != Disaster::kFail) kills += s.disasters;
      bad += s.lost_sessions + s.lost_photos + s.wrong_photos + s.unlike + s.unsaid;
      study.rows.push_back({j->name, kind.name, fmt::format("{}", j->calls.size()), fmt::format("{}", s.disasters),
                            fmt::format("{}", s.lost_sessions), fmt::format("{}", s.lost_photos),
                            fmt::format("{}", s.wrong_photos), fmt::format("{}", s.unlike),
                            fmt::format("{}", s.unsaid)});
      context.progress->note(fmt::format("{}", fmt::join(study.rows.back(), " | ")));
      if (!s.first.empty()) study.notes.push_back(s.first), context.progress->note(s.first);
    }
  study.notes.push_back(
      "a call is one that creates, writes, syncs, renames or removes below the output's folder; a write is also cut in "
      "the middle; a disk that is full or read-only stays so until the command ends");
  study.notes.push_back(
      "of files that hold how long something took (provenance, report, numbers) only that they are there is compared");
  study.figure = fmt::format("{} kills at distinct moments, {} things lost, wrong, unlike or unsaid", kills, bad);
  study.bound = ">= 1000, 0";
  study.ok = kills >= 1000 && bad == 0;
  return study;
}

}  // namespace countershade::bench
