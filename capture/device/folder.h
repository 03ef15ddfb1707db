// Devices that are folders: photos that someone else's program puts there, and pictures for someone else's player.
#pragma once

#include <filesystem>

#include "capture/device/device.h"

namespace countershade::capture {

struct FolderCameraOptions {
  double timeout_s = 30;  // how long one exposure waits for its photo
  double poll_s = 0.02;
  double exposure_ms = 0;  // what to report; 0 = unknown
};

// A camera that gives the photos NNNN.png|tif|exr of a folder, one per trigger, in order without gaps, starting with
// the lowest number that is there at the first trigger. A photo that is still being written is waited for. Errors:
// kBadFile when the folder does not exist; trigger(): kDevice when no photo came in time (names it).
Result<std::unique_ptr<Camera>> open_folder_camera(const std::string& id, const std::filesystem::path& folder,
                                                   const FolderCameraOptions& options = {});

// A projector that writes each shown picture as 8-bit NNNN.png, after the highest number that is there already.
// The folder is created. Error: kIo.
Result<std::unique_ptr<Projector>> open_folder_projector(const std::string& id, int width, int height,
                                                         const std::filesystem::path& folder);

}  // namespace countershade::capture
