#include "capture/device/pixel_format.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgcodecs.hpp>

#include "calib/image/demosaic.h"

namespace countershade::capture {

namespace {

std::vector<PixelFormat> all_formats() {
  std::vector<PixelFormat> formats = {
      {"Mono16", 0x01100007, 16, Packing::kWords},
      {"Mono14", 0x01100025, 14, Packing::kWords},
      {"Mono12", 0x01100005, 12, Packing::kWords},
      {"Mono12p", 0x010C0047, 12, Packing::kBits},
      {"Mono12Packed", 0x010C0006, 12, Packing::kOldPacked},
      {"Mono10", 0x01100003, 10, Packing::kWords},
      {"Mono10p", 0x010A0046, 10, Packing::kBits},
      {"Mono10Packed", 0x010C0004, 10, Packing::kOldPacked},
      {"Mono8", 0x01080001, 8, Packing::kBytes},
  };
  struct Bayer {
    const char *letters, *colours;
    std::uint32_t code16, code12, code10, code8;
  };
  static constexpr Bayer kBayer[4] = {{"GR", "GRBG", 0x0110002E, 0x01100010, 0x0110000C, 0x01080008},
                                      {"RG", "RGGB", 0x0110002F, 0x01100011, 0x0110000D, 0x01080009},
                                      {"GB", "GBRG", 0x01100030, 0x01100012, 0x0110000E, 0x0108000A},
                                      {"BG", "BGGR", 0x01100031, 0x01100013, 0x0110000F, 0x0108000B}};
  for (const int bits : {16, 12, 10, 8})
    for (const Bayer& b : kBayer)
      formats.push_back({fmt::format("Bayer{}{}", b.letters, bits),
                         bits == 16   ? b.code16
                         : bits == 12 ? b.code12
                         : bits == 10 ? b.code10
                                      : b.code8,
                         bits, bits == 8 ? Packing::kBytes : Packing::kWords, b.colours});
  formats.push_back({"RGB8", 0x02180014, 8, Packing::kBytes, "RGB"});
  formats.push_back({"BGR8", 0x02180015, 8, Packing::kBytes, "BGR"});
  formats.push_back({"YUYV", 0, 8, Packing::kYuyv, "RGB"});
  formats.push_back({"JPEG", 0, 8, Packing::kJpeg, "RGB"});
  return formats;
}

// Value number i of `bits` bits.
std::uint32_t value_at(const PixelFormat& format, const std::uint8_t* bytes, std::size_t i) {
  switch (format.packing) {
    case Packing::kBytes:
      return bytes[i];
    case Packing::kWords:
      return (bytes[2 * i] | bytes[2 * i + 1] << 8) & ((1u << format.bits) - 1);
    case Packing::kBits: {
      const std::size_t bit = i * format.bits, at = bit / 8;
      const int shift = static_cast<int>(bit % 8);
      return ((bytes[at] | bytes[at + 1] << 8) >> shift) & ((1u << format.bits) - 1);
    }
    case Packing::kOldPacked: {
      const std::uint8_t* three = bytes + i / 2 * 3;
      const int low = format.bits - 8;
      const std::uint32_t high = three[i % 2 ? 2 : 0], rest = three[1] >> (i % 2 ? 4 : 0);
      return high << low | (rest & ((1u << low) - 1));
    }
    case Packing::kYuyv:
    case Packing::kJpeg:
      break;  // have no values one by one
  }
  return 0;
}

float rounded(double value) {
  return static_cast<float>(std::round(std::clamp(value, 0.0, 255.0)));
}

// BT.601, studio range; the chroma of a pair belongs to both.
Image from_yuyv(const std::uint8_t* bytes, int width, int height) {
  Image rgb(width, height, 3);
  const std::size_t row = static_cast<std::size_t>(width + 1) / 2 * 4;
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      const std::uint8_t* pair = bytes + y * row + x / 2 * 4;
      const double luma = 255.0 / 219 * (pair[x % 2 ? 2 : 0] - 16), u = 255.0 / 224 * (pair[1] - 128),
                   v = 255.0 / 224 * (pair[3] - 128);
      rgb.at(x, y, 0) = rounded(luma + 1.402 * v);
      rgb.at(x, y, 1) = rounded(luma - 0.344136 * u - 0.714136 * v);
      rgb.at(x, y, 2) = rounded(luma + 1.772 * u);
    }
  return rgb;
}

Result<Image> from_jpeg(std::span<const std::byte> bytes, int width, int height) {
  cv::Mat bgr;
  if (!bytes.empty()) {
    const cv::Mat file(1, static_cast<int>(bytes.size()), CV_8U, const_cast<std::byte*>(bytes.data()));
    bgr = cv::imdecode(file, cv::IMREAD_COLOR | cv::IMREAD_IGNORE_ORIENTATION);
  }
  if (bgr.cols != width || bgr.rows != height)
    return error(ErrorCode::kDevice, "a JPEG picture of {} x {} pixels was awaited; {} bytes came that are {}", width,
                 height, bytes.size(), bgr.empty() ? "none" : fmt::format("one of {} x {}", bgr.cols, bgr.rows));
  Image rgb(width, height, 3);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x)
      for (int c = 0; c < 3; ++c) rgb.at(x, y, c) = bgr.at<cv::Vec3b>(y, x)[2 - c];
  return rgb;
}

}  // namespace

