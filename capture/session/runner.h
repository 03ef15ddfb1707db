// The session runner: shows, photographs, stores; killed at any moment it resumes and loses nothing.
#pragma once

#include "calib/base/progress.h"
#include "capture/device/device.h"
#include "capture/pattern/pattern.h"

namespace countershade::capture {

struct CaptureOptions {
  int retakes = 3;           // tries at a frame that looks stale before giving up
};

// Captures `sequence` into `folder` (calib/file/session.h). Each photo is written and synced before the next is shown.
// A folder that already holds a session of the same rig and sequence is resumed: stored photos are checked and kept, one
// reference frame is photographed again and compared, and a camera that moved is an error (kRefused).
// A photo that still shows the former frame (its change against the former photo contradicts the pattern) is retaken.
// rig_toml and simulation_toml are the texts to store (simulation_toml may be empty).
// Errors: kExists (another rig or sequence stands there), kDevice, kIo, kRefused.
Result<void> capture_session(const Rig& rig, const std::string& simulation_toml, const Sequence& sequence,
                             const Devices& devices, const std::filesystem::path& folder,
                             const CaptureOptions& options, Progress& progress);

// A session from photos taken elsewhere (CONTRACT `import`): photos/NNNN.* or photos/<camera>/NNNN.*. All photos are
// checked before anything is written. Errors: kBadFile for missing, truncated, wrong-sized ones, naming the file.
Result<void> import_session(const Rig& rig, const Sequence& sequence, const std::filesystem::path& photos,
                            const std::filesystem::path& folder, Progress& progress);

}  // namespace countershade::capture
