#include "solver/fit/lens/views.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <set>

namespace countershade::solver {

namespace {

constexpr double kAlike = 0.01;         // of the picture's diagonal
constexpr int kColumns = 8, kRows = 6;  // cells of the picture
constexpr double kTilted = 20;          // degrees that tell the focal length from the distance
constexpr int kTiltedViews = 3;
const char* const kHowToTilt = "tilted by about 30 to 45 degrees";

// Rms distance of the points that both views show [px]; infinite if there are none.
double distance_between(const BoardView& a, const BoardView& b) {
  double squares = 0;
  int count = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    const double square = (a[i] - b[i]).squaredNorm();
    if (!std::isfinite(square)) continue;
    squares += square;
    ++count;
  }
  return count ? std::sqrt(squares / count) : HUGE_VAL;
}

std::vector<int> points_per_cell(const BoardViews& data) {
  std::vector<int> cells(kColumns * kRows);
  for (const BoardView& view : data.views)
    for (const Eigen::Vector2d& q : view) {
      if (!std::isfinite(q.x())) continue;
      const int i = std::clamp(static_cast<int>((q.x() + 0.5) / data.width * kColumns), 0, kColumns - 1);
      const int j = std::clamp(static_cast<int>((q.y() + 0.5) / data.height * kRows), 0, kRows - 1);
      ++cells[j * kColumns + i];
    }
  return cells;
}

// Corners (2 x 2 cells) and edges (the outermost cells between them) of the picture without a point.
std::vector<std::string> empty_zones(const std::vector<int>& cells) {
  struct Zone {
    const char* name;
    int left, top, right, bottom;  // cells, right and bottom not included
  };
  const Zone zones[] = {{"upper left corner", 0, 0, 2, 2},
                        {"upper right corner", kColumns - 2, 0, kColumns, 2},
                        {"lower left corner", 0, kRows - 2, 2, kRows},
                        {"lower right corner", kColumns - 2, kRows - 2, kColumns, kRows},
                        {"left edge", 0, 2, 1, kRows - 2},
                        {"right edge", kColumns - 1, 2, kColumns, kRows - 2},
                        {"upper edge", 2, 0, kColumns - 2, 1},
                        {"lower edge", 2, kRows - 1, kColumns - 2, kRows}};
  std::vector<std::string> empty;
  for (const Zone& z : zones) {
    int points = 0;
    for (int j = z.top; j < z.bottom; ++j)
      for (int i = z.left; i < z.right; ++i) points += cells[j * kColumns + i];
    if (points == 0) empty.emplace_back(z.name);
  }
  return empty;
}

// Which tilts are missing. tilts: of each view, the board's normal seen from the line of sight (x right, y down; its
// length is the sine).
std::vector<std::string> missing_tilts(const std::vector<Eigen::Vector2d>& tilts) {
  const double least = std::sin(kTilted * std::numbers::pi / 180);
  int tilted = 0, turned = 0, nodded = 0;
  for (const Eigen::Vector2d& t : tilts) {
    tilted += t.norm() > least;
    turned += std::abs(t.x()) > least / 2;
    nodded += std::abs(t.y()) > least / 2;
  }
  std::vector<std::string> missing;
  if (tilted < kTiltedViews)
    missing.push_back(fmt::format(
        "add {} more view{} with the board {}: {} of {} are by more than {:g}; facing the camera, a near board looks "
        "like a long lens",
        kTiltedViews - tilted, kTiltedViews - tilted == 1 ? "" : "s", kHowToTilt, tilted, tilts.size(), kTilted));
  else if (turned == 0)
    missing.push_back(fmt::format("add a view with the board turned to the left or right, {}", kHowToTilt));
  else if (nodded == 0)
    missing.push_back(
        fmt::format("add a view with the board's upper edge away from or towards the camera, {}", kHowToTilt));
  return missing;
}

}  // namespace

std::vector<int> group_alike(const BoardViews& data) {
  const double bound = kAlike * std::hypot(data.width, data.height);
  std::vector<int> group(data.views.size());
  for (std::size_t i = 0; i < group.size(); ++i) {
    group[i] = static_cast<int>(i);
    for (std::size_t j = 0; j < i; ++j)
      if (distance_between(data.views[i], data.views[j]) < bound) {
        group[i] = group[j];
        break;
      }
  }
  return group;
}

ViewSummary summarise(const BoardViews& data, const LensFit& fit) {
  ViewSummary summary;
  const Eigen::Vector3d centre = data.board.point(data.board.points() - 1) / 2;
  std::vector<Eigen::Vector2d> tilts;
  for (const Pose& pose : fit.camera_from_board) {
    const Eigen::Vector3d middle = pose * centre;
    const Eigen::Vector3d normal = pose.rotation.col(2), sight = middle.normalized();
    // What remains of the normal across the line of sight.
    const Eigen::Vector3d across = normal - normal.dot(sight) * sight;
    tilts.emplace_back(across.head<2>());
    summary.tilt_deg.push_back(std::asin(std::min(1.0, across.norm())) * 180 / std::numbers::pi);
    summary.distance_m.push_back(middle.norm());
  }
  const std::vector<int> cells = points_per_cell(data);
  summary.covered = static_cast<double>(std::count_if(cells.begin(), cells.end(), [](int n) { return n > 0; })) /
                    static_cast<double>(cells.size());
  summary.advice = missing_tilts(tilts);
  for (const std::string& zone : empty_zones(cells))
    summary.advice.push_back(fmt::format("add a view with the board {} the {} of the picture, {}",
                                         zone.ends_with("corner") ? "in" : "at", zone, kHowToTilt));
  return summary;
}

Result<void> check_enough(const std::vector<int>& group) {
  const std::set<int> distinct(group.begin(), group.end());
  if (distinct.size() >= kLeastViews) return {};
  const std::string alike =
      distinct.size() < group.size()
          ? fmt::format(" (of {} views with a board; the others repeat one within 1 % of the picture)", group.size())
          : "";
  const std::size_t missing = kLeastViews - distinct.size();
  return error(
      ErrorCode::kRefused,
      "{} views of the board that differ{}, at least {} are needed: each gives two numbers for the lens beyond "
      "the board's own pose, focal lengths and principal point take four; add {}, the board in another "
      "corner of the picture each time and {}",
      distinct.size(), alike, kLeastViews, missing == 1 ? "a view" : fmt::format("{} views", missing), kHowToTilt);
}

Result<void> check_held(const LensUncertainty& uncertainty, const ViewSummary& views) {
  const double sigma = uncertainty.focal_sigma();
  if (sigma <= kWorstFocalSigma) return {};
  const std::string known = std::isfinite(sigma) ? fmt::format("uncertain by {:.1f} %", 100 * sigma) : "unknown";
  const auto [least, most] = std::minmax_element(views.tilt_deg.begin(), views.tilt_deg.end());
  return error(
      ErrorCode::kRefused,
      "the views are too much alike: they leave the focal length uncertain by {:.1f} % (one sigma; at most {:g} "
      "%); the board is tilted by {:.0f} to {:.0f} degrees; {}",
      100 * sigma, 100 * kWorstFocalSigma, *least, *most,
      views.advice.empty() ? "add nearer views, tilted by 30 to 45 degrees" : views.advice.front());
}

}  // namespace countershade::solver
