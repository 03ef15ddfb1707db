// What the head of a photo's file says, so that a session of hundreds of photos is checked without decoding them.
#pragma once

#include <filesystem>
#include <optional>

#include "calib/base/result.h"

namespace countershade {

struct PhotoShape {
  int width = 0, height = 0;
  int channels = 0;  // as read_image gives them: 1 or 3
  bool operator==(const PhotoShape&) const = default;
};

// Nothing where the format (other than PNG, TIFF, EXR) does not tell cheaply. Error: kBadFile for a file that is
// truncated or not what its extension says.
Result<std::optional<PhotoShape>> probe_photo(const std::filesystem::path& path);

}  // namespace countershade