std::size_t PixelFormat::bytes(int width, int height) const {
  const std::size_t values = static_cast<std::size_t>(width) * height * (colours.size() == 3 ? 3 : 1);
  switch (packing) {
    case Packing::kBytes:
      return values;
    case Packing::kWords:
      return 2 * values;
    case Packing::kBits:
      return (values * bits + 7) / 8;
    case Packing::kOldPacked:
      return (values + 1) / 2 * 3;
    case Packing::kYuyv:
      return static_cast<std::size_t>(width + 1) / 2 * 4 * height;
    case Packing::kJpeg:
      return 0;
  }
  return 0;
}

const std::vector<PixelFormat>& pixel_formats() {
  static const std::vector<PixelFormat> kFormats = all_formats();
  return kFormats;
}

std::optional<PixelFormat> pixel_format(std::uint32_t code) {
  for (const PixelFormat& f : pixel_formats())
    if (f.code == code && code != 0) return f;
  return std::nullopt;
}

std::optional<PixelFormat> best_format(const std::vector<std::string>& offered) {
  for (const PixelFormat& f : pixel_formats())
    if (std::find(offered.begin(), offered.end(), f.name) != offered.end()) return f;
  return std::nullopt;
}

Result<Image> unpack(const PixelFormat& format, std::span<const std::byte> bytes, int width, int height,
                     std::size_t stride) {
  if (const std::size_t row = width > 0 && height > 0 ? format.bytes(width, 1) : 0; row > 0 && stride > row) {
    if (bytes.size() < stride * (height - 1) + row)
      return error(ErrorCode::kDevice, "a picture of {} rows of {} bytes, {} apart, came with {} bytes", height, row,
                   stride, bytes.size());
    std::vector<std::byte> rows;
    for (int y = 0; y < height; ++y) {
      const std::span<const std::byte> one = bytes.subspan(y * stride, row);
      rows.insert(rows.end(), one.begin(), one.end());
    }
    return unpack(format, rows, width, height);
  }
  if (width <= 0 || height <= 0 || bytes.size() < format.bytes(width, height))
    return error(ErrorCode::kDevice, "a picture of {} x {} pixels in {} has {} bytes, {} came", width, height,
                 format.name, width > 0 && height > 0 ? format.bytes(width, height) : 0, bytes.size());
  const int channels = format.colours.size() == 3 ? 3 : 1;
  if (format.packing == Packing::kJpeg) return from_jpeg(bytes, width, height);
  if (format.packing == Packing::kYuyv)
    return from_yuyv(reinterpret_cast<const std::uint8_t*>(bytes.data()), width, height);
  Image stored(width, height, channels);
  // The last value of a packed picture may end in the last byte: what is read beyond it must exist.
  std::vector<std::uint8_t> tail;
  const auto* from = reinterpret_cast<const std::uint8_t*>(bytes.data());
  if (format.packing == Packing::kBits) {
    tail.assign(from, from + format.bytes(width, height));
    tail.push_back(0);
    from = tail.data();
  }
  const std::size_t values = stored.data().size();
  if (format.packing == Packing::kBytes) {  // what fast cameras send, without a decision at each value
    std::copy_n(from, values, stored.data().begin());
  } else {
    for (std::size_t i = 0; i < values; ++i) stored.data()[i] = static_cast<float>(value_at(format, from, i));
  }
  if (format.colours == "BGR")
    for (std::size_t i = 0; i < stored.pixels(); ++i) std::swap(stored.data()[3 * i], stored.data()[3 * i + 2]);
  if (format.colours.empty() || channels == 3) return stored;
  return demosaiced(stored, format.colours);
}

double saturated_share(const Image& values, double full_scale) {
  const int channels = values.channels();
  const auto limit = static_cast<float>(full_scale);
  std::size_t full = 0;
  if (channels == 1)
    full = std::count_if(values.data().begin(), values.data().end(), [=](float x) { return x >= limit; });
  for (std::size_t i = 0; channels > 1 && i < values.pixels(); ++i) {
    const float* v = values.data().data() + i * channels;
    full += std::any_of(v, v + channels, [=](float x) { return x >= limit; });
  }
  return static_cast<double>(full) / static_cast<double>(std::max<std::size_t>(1, values.pixels()));
}

}  // namespace countershade::capture
