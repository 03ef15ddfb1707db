// How long work speaks to whoever runs it. Libraries never print: they call a Progress, the tools draw it.
#pragma once

#include <string_view>

namespace countershade {

class Progress {
 public:
  virtual ~Progress() = default;
  // `done` of `total` steps of `stage` are finished; the first call of a stage has done = 0, the last done = total.
  virtual void step(std::string_view stage, double done, double total) = 0;
  // A sentence the operator should read, now and in the log.
  virtual void note(std::string_view text) = 0;
  virtual void warn(std::string_view text) = 0;
};

// For callers that do not listen.
class SilentProgress final : public Progress {
 public:
  void step(std::string_view, double, double) override {}
  void note(std::string_view) override {}
  void warn(std::string_view) override {}
};

}  // namespace countershade
