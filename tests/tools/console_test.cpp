#include "tools/countershade/console.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <sstream>
#include <thread>

namespace countershade::tools {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

// What `work` writes to stderr.
template <class Work>
std::string stderr_of(Work&& work) {
  ::testing::internal::CaptureStderr();
  work();
  return ::testing::internal::GetCapturedStderr();
}

std::vector<std::string> lines_of(const std::string& text) {
  std::vector<std::string> lines;
  std::istringstream stream(text);
  for (std::string line; std::getline(stream, line);) lines.push_back(line);
  return lines;
}

TEST(Console, LinesModePrintsStartEndAndTenths) {
  const std::string text = stderr_of([] {
    ConsoleProgress progress(ConsoleMode::kLines);
    for (int i = 0; i <= 1000; ++i) progress.step("decode", i, 1000);
  });
  const std::vector<std::string> lines = lines_of(text);
  ASSERT_EQ(lines.size(), 11u);
  EXPECT_THAT(lines.front(), HasSubstr("decode"));
  EXPECT_THAT(lines.front(), HasSubstr("  0 %"));
  EXPECT_THAT(lines.back(), HasSubstr("100 %"));
  EXPECT_EQ(text.find('\r'), std::string::npos);
}

TEST(Console, EveryJsonLineIsOneObject) {
  const std::string text = stderr_of([] {
    ConsoleProgress progress(ConsoleMode::kJson);
    for (int i = 0; i <= 5000; ++i) progress.step("fit", i, 5000);
    progress.note("a \"quoted\"\nnote");
    progress.warn("bytes \xff that are no text");
  });
  int steps = 0, notes = 0, warnings = 0;
  double last = -1;
  for (const std::string& line : lines_of(text)) {
    const auto event = nlohmann::json::parse(line);
    if (event["event"] == "note") ++notes;
    if (event["event"] == "warning") ++warnings;
    if (event["event"] != "step") continue;
    ++steps;
    EXPECT_EQ(event["stage"], "fit");
    EXPECT_GT(event["done"].get<double>(), last);
    last = event["done"];
  }
  EXPECT_EQ(steps, 101);  // once per percent
  EXPECT_EQ(last, 5000);
  EXPECT_EQ(notes, 1);
  EXPECT_EQ(warnings, 1);
}

TEST(Console, BarEndsWithOneLineAndNotesDoNotTearIt) {
  const std::string text = stderr_of([] {
    ConsoleProgress progress(ConsoleMode::kBar);
    progress.step("capture", 0, 4);
    progress.note("the lamp is on");
    progress.step("capture", 2, 4);
    progress.step("capture", 4, 4);
  });
  EXPECT_THAT(text, HasSubstr("info: the lamp is on\n"));
  EXPECT_THAT(text, HasSubstr("\r\033[Kinfo"));  // the bar is erased before the sentence
  EXPECT_THAT(text, HasSubstr("[##############..............]  50 %"));
  EXPECT_EQ(text.back(), '\n');
  EXPECT_THAT(lines_of(text).back(), HasSubstr("100 %"));
}

TEST(Console, RemembersWhatWasSaidAndHowLongItTook) {
  const std::string text = stderr_of([] {
    ConsoleProgress progress(ConsoleMode::kLines);
    progress.note("first");
    progress.warn("second");
    progress.note("third");
    for (const char* stage : {"show", "fit", "show"}) {
      progress.step(stage, 0, 1);
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
      progress.step(stage, 1, 1);
    }
    progress.step("unfinished", 0, 3);
    progress.finish();
    EXPECT_THAT(progress.notes(), ElementsAre("first", "third"));
    EXPECT_THAT(progress.warnings(), ElementsAre("second"));
    const std::vector<StageTime> times = progress.stage_times();
    ASSERT_EQ(times.size(), 3u);
    EXPECT_EQ(times[0].stage, "show");
    EXPECT_EQ(times[1].stage, "fit");
    EXPECT_EQ(times[2].stage, "unfinished");
    EXPECT_GE(times[0].seconds, 0.04);  // two sleeps of 20 ms, which never end early
    EXPECT_GE(times[1].seconds, 0.02);
  });
  EXPECT_THAT(text, HasSubstr("warning: second"));
}

TEST(Console, CompletionSaidTwiceIsPrintedOnce) {
  const std::string text = stderr_of([] {
    ConsoleProgress progress(ConsoleMode::kLines);
    progress.step("views", 0, 2);
    progress.step("views", 2, 2);
    progress.step("views", 1, 1);
  });
  EXPECT_EQ(lines_of(text).size(), 2u);
}

TEST(Console, DurationsReadLikeAClock) {
  EXPECT_EQ(duration_text(0.42), "0.4 s");
  EXPECT_EQ(duration_text(0.96), "1 s");
  EXPECT_EQ(duration_text(12.4), "12 s");
  EXPECT_EQ(duration_text(59.6), "1 min 00 s");
  EXPECT_EQ(duration_text(185), "3 min 05 s");
  EXPECT_EQ(duration_text(7620), "2 h 07 min");
  EXPECT_EQ(duration_text(HUGE_VAL), "?");
  EXPECT_EQ(duration_text(-3), "0.0 s");
}

}  // namespace
}  // namespace countershade::tools
