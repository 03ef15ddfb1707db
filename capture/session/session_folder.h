// The folder of a session while it is being written: who may write, what stands there, what photos are called.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "calib/base/result.h"
#include "calib/file/session.h"
#include "capture/device/device.h"

namespace countershade::capture {

// "8.0ms": the shortest decimal that reads back equal, with at least one digit after the point.
std::string exposure_text(double exposure_ms);
// "0007.tif", or "0007_8.0ms.tif" where `exposure` is not empty. `extension` with its point.
std::string photo_name(int index, const std::string& exposure, const std::string& extension);

// Holds the exclusive right to write a session, until destroyed or the process ends, however it ends.
class FolderLock {
 public:
  // Error: kRefused while another process holds it; kIo.
  static Result<FolderLock> take(const std::filesystem::path& folder);
  FolderLock(FolderLock&& other) noexcept;
  FolderLock& operator=(FolderLock&&) = delete;
  ~FolderLock();

 private:
  explicit FolderLock(int file) : file_(file) {}
  int file_ = -1;
};

// Makes sure that `folder` is a place for this session: creates it, or finds the same session there. Call before lock.
// Error: kExists when the folder holds something else than a session.
Result<void> claim_folder(const std::filesystem::path& folder);
// Writes the session's header, or compares it with the one that stands there. Call under the lock.
// extend: a sequence that is the beginning of this one is replaced by it. Error: kExists names the file that differs.
Result<void> write_or_compare_header(const std::filesystem::path& folder, const Rig& rig,
                                     const std::string& simulation_toml, const Sequence& sequence, bool extend);
// Whether `whole` begins with all frames of `part`.
bool begins_with(const Sequence& whole, const Sequence& part);
// Removes what a killed writer left unfinished in a folder of photos.
Result<void> remove_unfinished(const std::filesystem::path& folder);

// Writes which cameras are unhealthy, and why, into `folder`/unhealthy.json; removes it when all are well and have
// taken photos. Says nothing where it cannot: what went wrong before counts.
void mark_unhealthy(const std::filesystem::path& folder, const Devices& devices);
// What stands there, a line per camera; empty: nothing. Never fails.
std::vector<std::string> unhealthy_cameras(const std::filesystem::path& folder);

// Every projector of the sequence is in the rig, with the same resolution; there is a frame. Error: kBadValue.
Result<void> check_sequence(const Rig& rig, const Sequence& sequence);

}  // namespace countershade::capture
