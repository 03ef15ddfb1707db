#include "capture/board/detect.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <opencv2/aruco.hpp>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>

#include "capture/board/tags.h"

namespace countershade::capture {

namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

using Quad = std::array<cv::Point2f, 4>;  // corners of a marker: top left, top right, bottom right, bottom left
using Markers = std::map<int, Quad>;

// A tag that is there twice says nothing.
Markers find_markers(const Mask& grey) {
  Markers markers;
  std::vector<int> twice;
  for (const Tag& tag : find_tags(grey, TagFamily::k36h11)) {
    Quad quad;
    for (int k = 0; k < 4; ++k)
      quad[k] = cv::Point2f(static_cast<float>(tag.corners[k].x()), static_cast<float>(tag.corners[k].y()));
    if (!markers.emplace(tag.id, quad).second) twice.push_back(tag.id);
  }
  for (int id : twice) markers.erase(id);
  return markers;
}

cv::Mat view_of(const Mask& grey) {
  return {grey.height(), grey.width(), CV_8U, const_cast<std::uint8_t*>(grey.data().data())};
}

Markers find_aruco(const cv::Mat& grey, int bits) {
  const int first = bits == 4 ? cv::aruco::DICT_4X4_50 : bits == 5 ? cv::aruco::DICT_5X5_50 : cv::aruco::DICT_6X6_50;
  std::vector<std::vector<cv::Point2f>> corners;
  std::vector<int> ids;
  cv::aruco::detectMarkers(grey, cv::aruco::getPredefinedDictionary(first + 3), corners, ids);
  Markers markers;
  std::vector<int> twice;
  for (std::size_t i = 0; i < ids.size(); ++i)
    if (!markers.emplace(ids[i], Quad{corners[i][0], corners[i][1], corners[i][2], corners[i][3]}).second)
      twice.push_back(ids[i]);
  for (int id : twice) markers.erase(id);
  return markers;
}

float edge_px(const Quad& quad) {
  float least = std::numeric_limits<float>::max();
  for (int k = 0; k < 4; ++k) least = std::min(least, static_cast<float>(cv::norm(quad[k] - quad[(k + 1) % 4])));
  return least;
}

std::array<cv::Point2f, 4> corners_on_board(const Board& board, int id) {
  const Eigen::Vector2d c = board.marker_corner(id);
  const float x = static_cast<float>(c.x()), y = static_cast<float>(c.y()), e = static_cast<float>(board.marker);
  return {cv::Point2f(x, y), cv::Point2f(x + e, y), cv::Point2f(x + e, y + e), cv::Point2f(x, y + e)};
}

// How far the markers' corners are from a homography of the board, in edges of a marker: (id, distance).
std::vector<std::pair<int, double>> distances_from_plane(const Board& board, const Markers& markers) {
  std::vector<cv::Point2f> on_board, in_photo;
  std::vector<std::pair<int, double>> distances;
  for (const auto& [id, quad] : markers) {
    const auto known = corners_on_board(board, id);
    on_board.insert(on_board.end(), known.begin(), known.end());
    in_photo.insert(in_photo.end(), quad.begin(), quad.end());
  }
  const cv::Mat H = cv::findHomography(on_board, in_photo, cv::LMEDS);
  if (H.empty()) return distances;
  std::vector<cv::Point2f> mapped;
  cv::perspectiveTransform(on_board, mapped, H);
  std::size_t at = 0;
  for (const auto& [id, quad] : markers) {
    double worst = 0;
    for (int k = 0; k < 4; ++k, ++at) worst = std::max(worst, cv::norm(mapped[at] - quad[k]) / edge_px(quad));
    distances.emplace_back(id, worst);
  }
  return distances;
}

double median_distance(const Board& board, const Markers& markers) {
  auto distances = distances_from_plane(board, markers);
  if (distances.empty()) return std::numeric_limits<double>::infinity();
  std::sort(distances.begin(), distances.end(), [](const auto& a, const auto& b) { return a.second < b.second; });
  return distances[distances.size() / 2].second;
}

constexpr double kOffPlane = 0.5;  // edges of a marker: lenses bend less, wrong numbering more

// The number of columns that explains where the markers lie; 0 if none does.
int columns_seen(Board board, const Markers& markers) {
  int best = 0;
  double least = kOffPlane;
  const int last = markers.empty() ? 0 : markers.rbegin()->first;
  for (int columns = 3; columns <= 40; ++columns) {
    board.columns = columns;
    board.rows = 2 * (last / columns) + 4;
    const double distance = median_distance(board, markers);
    if (distance < least) least = distance, best = columns;
  }
  return best;
}

// Edge of the markers that explains best where they lie, in steps of 1/20 of the square.
double marker_seen(Board board, const Markers& markers) {
  double best = board.marker, least = std::numeric_limits<double>::infinity();
  for (int share = 8; share < 19; ++share) {
    board.marker = share * board.square / 20;
    std::vector<cv::Point2f> on_board, in_photo, mapped;
    for (const auto& [id, quad] : markers) {
      const auto known = corners_on_board(board, id);
      on_board.insert(on_board.end(), known.begin(), known.end());
      in_photo.insert(in_photo.end(), quad.begin(), quad.end());
    }
    const cv::Mat H = cv::findHomography(on_board, in_photo);
    if (H.empty()) continue;
    cv::perspectiveTransform(on_board, mapped, H);
    const double distance = cv::norm(mapped, in_photo);
    if (distance < least) least = distance, best = board.marker;
  }
  return best;
}

std::string other_grid(const Board& board, const Markers& markers) {
  const int columns = markers.size() >= 4 ? columns_seen(board, markers) : 0;
  if (columns == 0 || columns == board.columns)
    return fmt::format("{} markers were seen but they do not lie as on {}; is this another board?", markers.size(),
                       board.name());
  return fmt::format("another board size was found: the markers lie in {} columns, {} has {}; correct --board", columns,
                     board.name(), board.columns);
}

// Saddle point nearest to a prediction: where all gradients around it are seen edge-on (Foerstner & Guelch 1987;
// OpenCV's cornerSubPix). NaN where it is near the border or runs away.
Eigen::Vector2d refine(const cv::Mat& grey, const cv::Point2f& predicted, int half_window) {
  const auto inside = [&](const cv::Point2f& p) {
    return p.x > half_window + 1 && p.y > half_window + 1 && p.x < grey.cols - half_window - 2 &&
           p.y < grey.rows - half_window - 2;
  };
  if (!inside(predicted)) return {kNaN, kNaN};
  std::vector<cv::Point2f> point{predicted};
  cv::cornerSubPix(grey, point, {half_window, half_window}, {-1, -1},
                   {cv::TermCriteria::EPS | cv::TermCriteria::COUNT, 50, 1e-3});
  if (!inside(point[0]) || cv::norm(point[0] - predicted) > half_window) return {kNaN, kNaN};
  return {point[0].x, point[0].y};
}

// Points of the board that touch a marker, predicted from that marker alone: lenses bend little over one square.
struct Prediction {
  cv::Point2f sum{0, 0};
  int count = 0;
  float edge = std::numeric_limits<float>::max();  // px, of the smallest marker at it
};

std::vector<Prediction> predict(const Board& board, const Markers& markers) {
  std::vector<Prediction> predictions(board.points());
  const double reach = 0.75 * board.square;
  for (const auto& [id, quad] : markers) {
    const auto known = corners_on_board(board, id);
    const cv::Mat H = cv::getPerspectiveTransform(known.data(), quad.data());
    const Eigen::Vector2d centre = board.marker_corner(id) + Eigen::Vector2d::Constant(board.marker / 2);
    for (int i = 0; i < board.points(); ++i) {
      const Eigen::Vector2d x = board.point(i).head<2>();
      if ((x - centre).cwiseAbs().maxCoeff() > reach) continue;
      std::vector<cv::Point2f> at{cv::Point2f(static_cast<float>(x.x()), static_cast<float>(x.y()))}, mapped;
      cv::perspectiveTransform(at, mapped, H);
      predictions[i].sum += mapped[0];
      ++predictions[i].count;
      predictions[i].edge =
          std::min(predictions[i].edge, edge_px(quad) * static_cast<float>(board.square / board.marker));
    }
  }
  return predictions;
}

// Around a point only four quarters, two of them dark, are clean as far as the nearest markers.
int clean_half_window(const Board& board, float square_px) {
  const double margin = (board.square - board.marker) / 2 / board.square;
  return std::min(12, static_cast<int>(std::floor(margin * square_px)));
}

// Do the points hold a plane: at least four lie outside the fullest row, and outside the fullest column?
bool spans_plane(const Board& board, const std::vector<Eigen::Vector2d>& q) {
  std::vector<int> rows(board.grid_rows()), columns(board.grid_columns());
  int all = 0;
  for (int i = 0; i < board.points(); ++i) {
    if (!std::isfinite(q[i].x())) continue;
    ++rows[i / board.grid_columns()], ++columns[i % board.grid_columns()], ++all;
  }
  return all - *std::max_element(rows.begin(), rows.end()) >= 4 &&
         all - *std::max_element(columns.begin(), columns.end()) >= 4;
}

Detection from_markers(const cv::Mat& grey, const Board& board, Markers markers) {
  Detection result;
  result.q_px.assign(board.points(), {kNaN, kNaN});
  const std::size_t all = markers.size();
  std::erase_if(markers, [&](const auto& m) { return m.first >= board.markers(); });
  if (markers.size() < 2) {
    result.reason =
        all == 0 ? fmt::format("no marker of {} was seen; is the board in the picture, sharp and lit?", board.name())
                 : fmt::format("{} markers were seen, of which {} belong to {}; is this another board?", all,
                               markers.size(), board.name());
    return result;
  }
  const auto distances = distances_from_plane(board, markers);
  const double median = median_distance(board, markers);
  if (!(median < kOffPlane)) {
    result.reason = other_grid(board, markers);
    return result;
  }
  for (const auto& [id, distance] : distances)
    if (distance > 2 * kOffPlane) markers.erase(id);
  int small = 0;
  const auto predictions = predict(board, markers);
  for (int i = 0; i < board.points(); ++i) {
    const Prediction& p = predictions[i];
    if (p.count == 0) continue;
    const int half = clean_half_window(board, p.edge);
    if (half < 2) {
      ++small;
      continue;
    }
    result.q_px[i] = refine(grey, p.sum / p.count, half);
    result.seen += std::isfinite(result.q_px[i].x());
  }
  result.found = result.seen >= kLeastPoints && spans_plane(board, result.q_px);
  if (result.found) return result;
  if (small > result.seen)
    result.reason =
        "the markers are too small in the picture to place their corners (16 pixels a square are needed); go nearer";
  else if (result.seen >= kLeastPoints)
    result.reason =
        fmt::format("the {} points that were seen lie almost in a line; show more of the board", result.seen);
  else
    result.reason = fmt::format("only {} of {} points were seen, {} are needed; show more of the board", result.seen,
                                board.points(), kLeastPoints);
  return result;
}

constexpr int kFast = cv::CALIB_CB_NORMALIZE_IMAGE;  // refined below, hence without CALIB_CB_ACCURACY

// A chessboard of any size: columns, rows; {0, 0} if there is none.
std::array<int, 2> chessboard_size(const cv::Mat& grey) {
  std::vector<cv::Point2f> corners;
  cv::Mat meta;
  if (!cv::findChessboardCornersSB(grey, {3, 3}, corners,
                                   cv::CALIB_CB_NORMALIZE_IMAGE | cv::CALIB_CB_EXHAUSTIVE | cv::CALIB_CB_LARGER, meta))
    return {0, 0};
  return {meta.cols, meta.rows};
}

Detection find_chessboard(const cv::Mat& grey, const Board& board) {
  Detection result;
  result.q_px.assign(board.points(), {kNaN, kNaN});
  std::vector<cv::Point2f> corners;
  const cv::Size size(board.columns, board.rows);
  result.found = cv::findChessboardCornersSB(grey, size, corners, kFast) ||
                 cv::findChessboardCornersSB(grey, size, corners, kFast | cv::CALIB_CB_EXHAUSTIVE);
  if (!result.found) {
    const auto [columns, rows] = chessboard_size(grey);
    const bool same =
        (columns == board.columns && rows == board.rows) || (columns == board.rows && rows == board.columns);
    result.reason = columns && !same
                        ? fmt::format(
                              "another board size was found: {}x{} inner corners, not {}x{}; correct --board, or "
                              "show the whole board",
                              std::max(columns, rows), std::min(columns, rows), board.columns, board.rows)
                        : fmt::format(
                              "no chessboard of {}x{} inner corners was seen whole; are all squares in the picture, "
                              "sharp and lit, with a white margin?",
                              board.columns, board.rows);
    return result;
  }
  for (int i = 0; i < board.points(); ++i) {
    // Clean as far as the neighbours; 0.35 of the way leaves room for their blur.
    const int column = i % board.columns, next = column + 1 < board.columns ? i + 1 : i - 1;
    const int below = i + board.columns < board.points() ? i + board.columns : i - board.columns;
    const double edge = std::min(cv::norm(corners[i] - corners[next]), cv::norm(corners[i] - corners[below]));
    const Eigen::Vector2d refined = refine(grey, corners[i], std::clamp(static_cast<int>(0.35 * edge), 2, 12));
    result.q_px[i] = std::isfinite(refined.x()) ? refined : Eigen::Vector2d(corners[i].x, corners[i].y);
  }
  result.seen = board.points();
  return result;
}

}  // namespace

