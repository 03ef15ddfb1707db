// How cameras pack pixels: GenICam's Pixel Format Naming Convention (PFNC), as GigE Vision and USB3 Vision send it, and
// what else webcams send.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "calib/base/result.h"
#include "calib/image/image.h"

namespace countershade::capture {

enum class Packing {
  kBytes,      // one byte per value
  kWords,      // two bytes per value, the lower one first, the bits at the low end
  kBits,       // one value after the other without a gap, low bits first ("p")
  kOldPacked,  // GigE Vision 1: two values in three bytes, high bits in the outer ones, low bits in the middle
               // ("Packed")
  kYuyv,       // of webcams: two pixels in four bytes, luma 16 to 235 each, chroma in common (ITU-R BT.601)
  kJpeg,       // a JPEG file
};

struct PixelFormat {
  std::string name;        // as cameras spell it: "Mono12", "BayerRG8", "Mono12Packed"; "YUYV", "JPEG"
  std::uint32_t code = 0;  // PFNC; 0 = not of GenICam
  int bits = 8;            // per value
  Packing packing = Packing::kBytes;
  std::string colours = "";  // "" = grey; "RGGB", ...: colours of the first 2 x 2 pixels; "RGB", "BGR": three values
                             // per pixel

  double full_scale() const { return static_cast<double>((1u << bits) - 1); }
  // False where the light does not come back from the numbers: few grey values, chroma in common, a response of its
  // own.
  bool faithful() const { return packing != Packing::kYuyv && packing != Packing::kJpeg; }
  // Bytes of a picture; packed rows follow one another without a gap. 0 of a JPEG file: any.
  std::size_t bytes(int width, int height) const;
};

// All that unpack() knows, the best for measuring first: grey before mosaic before colour, then more bits, then
// unpacked.
const std::vector<PixelFormat>& pixel_formats();
std::optional<PixelFormat> pixel_format(std::uint32_t code);
// The best of those that a camera offers, by name.
std::optional<PixelFormat> best_format(const std::vector<std::string>& offered);

// Stored numbers (height, width, 1 or 3), 0 to full_scale(); a mosaic is interpolated (calib/image/demosaic.h).
// `stride`: bytes from one row to the next; 0 = rows follow one another without a gap. Error: kDevice when there are
// fewer bytes than the picture has (names both), a size is not positive, or a JPEG file cannot be read or has another
// size.
Result<Image> unpack(const PixelFormat& format, std::span<const std::byte> bytes, int width, int height,
                     std::size_t stride = 0);

// Share of the pixels of which a channel is at full scale.
double saturated_share(const Image& values, double full_scale);

}  // namespace countershade::capture
