// Progress for people on a terminal, for logs, and for programs.
#pragma once

#include <chrono>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "calib/base/progress.h"

namespace spdlog {
class logger;
}

namespace countershade::tools {

enum class ConsoleMode { kBar, kLines, kJson };

// A bar where stderr is a terminal, else one line a step.
ConsoleMode default_console_mode();

struct StageTime {
  std::string stage;
  double seconds = 0;
};

// Writes to stderr. kBar redraws one line with share, elapsed time and ETA; kLines prints the start and end of a stage
// and every tenth between; kJson prints one object per line: {"event": "step", "stage", "done", "total", "seconds",
// "eta_seconds"} at most once per percent, {"event": "note" | "warning", "text"}. Remembers what was said and how long
// stages took, for reports and provenance. Calls may come from several threads.
class ConsoleProgress final : public Progress {
 public:
  explicit ConsoleProgress(ConsoleMode mode);
  ~ConsoleProgress() override;
  void step(std::string_view stage, double done, double total) override;
  void note(std::string_view text) override;
  void warn(std::string_view text) override;
  // Ends a bar that is being drawn, and the time of its stage.
  void finish();

  std::vector<std::string> notes() const;
  std::vector<std::string> warnings() const;
  // In order of first appearance; a stage that ran several times is there once, with the sum.
  std::vector<StageTime> stage_times() const;

 private:
  using Clock = std::chrono::steady_clock;
  void begin(std::string_view stage, Clock::time_point now);
  void end(Clock::time_point now);
  void draw(double share, double elapsed, Clock::time_point now);
  void print_line(double share, double elapsed);
  void print_json(double done, double total, double share, double elapsed);
  void say(bool warning, std::string_view text);

  const ConsoleMode mode_;
  std::unique_ptr<spdlog::logger> logger_;
  mutable std::mutex mutex_;
  std::string stage_;  // empty: none runs
  std::string ended_;  // the last one that reached its total: saying so again changes nothing
  Clock::time_point start_, drawn_;
  int printed_ = -1;  // tenths or percent of the stage that were printed last
  bool drawing_ = false;
  std::vector<std::string> notes_, warnings_;
  std::vector<StageTime> times_;
};

// "0.4 s", "12 s", "3 min 05 s", "2 h 07 min"; "?" where it is not finite.
std::string duration_text(double seconds);

// Keeps freed memory in the process: photos come and go by the hundred, and fresh pages for one cost as much as its
// arithmetic. Call it first in main().
void keep_memory();

}  // namespace countershade::tools