Detection detect_board(const Image& photo, const Board& board) {
  const Mask light = grey8(photo);
  const cv::Mat grey = view_of(light);
  if (board.kind == BoardKind::kChessboard) return find_chessboard(grey, board);
  if (board.kind == BoardKind::kAprilTag) return from_markers(grey, board, find_markers(light));
  return from_markers(grey, board, find_aruco(grey, board.marker_bits));
}

std::optional<Board> recognise_board(const Image& photo) {
  const Mask light = grey8(photo);
  const cv::Mat grey = view_of(light);
  Board best;
  Markers most = find_markers(light);
  for (int bits : {4, 5, 6}) {
    const Markers markers = find_aruco(grey, bits);
    if (markers.size() <= most.size()) continue;
    most = markers;
    best.kind = BoardKind::kCharuco, best.marker_bits = bits;
  }
  if (most.size() >= 4) {
    best.columns = columns_seen(best, most);
    if (best.columns == 0) return std::nullopt;
    const int last = most.rbegin()->first, rest = last % best.columns;
    best.rows = std::max(3, 2 * (last / best.columns) + (rest >= best.columns / 2 ? 2 : 1));
    if (best.kind == BoardKind::kCharuco) best.marker = marker_seen(best, most);
    return best;
  }
  best = {};
  best.kind = BoardKind::kChessboard;
  const auto [columns, rows] = chessboard_size(grey);
  if (columns == 0) return std::nullopt;
  best.columns = std::max(columns, rows), best.rows = std::min(columns, rows);
  return best;
}

}  // namespace countershade::capture
