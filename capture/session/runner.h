// The session runner: shows, photographs, stores; killed at any moment it resumes and loses nothing.
#pragma once

#include <functional>

#include "calib/base/progress.h"
#include "capture/device/device.h"
#include "capture/pattern/pattern.h"

namespace countershade::capture {

struct CaptureOptions {
  int retakes = 3;      // tries at a frame that looks stale before giving up; also the longest latency, in shows,
                        // that the start of a capture waits out
  bool extend = false;  // the sequence of a session that stands there may be the beginning of this one
  // Called with the index of each frame whose photos stand in the session, from former captures too; again when others
  // have taken their place.
  std::function<void(int frame)> stored = nullptr;
  double retake_wait_ms = 20;  // n-th retake: shown again, then this long times n before the exposure
};

// Captures `sequence` into `folder` (calib/file/session.h). Each photo is written and synced before the next is shown.
// A folder that already holds a session of the same rig and sequence is resumed: stored photos are checked and kept,
// one reference frame is photographed again and compared, and a camera that moved is an error (kRefused). A photo that
// still shows the former frame (its change against the former photo contradicts the pattern) is retaken. rig_toml and
// simulation_toml are the texts to store (simulation_toml may be empty). A Gray code frame and its inverse must add up
// to white + black (light adds); a pair that does not is retaken, both. Errors: kExists (another rig or sequence stands
// there), kDevice, kIo, kBadValue (sequence and rig disagree), kRefused (the camera moved, or another process is
// writing this session).
Result<void> capture_session(const Rig& rig, const std::string& simulation_toml, const Sequence& sequence,
                             const Devices& devices, const std::filesystem::path& folder, const CaptureOptions& options,
                             Progress& progress);

// A session from photos taken elsewhere (CONTRACT `import`): photos/NNNN.* or photos/<camera>/NNNN.*. All photos are
// checked before anything is written; the folder appears whole. Errors: kBadFile for missing, truncated, wrong-sized
// ones, naming the file; kRefused for photos that are black, saturated or in another order than the frames; kExists;
// kBadValue.
Result<void> import_session(const Rig& rig, const Sequence& sequence, const std::filesystem::path& photos,
                            const std::filesystem::path& folder, Progress& progress);

}  // namespace countershade::capture
