#include "calib/image/image_file.h"

#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfCompression.h>
#include <OpenEXR/ImfFrameBuffer.h>
#include <OpenEXR/ImfHeader.h>
#include <OpenEXR/ImfInputFile.h>
#include <OpenEXR/ImfOutputFile.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <fstream>
#include <opencv2/core/utils/logger.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "calib/base/parallel.h"
#include "calib/file/file.h"
#include "calib/file/photo_probe.h"

namespace countershade {

namespace {

namespace fs = std::filesystem;

Error unreadable(const fs::path& path, const std::string& why) {
  return error(ErrorCode::kBadFile, "'{}' {}; restore or retake the file", path.string(), why);
}

// Lower case, with the dot.
std::string extension(const fs::path& path) {
  std::string text = path.extension().string();
  std::transform(text.begin(), text.end(), text.begin(), [](unsigned char c) { return std::tolower(c); });
  return text;
}

// Libraries fill what a truncated JPEG lacks with grey; its end marker tells (a few bytes may follow it).
bool jpeg_is_whole(const fs::path& path) {
  std::ifstream stream(path, std::ios::binary | std::ios::ate);
  const std::streamoff size = stream.tellg(), length = std::min<std::streamoff>(size, 64);
  std::string tail(static_cast<std::size_t>(std::max<std::streamoff>(0, length)), '\0');
  stream.seekg(size - length);
  stream.read(tail.data(), length);
  return stream && tail.find("\xff\xd9") != std::string::npos;
}

// What OpenCV makes of a file; empty where it can make nothing of it. A library does not print: OpenCV's log is off.
cv::Mat decode_quietly(const fs::path& path) {
  cv::utils::logging::setLogLevel(cv::utils::logging::LOG_LEVEL_SILENT);
  try {
    cv::Mat image = cv::imread(path.string(), cv::IMREAD_UNCHANGED);
    if (image.channels() == 4) cv::cvtColor(image, image, cv::COLOR_BGRA2BGR);
    return image;
  } catch (const cv::Exception&) {
    return {};
  }
}

Result<StoredImage> read_exr_image(const fs::path& path) {
  std::vector<std::string> names;
  try {
    Imf::InputFile file(path.c_str());
    const Imf::ChannelList& channels = file.header().channels();
    if (channels.findChannel("R") && channels.findChannel("G") && channels.findChannel("B"))
      names = {"R", "G", "B"};
    else if (channels.findChannel("Y"))
      names = {"Y"};
    else if (channels.begin() != channels.end())
      names = {channels.begin().name()};
  } catch (const std::exception& e) {
    return unreadable(path, std::string("is no readable EXR file: ") + e.what());
  }
  if (names.empty()) return unreadable(path, "has no channel");
  CS_TRY(const std::vector<Image> planes, read_exr(path, names));
  const int count = static_cast<int>(planes.size());
  StoredImage stored{Image(planes[0].width(), planes[0].height(), count), 1, 32};
  for (std::size_t i = 0; i < planes[0].pixels(); ++i)
    for (int c = 0; c < count; ++c) stored.values.data()[i * count + c] = planes[c].data()[i];
  return stored;
}

// Encoded in memory, then written at once: a disk's own reason for a failure is the one that is given.
Result<void> write_with_opencv(const fs::path& path, const cv::Mat& image, const std::vector<int>& parameters) {
  std::vector<std::uint8_t> bytes;
  bool ok = false;
  try {
    ok = cv::imencode(extension(path), image, bytes, parameters);
  } catch (const cv::Exception&) {
  }
  if (!ok) return error(ErrorCode::kBadValue, "cannot write '{}': its name must end in .png or .tif", path.string());
  return write_atomically(path, std::string_view(reinterpret_cast<const char*>(bytes.data()), bytes.size()));
}

// Nearest whole number from 0 to maximum; 0 for a NaN. By instructions that work on many at once.
template <class T>
T rounded(float value, float maximum) {
  return static_cast<T>(static_cast<int>((value > 0 ? std::min(value, maximum) : 0.0f) + 0.5f));
}

// RGB floats, rounded and clamped, as an OpenCV picture (BGR).
template <class T>
cv::Mat to_opencv(const Image& values, int type1, int type3, float maximum) {
  CS_CHECK(values.channels() == 1 || values.channels() == 3, "1 or 3 channels");
  const int channels = values.channels();
  cv::Mat out(values.height(), values.width(), channels == 1 ? type1 : type3);
  parallel_for(values.height(), [&](int y) {
    T* row = out.ptr<T>(y);
    const float* from = values.row(y);
    const int width = values.width();
    if (channels == 1)
      for (int x = 0; x < width; ++x) row[x] = rounded<T>(from[x], maximum);
    else
      for (int x = 0; x < width; ++x)
        for (int c = 0; c < 3; ++c) row[3 * x + c] = rounded<T>(from[3 * x + 2 - c], maximum);
  });
  return out;
}

// An OpenCV picture (BGR) of these numbers as RGB floats.
template <class T>
void to_floats(const cv::Mat& image, Image& values) {
  parallel_for(image.rows, [&](int y) {
    const T* from = image.ptr<T>(y);
    float* to = values.row(y);
    const int width = values.width();
    if (values.channels() == 1)
      for (int x = 0; x < width; ++x) to[x] = static_cast<float>(from[x]);
    else
      for (int x = 0; x < width; ++x)
        for (int c = 0; c < 3; ++c) to[3 * x + c] = static_cast<float>(from[3 * x + 2 - c]);
  });
}

}  // namespace

Result<StoredImage> read_image(const fs::path& path) {
  if (!fs::is_regular_file(path)) return unreadable(path, "is missing");
  const std::string type = extension(path);
  if (type == ".exr") return read_exr_image(path);
  if (const auto probe = probe_photo(path); !probe) return probe.error();
  if ((type == ".jpg" || type == ".jpeg") && !jpeg_is_whole(path)) return unreadable(path, "is truncated");
  const cv::Mat image = decode_quietly(path);
  if (image.empty()) return unreadable(path, "is truncated or not an image");
  if (image.channels() != 1 && image.channels() != 3)
    return unreadable(path, fmt::format("has {} channels, expected 1 or 3", image.channels()));
  StoredImage stored;
  stored.full_scale = image.depth() == CV_8U ? 255 : image.depth() == CV_16U ? 65535 : 1;
  stored.bits = image.depth() == CV_8U ? 8 : image.depth() == CV_16U ? 16 : 32;
  stored.values = Image(image.cols, image.rows, image.channels());
  switch (image.depth()) {
    case CV_8U:
      to_floats<std::uint8_t>(image, stored.values);
      break;
    case CV_16U:
      to_floats<std::uint16_t>(image, stored.values);
      break;
    default: {
      cv::Mat floats;
      image.convertTo(floats, CV_32F);
      to_floats<float>(floats, stored.values);
    }
  }
  return stored;
}

Result<Picture> read_picture(const fs::path& path) {
  CS_TRY(const StoredImage stored, read_image(path));
  if (stored.bits == 32)
    return unreadable(path, "holds floats, not encoded values; give PNG or TIFF with 8 or 16 bits");
  Picture picture(stored.values.width(), stored.values.height(), 3);
  const int channels = stored.values.channels(), factor = stored.bits == 8 ? 257 : 1;
  for (std::size_t i = 0; i < picture.pixels(); ++i)
    for (int c = 0; c < 3; ++c)
      picture.data()[3 * i + c] =
          static_cast<std::uint16_t>(factor * stored.values.data()[i * channels + (channels == 3 ? c : 0)]);
  return picture;
}

Result<void> write_picture(const fs::path& path, const Picture& picture, int bits) {
  CS_CHECK(bits == 8 || bits == 16, "8 or 16 bits");
  cv::Mat out(picture.height(), picture.width(), bits == 8 ? CV_8UC3 : CV_16UC3);
  for (int y = 0; y < picture.height(); ++y)
    for (int x = 0; x < picture.width(); ++x)
      for (int c = 0; c < 3; ++c) {
        const int v = picture.at(x, y, 2 - c);
        if (bits == 8)
          out.ptr<std::uint8_t>(y)[3 * x + c] = static_cast<std::uint8_t>((v + 128) / 257);
        else
          out.ptr<std::uint16_t>(y)[3 * x + c] = static_cast<std::uint16_t>(v);
      }
  return write_with_opencv(path, out, {cv::IMWRITE_PNG_COMPRESSION, 3});
}

Result<void> write_stored16(const fs::path& path, const Image& values) {
  std::vector<int> parameters = {cv::IMWRITE_TIFF_COMPRESSION, 1};  // none
  const std::string type = extension(path);
  if (type == ".png")
    parameters = {cv::IMWRITE_PNG_COMPRESSION, 1};
  else if (type != ".tif" && type != ".tiff")
    return error(ErrorCode::kBadValue, "cannot write '{}' with 16 bits: its name must end in .png or .tif",
                 path.string());
  return write_with_opencv(path, to_opencv<std::uint16_t>(values, CV_16UC1, CV_16UC3, 65535), parameters);
}

Result<void> write_png8(const fs::path& path, const Image& values) {
  return write_with_opencv(path, to_opencv<std::uint8_t>(values, CV_8UC1, CV_8UC3, 255),
                           {cv::IMWRITE_PNG_COMPRESSION, 3});
}

Result<void> write_exr(const fs::path& path, const std::vector<NamedChannel>& channels) {
  CS_CHECK(!channels.empty(), "an image has a channel");
  const int width = channels[0].image->width(), height = channels[0].image->height();
  return write_atomically_with(path, [&](const fs::path& temporary) -> Result<void> {
    try {
      Imf::Header header(width, height);
      header.compression() = Imf::ZIP_COMPRESSION;
      Imf::FrameBuffer buffer;
      for (const NamedChannel& channel : channels) {
        CS_CHECK(channel.image->same_size(width, height) && channel.image->channels() == 1, "channels of one size");
        header.channels().insert(channel.name, Imf::Channel(Imf::FLOAT));
        auto* data = const_cast<char*>(reinterpret_cast<const char*>(channel.image->data().data()));
        buffer.insert(channel.name, Imf::Slice(Imf::FLOAT, data, sizeof(float), sizeof(float) * width));
      }
      Imf::OutputFile file(temporary.c_str(), header);
      file.setFrameBuffer(buffer);
      file.writePixels(height);
    } catch (const Bug&) {
      throw;
    } catch (const std::exception& e) {
      return error(ErrorCode::kIo, "cannot write '{}': {}; free some space or choose another folder", path.string(),
                   e.what());
    }
    return {};
  });
}

Result<std::vector<Image>> read_exr(const fs::path& path, const std::vector<std::string>& names) {
  if (!fs::is_regular_file(path)) return unreadable(path, "is missing");
  try {
    Imf::InputFile file(path.c_str());
    const Imath::Box2i window = file.header().dataWindow();
    const int width = window.max.x - window.min.x + 1, height = window.max.y - window.min.y + 1;
    std::vector<Image> images;
    Imf::FrameBuffer buffer;
    for (const std::string& name : names) {
      if (!file.header().channels().findChannel(name)) return unreadable(path, "has no channel '" + name + "'");
      images.emplace_back(width, height, 1);
    }
    for (std::size_t i = 0; i < names.size(); ++i) {
      char* base = reinterpret_cast<char*>(images[i].data().data() - window.min.x -
                                           static_cast<std::ptrdiff_t>(window.min.y) * width);
      buffer.insert(names[i], Imf::Slice(Imf::FLOAT, base, sizeof(float), sizeof(float) * width));
    }
    file.setFrameBuffer(buffer);
    file.readPixels(window.min.y, window.max.y);
    return images;
  } catch (const std::exception& e) {
    return unreadable(path, std::string("is no readable EXR file: ") + e.what());
  }
}

}  // namespace countershade
