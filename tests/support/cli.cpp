#include "tests/support/cli.h"

#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdlib>
#include <fstream>
#include <sstream>

namespace countershade::testing {

namespace {

std::string text_of(const std::filesystem::path& path) {
  std::ifstream stream(path);
  std::stringstream text;
  text << stream.rdbuf();
  return text.str();
}

}  // namespace

TemporaryFolder::TemporaryFolder() {
  const auto* test = ::testing::UnitTest::GetInstance()->current_test_info();
  path_ = std::filesystem::temp_directory_path() / ("countershade-" + std::string(test->test_suite_name()) + "-" +
                                                    test->name() + "-" + std::to_string(getpid()));
  std::filesystem::remove_all(path_);
  std::filesystem::create_directories(path_);
}

TemporaryFolder::~TemporaryFolder() {
  std::error_code ignored;
  std::filesystem::remove_all(path_, ignored);
}

CommandResult run_countershade(const std::string& arguments) {
  static int calls = 0;
  const std::filesystem::path base = std::filesystem::temp_directory_path() /
                                     ("countershade-cli-" + std::to_string(getpid()) + "-" + std::to_string(calls++));
  const std::string out = base.string() + ".out", err = base.string() + ".err";
  const std::string line =
      std::string(COUNTERSHADE_BINARY_DIR) + "/countershade " + arguments + " >" + out + " 2>" + err;
  const int status = std::system(line.c_str());
  CommandResult result{WIFEXITED(status) ? WEXITSTATUS(status) : -1, text_of(out), text_of(err)};
  std::filesystem::remove(out);
  std::filesystem::remove(err);
  return result;
}

}  // namespace countershade::testing
