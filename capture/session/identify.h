// Which photo shows which frame, where each picture says so itself (capture/pattern/identity.h).
#pragma once

#include <filesystem>
#include <vector>

#include "calib/base/progress.h"
#include "calib/file/session.h"

namespace countershade::capture {

struct Identified {
  std::vector<std::filesystem::path> photos;         // per frame of the sequence; empty: none shows it
  std::vector<std::vector<Eigen::Vector2d>> unused;  // where the camera sees the marks, with a margin [px]
  int marks = 0;                                     // that the camera sees
  int unread = 0;                                    // photos in which those of a projector could not be read
  int mixed = 0;                                     // photos that show two frames
};

// photos: of one camera, in the order in which they were taken; their names mean nothing. A photo shows a frame when
// a mark of every projector that the camera ever sees can be read, all that can agree on the frame, and none holds more
// than a tenth of another one's light. Of several such photos of a frame the one with the least is taken, and of those
// as good the middle one of the longest run. Errors: kBadFile for an unreadable photo; kRefused where no photo shows a
// mark.
Result<Identified> identify_photos(const Sequence& sequence, const std::vector<std::filesystem::path>& photos,
                                   const CameraSpec& camera, Progress& progress);

// By name, numbers in them by value: IMG_9 before IMG_10.
bool natural_less(const std::filesystem::path& a, const std::filesystem::path& b);

}  // namespace countershade::capture
