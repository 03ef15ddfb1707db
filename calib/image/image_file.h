// Reading and writing pictures and photos. Every write is atomic: a temporary name, then a rename.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "calib/base/result.h"
#include "calib/image/image.h"

namespace countershade {

// What a file stores, before anyone interprets it. values: stored numbers (0..255, 0..65535, or linear floats), 1 or 3
// channels RGB. full_scale: the file type's maximum (255, 65535; 1 for float files). bits: 8, 16 or 32.
struct StoredImage {
  Image values;
  double full_scale = 1;
  int bits = 8;
};

// PNG, TIFF, EXR (and whatever else OpenCV reads). Errors: kBadFile for missing, truncated, unreadable.
Result<StoredImage> read_image(const std::filesystem::path& path);

// A projector's picture: 8 or 16 bits are widened to the full 16-bit range; grey becomes RGB; EXR is refused
// (kBadFile). Use read_image for linear EXR pictures.
Result<Picture> read_picture(const std::filesystem::path& path);

// bits: 8 (values / 257, rounded) or 16. PNG.
Result<void> write_picture(const std::filesystem::path& path, const Picture& picture, int bits);

// 16-bit file of stored numbers (rounded, clamped to 0..65535), 1 or 3 channels. The format follows the extension:
// .png (fast compression) or .tif (uncompressed); kBadValue for another.
Result<void> write_stored16(const std::filesystem::path& path, const Image& values);

// 8-bit RGB or grey PNG for looking at; values 0..255 are rounded and clamped.
Result<void> write_png8(const std::filesystem::path& path, const Image& values);

// Float32 EXR with named channels, all of one size, each (height, width, 1).
struct NamedChannel {
  std::string name;
  const Image* image;
};
Result<void> write_exr(const std::filesystem::path& path, const std::vector<NamedChannel>& channels);
// Reads the channels asked for, in that order. kBadFile names a missing one.
Result<std::vector<Image>> read_exr(const std::filesystem::path& path, const std::vector<std::string>& names);

}  // namespace countershade
