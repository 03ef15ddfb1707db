// Stages that points of both kinds share, and the ear for what the program says there.
#pragma once

#include <filesystem>
#include <string>

#include "tools/bench/sweep/sweep.h"

namespace countershade::bench {

// Keeps the first sentence that the program addresses to its operator.
class Listener final : public Progress {
 public:
  void step(std::string_view, double, double) override {}
  void note(std::string_view text) override { say(text); }
  void warn(std::string_view text) override { say(text); }
  const std::string& first() const { return first_; }

 private:
  void say(std::string_view text) {
    if (first_.empty()) first_ = text;
  }
  std::string first_;
};

// What `check` complains about before anything is captured, into point.check.
void check_rig(const SweepSetting& setting, const std::shared_ptr<const simdata::Simulator>& simulator,
               SweepPoint& point);

// The job of one point that is judged by decoding: check, capture with the code that the scene chooses, and what
// calibrate does without a lens, which is to decode, to look for the cause of bad photos, and to ask the held-out
// patterns. Scratch files under `folder`. Errors: those of the harness; what the program refuses stands in the point.
Result<void> run_decoding(const SweepSetting& setting, const std::shared_ptr<const simdata::Simulator>& simulator,
                          const std::filesystem::path& folder, SweepPoint& point);

}  // namespace countershade::bench
