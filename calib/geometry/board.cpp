#include "calib/geometry/board.h"

extern "C" {
#include <apriltag/apriltag.h>
#include <apriltag/tag36h11.h>
}

#include <charconv>
#include <cmath>
#include <opencv2/aruco/dictionary.hpp>

#include "calib/file/nearest.h"

namespace countershade {

namespace {

constexpr int kMostSquares = 100;  // along an edge
constexpr int kMostTags = 587;     // of the family 36h11
constexpr double kMarkerShare = 0.75;

const std::vector<std::string> kKinds = {"chessboard", "apriltag", "charuco"};  // in the order of BoardKind

std::vector<std::string> split(const std::string& text, char at) {
  std::vector<std::string> parts(1);
  for (char c : text) {
    if (c == at)
      parts.emplace_back();
    else
      parts.back() += c;
  }
  return parts;
}

bool parse_pair(const std::string& text, int pair[2]) {
  const auto parts = split(text, 'x');
  if (parts.size() != 2) return false;
  for (int i = 0; i < 2; ++i) {
    const char* end = parts[i].data() + parts[i].size();
    const auto [stop, code] = std::from_chars(parts[i].data(), end, pair[i]);
    if (code != std::errc() || stop != end) return false;
  }
  return true;
}

// "25mm", "2.5cm", ".025m" in metres; NaN for anything else.
double parse_length(const std::string& text) {
  double value = 0;
  const char* end = text.data() + text.size();
  const auto [stop, code] = std::from_chars(text.data(), end, value);
  const std::string unit(stop, end);
  if (code != std::errc()) return NAN;
  return unit == "mm" ? value / 1000 : unit == "cm" ? value / 100 : unit == "m" ? value : NAN;
}

Result<void> check_counts(const Board& b, const std::string& text) {
  constexpr int kLeast = 3;
  if (b.columns < kLeast || b.rows < kLeast || b.columns > kMostSquares || b.rows > kMostSquares)
    return error(ErrorCode::kBadValue, "board '{}': {} x {} {}, each must be {} to {}", text, b.columns, b.rows,
                 b.kind == BoardKind::kChessboard ? "inner corners" : "squares", kLeast, kMostSquares);
  const int most = b.kind == BoardKind::kAprilTag ? kMostTags : 1000;
  if (b.markers() > most)
    return error(ErrorCode::kBadValue, "board '{}' needs {} markers, its family has {}; take fewer, larger squares",
                 text, b.markers(), most);
  return {};
}

Result<void> parse_marker(const std::vector<std::string>& parts, Board& b, const std::string& text) {
  b.marker = kMarkerShare * b.square;
  if (parts.size() > 3) b.marker = parse_length(parts[3]);
  if (!(b.marker > 0.2 * b.square && b.marker < 0.95 * b.square))
    return error(ErrorCode::kBadValue,
                 "board '{}': marker edge '{}' must be a length between .2 and .95 of the square's, such as {:g}mm",
                 text, parts.size() > 3 ? parts[3] : "", 750 * b.square);
  if (b.kind == BoardKind::kCharuco && parts.size() > 4) {
    int bits[2] = {0, 0};
    if (!parse_pair(parts[4], bits) || bits[0] != bits[1] || bits[0] < 4 || bits[0] > 6)
      return error(ErrorCode::kBadValue, "board '{}': markers '{}' must be 4x4, 5x5 or 6x6 (ArUco's dictionaries)",
                   text, parts[4]);
    b.marker_bits = bits[0];
  }
  return {};
}

// Codes of all markers of a board, black border included: (markers, side, side), 1 = black.
std::vector<std::uint8_t> tag_bits(const Board& board, int& side) {
  apriltag_family_t* family = tag36h11_create();
  side = family->width_at_border;
  std::vector<std::uint8_t> bits(static_cast<std::size_t>(board.markers()) * side * side, 1);
  for (int id = 0; id < board.markers(); ++id)
    for (std::uint32_t k = 0; k < family->nbits; ++k) {
      const bool white = (family->codes[id] >> (family->nbits - 1 - k)) & 1;
      bits[(static_cast<std::size_t>(id) * side + family->bit_y[k]) * side + family->bit_x[k]] = !white;
    }
  tag36h11_destroy(family);
  return bits;
}

std::vector<std::uint8_t> aruco_bits(const Board& board, int& side) {
  side = board.marker_bits + 2;
  const int first = board.marker_bits == 4   ? cv::aruco::DICT_4X4_50
                    : board.marker_bits == 5 ? cv::aruco::DICT_5X5_50
                                             : cv::aruco::DICT_6X6_50;
  const auto dictionary =
      cv::aruco::getPredefinedDictionary(first + 3);  // 1000 codes; the smaller ones begin as it does
  std::vector<std::uint8_t> bits;
  for (int id = 0; id < board.markers(); ++id) {
    const cv::Mat code = cv::aruco::Dictionary::getBitsFromByteList(dictionary->bytesList.row(id), board.marker_bits);
    for (int y = 0; y < side; ++y)
      for (int x = 0; x < side; ++x) {
        const bool border = x == 0 || y == 0 || x == side - 1 || y == side - 1;
        bits.push_back(border || code.at<std::uint8_t>(y - 1, x - 1) == 0);
      }
  }
  return bits;
}

}  // namespace

std::string Board::name() const {
  std::string text = fmt::format("{}:{}x{}:{:.10g}mm", kKinds[static_cast<int>(kind)], columns, rows, 1000 * square);
  if (kind != BoardKind::kChessboard) text += fmt::format(":{:.10g}mm", 1000 * marker);
  if (kind == BoardKind::kCharuco) text += fmt::format(":{}x{}", marker_bits, marker_bits);
  return text;
}

Eigen::Vector2d Board::marker_corner(int id) const {
  // Two rows of squares hold `columns` markers; the first row begins with a black square.
  const int pair = id / columns, rest = id % columns, in_first = columns / 2;
  const int row = 2 * pair + (rest >= in_first ? 1 : 0);
  const int column = rest >= in_first ? 2 * (rest - in_first) : 2 * rest + 1;
  const double inset = (square - marker) / 2;
  return {(column - 1) * square + inset, (row - 1) * square + inset};
}

Result<Board> parse_board(const std::string& text) {
  const auto parts = split(text, ':');
  Board board;
  const auto kind = std::find(kKinds.begin(), kKinds.end(), parts[0]);
  if (kind == kKinds.end())
    return error(ErrorCode::kBadValue, "board '{}': there is no kind '{}', the nearest is '{}'; kinds: {}", text,
                 parts[0], nearest(parts[0], kKinds), fmt::join(kKinds, ", "));
  board.kind = static_cast<BoardKind>(kind - kKinds.begin());
  int counts[2] = {0, 0};
  const std::size_t most_parts = board.kind == BoardKind::kCharuco ? 5 : board.kind == BoardKind::kAprilTag ? 4 : 3;
  if (parts.size() < 3 || parts.size() > most_parts || !parse_pair(parts[1], counts))
    return error(ErrorCode::kBadValue, "board '{}': must be written as {}", text,
                 board.kind == BoardKind::kChessboard
                     ? "chessboard:COLUMNSxROWS:SQUARE, inner corners, such as chessboard:9x7:75mm"
                 : board.kind == BoardKind::kAprilTag
                     ? "apriltag:COLUMNSxROWS:SQUARE[:TAG], such as apriltag:10x7:25mm"
                     : "charuco:COLUMNSxROWS:SQUARE[:MARKER[:BITS]], such as charuco:8x6:40mm:30mm:5x5");
  board.columns = counts[0], board.rows = counts[1];
  board.square = parse_length(parts[2]);
  if (!(board.square >= 1e-4 && board.square <= 10))
    return error(ErrorCode::kBadValue, "board '{}': edge '{}' must be a length from .1mm to 10m, such as 25mm", text,
                 parts[2]);
  if (board.kind != BoardKind::kChessboard) CS_TRY_VOID(parse_marker(parts, board, text));
  CS_TRY_VOID(check_counts(board, text));
  return board;
}

BoardPattern::BoardPattern(const Board& board) : board_(board) {
  if (board.kind == BoardKind::kAprilTag) bits_ = tag_bits(board, side_);
  if (board.kind == BoardKind::kCharuco) bits_ = aruco_bits(board, side_);
}

BoardPattern::Cell BoardPattern::cell(int column, int row, int& marker) const {
  if (column < -1 || row < -1 || column >= board_.grid_columns() || row >= board_.grid_rows()) return Cell::kWhite;
  if ((column + row) % 2 == 0) return Cell::kBlack;
  if (board_.kind == BoardKind::kChessboard) return Cell::kWhite;
  const int square_column = column + 1, square_row = row + 1;
  marker = square_row / 2 * board_.columns + (square_row % 2 ? board_.columns / 2 : 0) + square_column / 2;
  return Cell::kMarker;
}

bool BoardPattern::dark(const Eigen::Vector2d& x) const {
  int marker = 0;
  const Cell found = cell(static_cast<int>(std::floor(x.x() / board_.square)),
                          static_cast<int>(std::floor(x.y() / board_.square)), marker);
  if (found != Cell::kMarker) return found == Cell::kBlack;
  const Eigen::Vector2d inside = (x - board_.marker_corner(marker)) / board_.marker * side_;
  const int i = static_cast<int>(std::floor(inside.x())), j = static_cast<int>(std::floor(inside.y()));
  return i >= 0 && j >= 0 && i < side_ && j < side_ && bit(marker, i, j);
}

std::vector<Rectangle> BoardPattern::dark_rectangles() const {
  std::vector<Rectangle> all;
  const double s = board_.square, pixel = side_ ? board_.marker / side_ : 0;
  for (int row = -1; row < board_.grid_rows(); ++row)
    for (int column = -1; column < board_.grid_columns(); ++column) {
      int marker = 0;
      const Cell found = cell(column, row, marker);
      if (found == Cell::kBlack) all.push_back({{column * s, row * s}, {(column + 1) * s, (row + 1) * s}});
      if (found != Cell::kMarker) continue;
      const Eigen::Vector2d corner = board_.marker_corner(marker);
      for (int y = 0; y < side_; ++y)
        for (int x = 0; x < side_; ++x) {
          int end = x;
          while (end < side_ && bit(marker, end, y)) ++end;
          if (end > x)
            all.push_back({corner + pixel * Eigen::Vector2d(x, y), corner + pixel * Eigen::Vector2d(end, y + 1)});
          x = end;
        }
    }
  return all;
}

Rectangle BoardPattern::extent() const {
  const double s = board_.square;
  return {{-s, -s}, {board_.grid_columns() * s, board_.grid_rows() * s}};
}

}  // namespace countershade
