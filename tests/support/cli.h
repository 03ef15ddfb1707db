// Runs the built command and looks at what it leaves behind.
#pragma once

#include <filesystem>
#include <string>

namespace countershade::testing {

struct CommandResult {
  int exit_code = -1;
  std::string out, err;
};

// build/countershade with these arguments (a shell line).
CommandResult run_countershade(const std::string& arguments);

// A folder of this test's own, empty; removed at the end of the scope.
class TemporaryFolder {
 public:
  TemporaryFolder();
  ~TemporaryFolder();
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;
  const std::filesystem::path& path() const { return path_; }
  std::filesystem::path operator/(const std::string& name) const { return path_ / name; }

 private:
  std::filesystem::path path_;
};

}  // namespace countershade::testing
