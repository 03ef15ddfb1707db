// Views of a board by a known lens, with Gaussian noise, and where the boards stood.
#pragma once

#include <string>

#include "simdata/render/board_photo.h"
#include "solver/fit/lens/lens_fit.h"

namespace countershade::solver {

inline Lens brown_lens() {
  return Lens::make("LENSMODEL_OPENCV5", {520, 524, 313, 246, -0.21, 0.09, 0.0011, -0.0007, -0.015}, 640, 480).value();
}

struct SeenBoards {
  Lens lens = brown_lens();
  double sigma_px = 0.2;
  BoardViews data;
  std::vector<Pose> poses;

  SeenBoards(const std::string& name, int views, const Lens& seen_by = brown_lens(), double most_tilt = 0.8,
             double fill = 0.6)
      : lens(seen_by) {
    Random random(hash_name(name));
    data.board = parse_board("chessboard:9x7:20mm").value();
    data.width = lens.width(), data.height = lens.height();
    for (int v = 0; v < views; ++v) poses.push_back(simdata::board_pose(data.board, lens, fill, most_tilt, random));
    see(random);
  }
  // Fresh noise.
  void see(Random& random) {
    data.views.clear();
    for (const Pose& pose : poses) data.views.push_back(simdata::seen_points(data.board, lens, pose, sigma_px, random));
  }
};

// Where `x`, held by the boards where they truly stood, is seen by a fit: through the mean of its poses.
inline Eigen::Vector2d seen_through_boards(const std::vector<Pose>& truth, const std::vector<Pose>& poses,
                                           const Lens& lens, const Eigen::Vector3d& x, bool at_infinity) {
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (std::size_t f = 0; f < truth.size(); ++f) {
    Pose from = truth[f], to = poses[f];
    if (at_infinity) from.translation.setZero(), to.translation.setZero();
    mean += to * (from.inverse() * x) / static_cast<double>(truth.size());
  }
  return lens.project(mean);
}

}  // namespace countershade::solver
