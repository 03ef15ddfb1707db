// AprilTags in pictures and in photos: of the family 36h11 (Olson 2011), which boards have, and of Standard41h12
// (Krogius et al. 2019), of which there are 2115.
#pragma once

#include <Eigen/Dense>
#include <array>
#include <vector>

#include "calib/image/image.h"

namespace countershade::capture {

enum class TagFamily { k36h11, kStandard41h12 };

struct Tag {
  int id = 0;
  std::array<Eigen::Vector2d, 4> corners;  // of the border [px]: top left, top right, bottom right, bottom left
};

// 8 bits, the brightest thousandth white: detectors work on these. photo: any scale, 1 or 3 channels.
Mask grey8(const Image& photo);

// All that are seen, each as often as it is; up to one wrong bit is corrected.
std::vector<Tag> find_tags(const Mask& grey, TagFamily family);

// Modules of the tags of Standard41h12: the border is that of the 5 x 5 in the middle, and codes lie on both sides of
// it.
inline constexpr int k41h12Ids = 2115, k41h12Modules = 9, k41h12Border = 2;
// (9, 9), 1 = white.
Mask modules_41h12(int id);

}  // namespace countershade::capture
