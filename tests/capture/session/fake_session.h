// Captures of the fake room, as the tests of the session runner do them.
#pragma once

#include <gtest/gtest.h>

#include "capture/session/runner.h"
#include "capture/session/session_folder.h"
#include "tests/capture/fake_room.h"

namespace countershade::capture::fake {

inline const CaptureOptions kQuick{.retakes = 3, .retake_wait_ms = 0};

struct Listener final : Progress {
  std::vector<std::pair<double, double>> steps;
  std::string said;
  void step(std::string_view, double done, double total) override { steps.emplace_back(done, total); }
  void note(std::string_view text) override { said += std::string(text) + "\n"; }
  void warn(std::string_view text) override { said += std::string(text) + "\n"; }
};

inline Result<void> run(const std::shared_ptr<Room>& room, const std::filesystem::path& folder, const Rig& rig,
                        Progress& progress, const Sequence& sequence = fake::sequence()) {
  const Devices devices = fake::devices(room, rig);
  return capture_session(rig, "", sequence, devices, folder, kQuick, progress);
}

inline Result<void> run(const std::shared_ptr<Room>& room, const std::filesystem::path& folder,
                        const Rig& rig = fake::rig()) {
  SilentProgress silent;
  return run(room, folder, rig, silent);
}

inline Result<void> run_short(const std::shared_ptr<Room>& room, const std::filesystem::path& folder) {
  SilentProgress silent;
  return run(room, folder, fake::rig(2), silent, short_sequence());
}

inline std::map<std::string, std::string> undisturbed(const std::filesystem::path& folder) {
  const auto done = run(std::make_shared<Room>(), folder);
  EXPECT_TRUE(done) << done.error().message;
  return tree(folder);
}

inline std::filesystem::path photo(const std::filesystem::path& session, int index) {
  return session / "photos/cam" / photo_name(index, "", ".tif");
}

inline std::size_t photos_in(const std::filesystem::path& session) {
  std::size_t count = 0;
  for (const auto& [name, bytes] : tree(session)) count += name.ends_with(".tif");
  return count;
}

// Triggers: two to settle, seven times two until black and white are seen, then one a frame.
inline constexpr int kFirst = 16;
// And at the end for each projector its first bright frame, and its first stripes on both axes.
inline constexpr int kLast = 6;

}  // namespace countershade::capture::fake
