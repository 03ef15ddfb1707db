// How well a compensation works, from photographs alone: plain show U, compensated show C, measured target T.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "calib/image/image.h"

namespace countershade::tools {

// Averaged linear photos of one size, 1 or 3 channels; W in the same units; masks of the same size (1 = belongs).
struct VerifyInput {
  const Image* uncompensated = nullptr;
  const Image* compensated = nullptr;
  const Image* target = nullptr;
  const Mask* lit = nullptr;       // pixels that count
  const Mask* edge = nullptr;      // zone at the creases; none: no zone
  const Mask* modelled = nullptr;  // pixels that the model covers; none: all of them
  std::string edge_text;           // what the zone is
  double white = 1;
  double pixel_noise = 0;         // sigma of one pixel of U and C
  const Mask* clipped = nullptr;  // pixels where some projector would need less than black or more than white; none:
                                  // estimated from the photos, generously (see clipped_text)
  double target_noise = 2;        // sigma of one pixel of T over pixel_noise (T is put together from several photos)
};

// Mean over factor x factor pixels that are valid (a last partial row or column is dropped). NaN where fewer than half
// of a block's pixels are valid; a pixel with a NaN in any channel is not.
struct Reduced {
  Image value;
  Raster<int> pixels;  // how many entered
};
Reduced masked_box_reduce(const Image& image, const Mask& valid, int factor);

// How far a show is from the target over some set of blocks (or pixels), all channels.
struct Deviations {
  int blocks = 0;
  double mean_percent = 0, p99_percent = 0;  // of W, linear
  double mean_grey = 0, p99_grey = 0;        // 255 sRGB(value / W), clipped to 0..255 before the difference
  double mean_delta_e = 0, p95_delta_e = 0;  // dE2000 of the same
};
struct ZoneNumbers {
  Deviations uncompensated, compensated;
  // mean |U - T| / mean |C - T|, linear light; infinite for C = T, NaN where U = T too or the zone is empty.
  double suppression = 0;
};

// What the photos cannot say and the caller adds after measure(); absent ones are left out.
struct Background {
  std::optional<double> held_out_percent;       // error on held-out patterns, mean, % of W
  std::optional<double> certificate_percent;    // error by the model itself, mean, % of W: beside the measured |C - T|
  std::optional<double> reachable_gap_percent;  // rms |B - R| over that of the best within range, by the model
  std::optional<int> frames;                    // photographed for the calibration
  std::optional<double> capture_seconds, compute_seconds;
};

struct VerifyNumbers {
  ZoneNumbers all, unclipped, edge;      // over 8 x 8 blocks
  ZoneNumbers per_pixel;                 // like `all`, without averaging
  double paper_measure = 0;              // mean(U - C) / mean(U), as in Bimber et al. 2006
  double clipped_share = 0;              // blocks that need clipping
  double uncovered_share = 0;            // lit pixels that the model does not cover (they count in all numbers)
  double above_white_share = 0;          // of the edge zone's blocks and channels: T is above W, where grey levels clip
  double unused_share = 0;               // lit pixels in no block: not finite, or in blocks that are mostly dark
  double worse_share = 0;                // blocks and channels farther from T than before by more than 3 sigma
  double pixel_mean_percent = 0;         // |C - T| per pixel
  double noise_floor_percent = 0;        // |C - T| per block of a perfect show
  double pixel_noise_floor_percent = 0;  // the same per pixel
  std::vector<double> histogram_u, histogram_c;  // shares of blocks and channels; bins of U - T, C - T over +-reach
  double histogram_reach = 10;                   // % of W; the outermost bins collect what lies beyond
  std::string edge_text, clipped_text;
  Background background;
};

// What PASS asks for; each bound has its reason.
struct Thresholds {
  double suppression = 10;  // unclipped blocks: a tenth of the veil is left, typically 1-2 % of white at most
  double edge_grey = 2.0;   // mean grey levels beside the crease: two neighbouring levels are hard to tell apart
  double worse_share =
      0.01;  // a compensation must not harm; 3 sigma alone lets .13 % through, the rest is registration
  double uncovered_share = 0.02;  // what the model does not know it cannot compensate
};

// Averages 8 x 8 blocks over their lit pixels. NaN pixels never enter. Requires images and masks of one size and a
// positive white (a Bug otherwise).
VerifyNumbers measure(const VerifyInput& input);

struct Verdict {
  bool pass = false;
  std::vector<std::string> failures;  // which bound, by how much, and what to try first
};
Verdict judge(const VerifyNumbers& numbers, const Thresholds& thresholds);

// Numbers that are not finite become null.
std::string numbers_json(const VerifyNumbers& numbers, const Verdict& verdict);

}  // namespace countershade::tools
