// Calibration boards: what is printed on them, and where their points lie. A board's frame has its origin at the first
// point (top left), x right, y down, z into the board, in metres.
#pragma once

#include <Eigen/Dense>
#include <cstdint>
#include <string>
#include <vector>

#include "calib/base/result.h"

namespace countershade {

enum class BoardKind { kChessboard, kAprilTag, kCharuco };

// chessboard: columns x rows inner corners. apriltag, charuco: a chessboard of columns x rows squares, the top left one
// black, with markers in the white ones, numbered row by row: AprilTags of the family 36h11, or ArUco markers (as
// OpenCV 4.6 and later draws a ChArUco board). Their points are the inner corners too: saddles of the brightness, which
// can be placed better than the corners of a marker; markers say which is which where only a part of the board is seen.
struct Board {
  BoardKind kind = BoardKind::kAprilTag;
  int columns = 10, rows = 7;
  double square = 0.025;    // m: edge of a square
  double marker = 0.01875;  // m: edge of a marker's black border; no meaning for a chessboard
  int marker_bits = 5;      // charuco: 4, 5 or 6, the ArUco dictionary

  // "apriltag:10x7:25mm", "chessboard:9x7:75mm", "charuco:8x6:40mm:30mm:5x5" (markers: 3/4 of the square, 5x5 unless
  // given); parse_board reads what name writes.
  std::string name() const;

  // All points lie on a grid of this spacing = square; point i is in column i % grid_columns().
  int grid_columns() const { return kind == BoardKind::kChessboard ? columns : columns - 1; }
  int grid_rows() const { return kind == BoardKind::kChessboard ? rows : rows - 1; }
  int points() const { return grid_columns() * grid_rows(); }
  Eigen::Vector3d point(int i) const {
    return {i % grid_columns() * square, static_cast<double>(i / grid_columns()) * square, 0};
  }
  int markers() const { return kind == BoardKind::kChessboard ? 0 : columns * rows / 2; }  // ids 0..markers() - 1
  // Black square of a marker: its top left corner, m.
  Eigen::Vector2d marker_corner(int id) const;
};

// Errors: kBadValue naming the part that is wrong, its bound, and for an unknown kind the nearest one.
Result<Board> parse_board(const std::string& text);

struct Rectangle {
  Eigen::Vector2d low, high;  // m, low < high
};

// What is black on a board.
class BoardPattern {
 public:
  explicit BoardPattern(const Board& board);
  bool dark(const Eigen::Vector2d& x) const;
  std::vector<Rectangle> dark_rectangles() const;
  Rectangle extent() const;  // of all that is printed, without a white margin
  const Board& board() const { return board_; }

 private:
  // Squares are counted from the one whose top left corner is the first point; -1 = left of or above it.
  enum class Cell { kWhite, kBlack, kMarker };
  Cell cell(int column, int row, int& marker) const;
  bool bit(int marker, int column, int row) const {
    return bits_[(static_cast<std::size_t>(marker) * side_ + row) * side_ + column] != 0;
  }

  Board board_;
  int side_ = 0;                    // bits along a marker's edge, its black border included
  std::vector<std::uint8_t> bits_;  // 1 = black
};

}  // namespace countershade
