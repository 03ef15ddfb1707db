// What photos and a decoded view give away by themselves, without trying another sequence.
#pragma once

#include <optional>
#include <string>

#include "capture/pattern/decode.h"

namespace countershade::capture {

// On which side of itself the map from camera to projector pixels lies: sign of d(x, y) / d(u, v).
struct Handedness {
  double mirrored = 0;     // share of places where the determinant is negative
  double crossed = 0;      // and where x runs up or down and y sideways: upright, or turned over, once exchanged
  std::size_t places = 0;  // where both axes were read and the map is not too steep in one direction to tell
};
Handedness handedness(const Correspondence& c);

// A pattern and its inverse add up to white + black wherever light was stored as it is. Stored as light^(1 / g) the sum
// comes out too large where the pattern is half lit, and as it should be where it is lit or dark, whatever the lamp
// did between the photos. The exponent is that which mends the half-lit pixels' median.
struct PairSum {
  double exponent = 1;   // photos would be linear when raised to this
  double excess = 0;     // median of (a + b - white - black) / (white - black) as stored, half-lit less lit or dark
  double scatter = 0;    // its standard deviation from pixel to pixel (by the median)
  std::size_t half = 0;  // half-lit pixels
  bool gamma() const;    // beyond what noise, flicker or a not quite linear camera do
};
// Means of channels, one size; pixels whose `valid` is 0 do not count. Nothing where a and b are not a pattern and its
// inverse, or fewer than 300 pixels are half lit.
std::optional<PairSum> pair_sum(const Image& white, const Image& black, const Image& a, const Image& b,
                                const Mask& valid);

// JPEG codes blocks of 8 x 8 pixels, each by itself, so that what its quantisation takes away ends at their borders:
// second differences across them are larger than inside (Fan & de Queiroz 2003, identification of bitmap compression
// history). One mean of channels.
struct Blockiness {
  double inside = 0, across = 0;  // mean |v00 - v01 - v10 + v11| inside blocks, and over their borders
  double sigmas = 0;              // how far they are apart, in what chance would do
  bool compressed = false;        // clearly so, on the grid that begins at the first pixel and on no other
};
Blockiness blockiness(const Image& light);

// Correlation of a photo of a picture that no code is part of with what the projector should have shown there,
// `picture` being shown by it: what was decoded says where each camera pixel looks. Nothing where few pixels were
// decoded or the picture is flat.
std::optional<double> agreement(const Correspondence& c, const Picture& picture, const Image& photo, const Image& white,
                                const Image& black);

}  // namespace countershade::capture
