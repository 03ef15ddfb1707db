// Photos of a calibration board by a known lens.
#pragma once

#include <vector>

#include "calib/base/random.h"
#include "calib/geometry/board.h"
#include "calib/geometry/lens.h"
#include "calib/image/image.h"

namespace countershade::simdata {

struct BoardPhotoOptions {
  double white = 0.8, black = 0.05, surround = 0.35;  // light of paper, print, and what lies around; full scale = 1
  double margin = 0.6;                                // of white paper around the print, in squares
  double blur_sigma_px = 0.6;                         // of the optics
  double noise = 0.005;                               // of a pixel, full scale = 1
  int samples = 8;                                    // per axis of a pixel that an edge crosses, jittered
};

// Rays of all pixels of a lens, found once for many photos.
class BoardCamera {
 public:
  explicit BoardCamera(const Lens& lens);
  const Lens& lens() const { return lens_; }
  // Light in the photo, (height, width, 1), every pixel the mean over its area.
  Image photo(const BoardPattern& pattern, const Pose& camera_from_board, const BoardPhotoOptions& options,
              Random& random) const;

 private:
  Lens lens_;
  std::vector<Eigen::Vector3d> corners_;  // rays through the corners of pixels, (height + 1, width + 1)
};

// A pose in which the lens sees the whole board: filling `fill` of the picture's smaller side, its normal up to
// `most_tilt` rad off the view (uniform over 0.3 to 1 of it), anywhere in the picture.
Pose board_pose(const Board& board, const Lens& lens, double fill, double most_tilt, Random& random);

// Where the lens sees the points, with Gaussian noise in each coordinate [px]; NaN outside the picture.
std::vector<Eigen::Vector2d> seen_points(const Board& board, const Lens& lens, const Pose& camera_from_board,
                                         double sigma_px, Random& random);

}  // namespace countershade::simdata
