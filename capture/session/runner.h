// The session runner: shows, photographs, stores; killed at any moment it resumes and loses nothing.
#pragma once

#include <functional>

#include "calib/base/progress.h"
#include "calib/file/file.h"
#include "capture/device/device.h"
#include "capture/pattern/pattern.h"

namespace countershade::capture {

// How late pictures appear.
struct Lateness {
  int shows = 0;       // how often a picture is shown before its photo; 0 = not known
  double wait_ms = 0;  // between handing it over and the photo
};

struct CaptureOptions {
  int retakes = 3;      // tries at a frame that looks stale before giving up; also how many shows a display may hold
                        // back
  bool extend = false;  // the sequence of a session that stands there may be the beginning of this one
  // Called with the index of each frame whose photos stand in the session, from former captures too; again when others
  // have taken their place.
  std::function<void(int frame)> stored = nullptr;
  // Called when all photos have been set aside, before they are taken again.
  std::function<void()> set_aside = nullptr;
  // Known, since this run has captured the session's beginning: not measured again, and what stands there is taken
  // again where the view has changed since. And what is known at the end.
  Lateness* lateness = nullptr;
  double retake_wait_ms = 20;  // n-th retake: shown again, then this long times n more before the exposure; a picture
                               // is settled after twelve times this long
};

// Captures `sequence` into `folder` (calib/file/session.h). Each photo is written and synced before the next is shown.
// A folder that already holds a session of the same rig and sequence is resumed: stored photos are checked and kept,
// one reference frame is photographed again and compared, and a camera that moved is an error (kRefused).
//
// Before the first photo black and white are shown in turns, and photographed until they are seen: how long that takes
// by the camera's clock (a swap inside an exposure is told by its share of the change), at most, and a refresh of the
// display more, is waited between every picture and its photo; nothing where it takes no time. The next picture is
// shown before a photo is stored. A photo that still shows the former frame (its change against the former photo
// contradicts the pattern) is retaken. A Gray code frame and its inverse must add up to white + black (light adds); a
// pair that does not is retaken, both. After the last one the first bright frame and the first stripes of each
// projector are photographed again: where one shows something else, or the same elsewhere (view_shift.h), all photos
// are moved to `folder`/outdated, and taken again, once. A view that goes on shifting, by 1 px at most, is warned of
// then; another one is refused.
//
// A camera that failed, or that had to be asked again and again (Camera::health), is marked in `folder`/unhealthy.json
// until a capture ends with all cameras well; what is stored stands.
//
// rig_toml and simulation_toml are the texts to store (simulation_toml may be empty). Errors: kExists (another rig or
// sequence stands there), kDevice, kIo, kBadValue (sequence and rig disagree), kRefused (the camera moved, or another
// process is writing this session).
Result<void> capture_session(const Rig& rig, const std::string& simulation_toml, const Sequence& sequence,
                             const Devices& devices, const std::filesystem::path& folder, const CaptureOptions& options,
                             Progress& progress);

// A session from photos taken elsewhere (CONTRACT `import`): photos/NNNN.* or photos/<camera>/NNNN.*. All photos are
// checked before anything is written; the folder appears whole. Errors: kBadFile for missing, truncated, wrong-sized
// ones, naming the file; kRefused for photos that are black, saturated or in another order than the frames; kExists;
// kBadValue.
Result<void> import_session(const Rig& rig, const Sequence& sequence, const std::filesystem::path& photos,
                            const std::filesystem::path& folder, Progress& progress, const FillFolder& record = {});

}  // namespace countershade::capture
