#include "tools/countershade/console.h"

#include <malloc.h>

#include <fmt/format.h>
#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/spdlog.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>

namespace countershade::tools {

namespace {

using nlohmann::json;

constexpr int kBarWidth = 28;
constexpr std::chrono::milliseconds kRedraw(80);
constexpr const char* kClearLine = "\r\033[K";
constexpr double kShareForEta = 0.02;  // before that an estimate says nothing

void print(const std::string& text) {
  std::fputs(text.c_str(), stderr);
  std::fflush(stderr);
}

// Text may come from file names: bytes that are not UTF-8 are replaced.
void print(const json& event) {
  print(event.dump(-1, ' ', false, json::error_handler_t::replace) + "\n");
}

double eta_of(double share, double elapsed) {
  return share > kShareForEta ? elapsed * (1 - share) / share : HUGE_VAL;
}

}  // namespace

ConsoleMode default_console_mode() {
  return isatty(STDERR_FILENO) ? ConsoleMode::kBar : ConsoleMode::kLines;
}

std::string duration_text(double seconds) {
  if (!std::isfinite(seconds)) return "?";
  seconds = std::max(0.0, seconds);
  if (seconds < 0.95) return fmt::format("{:.1f} s", seconds);
  const long whole = std::lround(seconds);
  if (whole < 60) return fmt::format("{} s", whole);
  if (whole < 3600) return fmt::format("{} min {:02} s", whole / 60, whole % 60);
  return fmt::format("{} h {:02} min", whole / 3600, whole % 3600 / 60);
}

ConsoleProgress::ConsoleProgress(ConsoleMode mode)
    : mode_(mode),
      logger_(
          std::make_unique<spdlog::logger>("countershade", std::make_shared<spdlog::sinks::stderr_color_sink_mt>())) {
  logger_->set_pattern("%^%l%$: %v");
  logger_->flush_on(spdlog::level::trace);
}

ConsoleProgress::~ConsoleProgress() {
  finish();
}

void ConsoleProgress::step(std::string_view stage, double done, double total) {
  const std::lock_guard lock(mutex_);
  const auto now = Clock::now();
  const double share = total > 0 ? std::clamp(done / total, 0.0, 1.0) : 1.0;
  if (share >= 1 && stage == ended_) return;
  if (stage != stage_ || done == 0) begin(stage, now);
  const double elapsed = std::chrono::duration<double>(now - start_).count();
  if (mode_ == ConsoleMode::kJson) print_json(done, total, share, elapsed);
  if (mode_ == ConsoleMode::kLines) print_line(share, elapsed);
  if (mode_ == ConsoleMode::kBar) draw(share, elapsed, now);
  if (share < 1) return;
  end(now);
  ended_ = stage;
}

void ConsoleProgress::begin(std::string_view stage, Clock::time_point now) {
  end(now);
  stage_ = stage;
  ended_.clear();
  start_ = now;
  drawn_ = {};
  printed_ = -1;
}

void ConsoleProgress::end(Clock::time_point now) {
  if (drawing_) print(std::string("\n"));
  drawing_ = false;
  if (stage_.empty()) return;
  const auto known = std::find_if(times_.begin(), times_.end(), [&](const StageTime& t) { return t.stage == stage_; });
  StageTime& time = known == times_.end() ? times_.emplace_back(StageTime{stage_, 0}) : *known;
  time.seconds += std::chrono::duration<double>(now - start_).count();
  stage_.clear();
}

void ConsoleProgress::print_json(double done, double total, double share, double elapsed) {
  const int percent = static_cast<int>(share * 100);
  if (percent == printed_) return;
  printed_ = percent;
  const double eta = eta_of(share, elapsed);
  print(json{{"event", "step"},
             {"stage", stage_},
             {"done", done},
             {"total", total},
             {"seconds", elapsed},
             {"eta_seconds", std::isfinite(eta) ? json(eta) : json(nullptr)}});
}

void ConsoleProgress::print_line(double share, double elapsed) {
  const int tenths = static_cast<int>(share * 10);
  if (tenths == printed_) return;
  printed_ = tenths;
  std::string time;
  if (share >= 1)
    time = duration_text(elapsed);
  else if (share > kShareForEta)
    time = duration_text(elapsed) + ", ETA " + duration_text(eta_of(share, elapsed));
  print(fmt::format("{:<24} {:3.0f} %  {}\n", stage_, 100 * share, time));
}

void ConsoleProgress::draw(double share, double elapsed, Clock::time_point now) {
  if (share < 1 && now - drawn_ < kRedraw) return;
  drawn_ = now;
  drawing_ = true;
  const int filled = static_cast<int>(share * kBarWidth);
  const double eta = eta_of(share, elapsed);
  print(fmt::format("{}{:<24} [{}{}] {:3.0f} %  {}{}", kClearLine, stage_, std::string(filled, '#'),
                    std::string(kBarWidth - filled, '.'), 100 * share, duration_text(elapsed),
                    share < 1 && std::isfinite(eta) ? ", ETA " + duration_text(eta) : ""));
}

void ConsoleProgress::finish() {
  const std::lock_guard lock(mutex_);
  end(Clock::now());
}

void ConsoleProgress::say(bool warning, std::string_view text) {
  const std::lock_guard lock(mutex_);
  (warning ? warnings_ : notes_).emplace_back(text);
  if (mode_ == ConsoleMode::kJson) return print(json{{"event", warning ? "warning" : "note"}, {"text", text}});
  // The bar gives way to the sentence and is drawn again by the next step.
  if (drawing_) print(std::string(kClearLine));
  drawing_ = false;
  drawn_ = {};
  logger_->log(warning ? spdlog::level::warn : spdlog::level::info, "{}", text);
}

void ConsoleProgress::note(std::string_view text) {
  say(false, text);
}
void ConsoleProgress::warn(std::string_view text) {
  say(true, text);
}

std::vector<std::string> ConsoleProgress::notes() const {
  const std::lock_guard lock(mutex_);
  return notes_;
}

std::vector<std::string> ConsoleProgress::warnings() const {
  const std::lock_guard lock(mutex_);
  return warnings_;
}

std::vector<StageTime> ConsoleProgress::stage_times() const {
  const std::lock_guard lock(mutex_);
  return times_;
}

void keep_memory() {
  mallopt(M_MMAP_MAX, 0);
  mallopt(M_TRIM_THRESHOLD, 1 << 30);
}

}  // namespace countershade::tools
