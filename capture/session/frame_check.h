// What two photos must have to do with each other, judged without geometry.
#pragma once

#include <string>
#include <utility>

#include "calib/file/session.h"
#include "calib/image/image.h"

namespace countershade::capture {

// One exposure, binned. light: (height / bin, width / bin, 1), mean over pixels and channels, linear, 1 = full scale.
struct Bins {
  Image light;
  Image colour;          // the same per channel: a change of hue alone is a change; empty where bins are pixels
  Mask valid;            // 0 where a bin holds a saturated value
  double brightest = 0;  // largest value, fraction of full scale above the pedestal (stored, not linearised)
  double saturated = 0;  // share of pixels with a saturated channel
};

// Pixels of a bin that noise hardly touches, in each direction.
inline constexpr int kCoarse = 8;
// `stored`: stored numbers, 0..full_scale; pedestal and response are the camera's.
Bins bin_photo(const Image& stored, double full_scale, const CameraSpec& camera, int bin = kCoarse);

double mean_light(const Bins& bins);
// Mean absolute difference of two binned photos of one size (a Bug otherwise).
double mean_difference(const Bins& a, const Bins& b);
// The same after the brightness of b was fitted to a: {difference / mean of a, fitted factor - 1}.
std::pair<double, double> change_of_view(const Bins& a, const Bins& b);

// Light adds: a pattern and its inverse sum to white + black, in every camera pixel, whatever bounces. Saturated bins
// and those that the projector hardly lights are left out.
struct PairLaw {
  double error = 0;        // mean |one + other - white - black| / mean |white - black|
  double correlation = 0;  // of `one` and `other`, each as a fraction of white - black: -1 for a true pair
  double contrast = 0;     // smaller standard deviation of those fractions; 0 for stripes that the bins do not resolve
};
PairLaw pair_law(const Bins& white, const Bins& black, const Bins& one, const Bins& other);

// Light of a picture in about 20 blocks across, 0..1: what of it survives in the bins of any camera. Encoded values are
// squared, which is near enough to every projector's response for a prediction of "much" or "little".
Image block_light(const Picture& picture);
// Mean absolute change between two pictures of a projector, 0..1, for a camera of that many channels: one that sees
// grey does not tell red from green.
double block_change(const Image& a, const Image& b, int channels);

// Positions in the sequence that belong to frame `position`, -1 where there is none.
struct Companions {
  int white = -1, black = -1;  // of the same projector
  int inverse = -1;            // the same role but for `inverse`
};
Companions companions(const Sequence& sequence, int position);

}  // namespace countershade::capture
