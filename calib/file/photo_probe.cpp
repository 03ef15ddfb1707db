#include "calib/file/photo_probe.h"

#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfFrameBuffer.h>
#include <OpenEXR/ImfHeader.h>
#include <OpenEXR/ImfInputFile.h>

#include <algorithm>
#include <fstream>
#include <map>
#include <vector>

namespace countershade {

namespace fs = std::filesystem;

namespace {

using Shape = std::optional<PhotoShape>;

Error unusable(const fs::path& path, const std::string& why) {
  return error(ErrorCode::kBadFile, "'{}' {}; restore the file or take the photo again", path.string(), why);
}

// Numbers of a file in either byte order. Reading past the end gives 0 and clears ok().
class Bytes {
 public:
  explicit Bytes(const fs::path& path) : stream_(path, std::ios::binary) {
    stream_.seekg(0, std::ios::end);
    size_ = stream_ ? static_cast<std::uint64_t>(stream_.tellg()) : 0;
  }
  std::uint64_t size() const { return size_; }
  bool ok() const { return static_cast<bool>(stream_); }
  void set_big_endian(bool big) { big_ = big; }
  std::string text(std::uint64_t at, int count) {
    std::string bytes(count, '\0');
    stream_.seekg(static_cast<std::streamoff>(at));
    stream_.read(bytes.data(), count);
    return bytes;
  }
  std::uint32_t number(std::uint64_t at, int count) {
    const std::string bytes = text(at, count);
    std::uint32_t n = 0;
    for (int i = 0; i < count; ++i)
      n |= static_cast<std::uint32_t>(static_cast<unsigned char>(bytes[i])) << 8 * (big_ ? count - 1 - i : i);
    return ok() ? n : 0;
  }

 private:
  std::ifstream stream_;
  std::uint64_t size_ = 0;
  bool big_ = false;
};

Result<Shape> probe_png(const fs::path& path, Bytes& file) {
  if (file.text(0, 8) != "\x89PNG\r\n\x1a\n" || file.text(12, 4) != "IHDR") return unusable(path, "is no PNG file");
  file.set_big_endian(true);
  const int colour = static_cast<int>(file.number(25, 1));
  const PhotoShape shape{static_cast<int>(file.number(16, 4)), static_cast<int>(file.number(20, 4)),
                         colour == 0 ? 1 : 3};
  if (!file.ok() || file.text(file.size() - 8, 4) != "IEND") return unusable(path, "is truncated");
  return Shape(shape);
}

// The short and long integers of the first directory of a TIFF 6.0 file, by tag. Not ok() if any value lies outside.
std::map<int, std::vector<std::uint32_t>> tiff_tags(Bytes& file) {
  constexpr int kSizes[] = {0, 1, 1, 2, 4, 8, 1, 1, 2, 4, 8, 4, 8};  // of the types 0 to 12
  std::map<int, std::vector<std::uint32_t>> tags;
  const std::uint64_t directory = file.number(4, 4);
  const int entries = static_cast<int>(file.number(directory, 2));
  for (int i = 0; i < entries && file.ok(); ++i) {
    const std::uint64_t entry = directory + 2 + 12ull * i;
    const std::uint32_t type = file.number(entry + 2, 2);
    const int size = type <= 12 ? kSizes[type] : 0;
    const std::uint64_t bytes = std::uint64_t{file.number(entry + 4, 4)} * size;
    const std::uint64_t at = bytes <= 4 ? entry + 8 : file.number(entry + 8, 4);
    if (bytes > 0) file.number(at + bytes - 1, 1);  // is it there?
    if (!file.ok() || (type != 3 && type != 4)) continue;
    auto& values = tags[static_cast<int>(file.number(entry, 2))];
    for (std::uint64_t k = 0; k < bytes; k += size) values.push_back(file.number(at + k, size));
  }
  file.number(directory + 2 + 12ull * entries, 4);  // where the next directory would be
  return tags;
}

Result<Shape> probe_tiff(const fs::path& path, Bytes& file) {
  const std::string order = file.text(0, 2);
  file.set_big_endian(order == "MM");
  if ((order != "MM" && order != "II") || !file.ok()) return unusable(path, "is no TIFF file");
  if (file.number(2, 2) == 43) return Shape();  // BigTIFF
  auto tags = tiff_tags(file);
  if (!file.ok()) return unusable(path, "is truncated");
  constexpr int kWidth = 256, kHeight = 257, kChannels = 277;
  if (tags[kWidth].size() != 1 || tags[kHeight].size() != 1) return unusable(path, "is no TIFF file");
  for (const auto& [offsets, counts] : {std::pair(273, 279), std::pair(324, 325)})  // strips, tiles
    for (std::size_t i = 0; i < std::min(tags[offsets].size(), tags[counts].size()); ++i)
      if (std::uint64_t{tags[offsets][i]} + tags[counts][i] > file.size()) return unusable(path, "is truncated");
  const bool grey = tags[kChannels].empty() || tags[kChannels][0] == 1;
  return Shape({static_cast<int>(tags[kWidth][0]), static_cast<int>(tags[kHeight][0]), grey ? 1 : 3});
}

// Decodes the first and the last row of one channel: one of them ends the file. Throws if they are not there.
void read_outer_rows(Imf::InputFile& file) {
  const auto window = file.header().dataWindow();
  const auto first = file.header().channels().begin();
  if (first == file.header().channels().end() || first.channel().xSampling != 1 || first.channel().ySampling != 1)
    return;
  std::vector<float> row(window.max.x - window.min.x + 1);
  Imf::FrameBuffer rows;  // all rows lie on one another
  rows.insert(first.name(),
              Imf::Slice(Imf::FLOAT, reinterpret_cast<char*>(row.data() - window.min.x), sizeof(float), 0));
  file.setFrameBuffer(rows);
  file.readPixels(window.min.y);
  file.readPixels(window.max.y);
}

Result<Shape> probe_exr(const fs::path& path) {
  try {
    Imf::InputFile file(path.c_str());
    if (!file.isComplete()) return unusable(path, "is truncated");
    read_outer_rows(file);
    const auto window = file.header().dataWindow();
    const Imf::ChannelList& channels = file.header().channels();
    const bool rgb = channels.findChannel("R") && channels.findChannel("G") && channels.findChannel("B");
    return Shape({window.max.x - window.min.x + 1, window.max.y - window.min.y + 1, rgb ? 3 : 1});
  } catch (const std::exception&) {
    return unusable(path, "is truncated or no EXR file");
  }
}

}  // namespace

Result<std::optional<PhotoShape>> probe_photo(const fs::path& path) {
  std::string type = path.extension().string();
  std::transform(type.begin(), type.end(), type.begin(), [](unsigned char c) { return std::tolower(c); });
  if (type == ".exr") return probe_exr(path);
  Bytes file(path);
  if (!file.ok() || file.size() < 8) return unusable(path, "is empty or cannot be read");
  if (type == ".png") return probe_png(path, file);
  if (type == ".tif" || type == ".tiff") return probe_tiff(path, file);
  return Shape();
}

}  // namespace countershade
