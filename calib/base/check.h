// A broken contract between two pieces of our own code. Only main catches a Bug; the exit code is then 70.
#pragma once

#include <stdexcept>
#include <string>

namespace countershade {

class Bug : public std::logic_error {
 public:
  using std::logic_error::logic_error;
};

[[noreturn]] inline void throw_bug(const char* file, int line, const char* condition, const std::string& message) {
  throw Bug(std::string(file) + ":" + std::to_string(line) + ": " + condition + ": " + message);
}

}  // namespace countershade

// Throws a Bug unless `condition` holds; `message` is anything that converts to std::string.
#define CS_CHECK(condition, message)                                                      \
  do {                                                                                    \
    if (!(condition)) ::countershade::throw_bug(__FILE__, __LINE__, #condition, message); \
  } while (false)
