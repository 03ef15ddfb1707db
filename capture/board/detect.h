// Finds a calibration board in a photo.
#pragma once

#include <Eigen/Dense>
#include <optional>
#include <string>
#include <vector>

#include "calib/geometry/board.h"
#include "calib/image/image.h"

namespace countershade::capture {

struct Detection {
  bool found = false;
  std::string reason;                 // why not, as a sentence: what was seen instead, and the remedy
  std::vector<Eigen::Vector2d> q_px;  // one per point of the board; NaN where it was not seen
  int seen = 0;                       // points
};

// photo: any scale, 1 or 3 channels. Chessboards by their sectors (Duda & Frese 2018, OpenCV's
// findChessboardCornersSB), seen whole. Tags (Krogius et al. 2019, libapriltag) and ArUco markers (Garrido-Jurado et
// al. 2014, OpenCV) say which points are where, parts of a board are enough; each point is then the saddle of the
// brightness around it. Fewer than kLeastPoints points, or points almost in a line, are not enough for a pose with
// something left over.
Detection detect_board(const Image& photo, const Board& board);
inline constexpr int kLeastPoints = 12;

// A board in a photo of an unknown one: markers tell its kind, its columns, its rows as far as they are seen, and the
// share of a square that they take. square: 25 mm, what we print; lenses do not depend on it.
std::optional<Board> recognise_board(const Image& photo);

}  // namespace countershade::capture
