#include "solver/fit/lens/lens_fit.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <opencv2/calib3d.hpp>

#include "solver/fit/lens/lens_parts.h"

namespace countershade::solver {

namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr int kOutlierRounds = 10;
const char* const kAlike =
    "the views are too much alike: add views with the board in other parts of the picture, tilted by about 30 to 45 "
    "degrees";

std::array<double, 6> array_of(const Pose& pose) {
  const Eigen::Vector3d r = vector_from_rotation(pose.rotation);
  const Eigen::Vector3d& t = pose.translation;
  return {r.x(), r.y(), r.z(), t.x(), t.y(), t.z()};
}

Pose pose_of(const std::array<double, 6>& a) {
  return {rotation_from_vector({a[0], a[1], a[2]}), {a[3], a[4], a[5]}};
}

bool seen(const Eigen::Vector2d& q) {
  return std::isfinite(q.x()) && std::isfinite(q.y());
}

bool is_splined(const std::string& model) {
  return model.starts_with("LENSMODEL_SPLINED_STEREOGRAPHIC");
}

struct Pairs {
  std::vector<cv::Point3d> on_board;
  std::vector<cv::Point2d> in_photo;
};

Pairs pairs_of(const Board& board, const BoardView& view, const std::vector<bool>& use) {
  Pairs pairs;
  for (int i = 0; i < board.points(); ++i) {
    if (!seen(view[i]) || (!use.empty() && !use[i])) continue;
    const Eigen::Vector3d x = board.point(i);
    pairs.on_board.emplace_back(x.x(), x.y(), x.z());
    pairs.in_photo.emplace_back(view[i].x(), view[i].y());
  }
  return pairs;
}

struct PinholePose {
  Pose pose;
  double rms = std::numeric_limits<double>::infinity();
};

// Pose of a plane for a pinhole camera with the principal point in the middle of the picture.
PinholePose pinhole_pose(const Pairs& pairs, double focal, int width, int height) {
  PinholePose result;
  if (pairs.on_board.size() < 4) return result;
  const cv::Matx33d K(focal, 0, (width - 1) / 2.0, 0, focal, (height - 1) / 2.0, 0, 0, 1);
  std::vector<cv::Mat> rotations, translations;
  cv::Mat errors;
  try {
    cv::solvePnPGeneric(pairs.on_board, pairs.in_photo, K, cv::noArray(), rotations, translations, false,
                        cv::SOLVEPNP_IPPE, cv::noArray(), cv::noArray(), errors);
  } catch (const cv::Exception&) {  // points in a line
    return result;
  }
  for (int i = 0; i < static_cast<int>(rotations.size()); ++i) {
    const cv::Vec3d r = rotations[i], t = translations[i];
    std::vector<cv::Point2d> projected;
    cv::projectPoints(pairs.on_board, r, t, K, cv::noArray(), projected);
    double squares = 0;
    for (std::size_t k = 0; k < projected.size(); ++k) {
      const cv::Point2d off = projected[k] - pairs.in_photo[k];
      squares += off.dot(off);
    }
    const double rms = std::sqrt(squares / static_cast<double>(projected.size()));
    if (!(rms < result.rms) || !(t[2] > 0)) continue;
    result.rms = rms;
    result.pose = {rotation_from_vector({r[0], r[1], r[2]}), {t[0], t[1], t[2]}};
  }
  return result;
}

// Starts with focal lengths in coarse steps, those with which planes of all views fit best first.
Result<std::vector<LensFit>> starts_of(const BoardViews& data) {
  std::vector<Pairs> pairs;
  for (const BoardView& view : data.views) pairs.push_back(pairs_of(data.board, view, {}));
  std::vector<std::pair<double, LensFit>> starts;
  for (double focal = 0.3 * data.width; focal < 12 * data.width; focal *= 1.15) {
    LensFit start;
    double sum = 0;
    for (const Pairs& p : pairs) {
      const PinholePose found = pinhole_pose(p, focal, data.width, data.height);
      sum += found.rms;
      start.camera_from_board.push_back(found.pose);
    }
    if (!std::isfinite(sum)) continue;
    start.lens = Lens::pinhole(focal, (data.width - 1) / 2.0, (data.height - 1) / 2.0, data.width, data.height);
    starts.emplace_back(sum, start);
  }
  if (starts.empty())
    return error(
        ErrorCode::kRefused,
        "the points of a view lie on a line or are too few for a pose; at least 4 that span a plane are needed");
  std::stable_sort(starts.begin(), starts.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
  std::vector<LensFit> sorted;
  for (auto& [sum, start] : starts) {
    for (const BoardView& view : data.views) {
      start.used.emplace_back();
      for (const Eigen::Vector2d& q : view) start.used.back().push_back(seen(q));
    }
    sorted.push_back(std::move(start));
  }
  return sorted;
}

// Control points of a spline that bends as `lens` does: linear least squares over a grid of pixels, with a small pull
// to no bending where nothing is seen.
std::vector<double> splined_intrinsics(const std::string& model, const Lens& lens) {
  std::vector<double> intrinsics(lens_parts::parameters(model), 0.0);
  std::copy_n(lens.intrinsics().begin(), 4, intrinsics.begin());
  const int n = static_cast<int>(intrinsics.size()) - 4;
  Eigen::MatrixXd N = 1e-3 * Eigen::MatrixXd::Identity(n, n);
  Eigen::VectorXd rhs = Eigen::VectorXd::Zero(n);
  constexpr int kSteps = 32;
  for (int j = 0; j <= kSteps; ++j)
    for (int i = 0; i <= kSteps; ++i) {
      const Eigen::Vector2d q(i * (lens.width() - 1.0) / kSteps, j * (lens.height() - 1.0) / kSteps);
      const Eigen::Vector3d ray = lens.unproject(q);
      if (!ray.allFinite()) continue;
      const lens_parts::Projection p = lens_parts::project(model, intrinsics, ray);
      const Eigen::MatrixXd J = p.by_intrinsics.rightCols(n) / intrinsics[0];
      N += J.transpose() * J;
      rhs += J.transpose() * (q - p.q) / intrinsics[0];
    }
  const Eigen::VectorXd control = N.ldlt().solve(rhs);
  for (int i = 0; i < n; ++i) intrinsics[4 + i] = control[i];
  return intrinsics;
}

// Parameters with which `model` begins where `lens` is. The OpenCV models begin with those of the smaller ones.
std::vector<double> begin_as(const std::string& model, const Lens& lens) {
  if (is_splined(model)) return is_splined(lens.model()) ? lens.intrinsics() : splined_intrinsics(model, lens);
  std::vector<double> intrinsics = lens.intrinsics();
  intrinsics.resize(lens_parts::parameters(model), 0.0);
  return intrinsics;
}

void add_residuals(const BoardViews& data, const lens_parts::Problem& problem, LensFit& fit) {
  const lens_parts::Linearisation l = lens_parts::linearise(problem);
  const int points = data.board.points();
  fit.used.assign(data.views.size(), std::vector<bool>(points, false));
  fit.residual_px.assign(data.views.size(), BoardView(points, {kNaN, kNaN}));
  for (std::size_t v = 0; v < data.views.size(); ++v)
    for (int i = 0; i < points; ++i) {
      const std::size_t at = v * points + i;
      if (!(problem.observations[at][2] >= 0)) {
        fit.outliers += seen(data.views[v][i]);
        continue;
      }
      fit.used[v][i] = true;
      fit.residual_px[v][i] = {l.x[2 * at], l.x[2 * at + 1]};
      fit.squares += fit.residual_px[v][i].squaredNorm();
    }
  fit.observations = l.used;
  const Eigen::LLT<Eigen::MatrixXd> N(l.N);
  const double adapted = N.info() == Eigen::Success ? N.solve(l.N_board).trace() : l.states;
  fit.freedom = std::max(1.0, l.used - adapted);
  fit.rms_px = std::sqrt(fit.squares / std::max(1, l.used));
  fit.sigma_px = std::sqrt(fit.squares / fit.freedom);
}

// Takes out points that are farther from the model than kOutlierSigma times the rms of all that count (noise in two
// coordinates exceeds it once in 25,000 points); how many. By rms, as mrcal does: real points have longer tails than
// noise, and a bound by their median would throw the tails out and call the rest more precise than it is.
int leave_out_outliers(lens_parts::Problem& problem) {
  constexpr double kOutlierSigma = 4.5;
  const lens_parts::Linearisation l = lens_parts::linearise(problem);
  double squares = 0;
  for (int i = 0; i < l.board_measurements; ++i) squares += l.x[i] * l.x[i];
  const double bound = kOutlierSigma * std::sqrt(squares / std::max(1, l.used));
  int outliers = 0;
  for (std::size_t i = 0; i < problem.observations.size(); ++i)
    if (problem.observations[i][2] >= 0 && std::hypot(l.x[2 * i], l.x[2 * i + 1]) > bound) {
      problem.observations[i] = {0, 0, -1};
      ++outliers;
    }
  return outliers;
}

Result<LensFit> fit_from(const BoardViews& data, const LensFit& start, const std::string& model, bool find_outliers) {
  LensFit begin = start;
  CS_TRY(begin.lens, Lens::make(model, begin_as(model, start.lens), data.width, data.height));
  lens_parts::Problem problem = lens_parts::problem_of(data, begin);
  bool ends = lens_parts::optimise(problem);
  for (int round = 0; ends && find_outliers && round < kOutlierRounds; ++round) {
    if (leave_out_outliers(problem) == 0) break;
    ends = lens_parts::optimise(problem);
  }
  if (!ends)
    return error(ErrorCode::kRefused, "the fit of {} to {} views finds no end; {}", model, data.views.size(), kAlike);
  LensFit fit;
  Result<Lens> lens = Lens::make(model, problem.intrinsics, data.width, data.height);
  if (!lens)
    return error(ErrorCode::kRefused, "the fit to {} views ends at no lens ({}); {}", data.views.size(),
                 lens.error().message, kAlike);
  fit.lens = *lens;
  for (const auto& pose : problem.poses) fit.camera_from_board.push_back(pose_of(pose));
  add_residuals(data, problem, fit);
  return fit;
}

// First the focal length and the poses alone, then a distortion that does not swing: a start that is far off would be
// explained by any distortion.
Result<LensFit> climb_to(const BoardViews& data, LensFit fit, const LensFitOptions& options) {
  for (const char* model : {"LENSMODEL_PINHOLE", "LENSMODEL_OPENCV4"}) {
    if (options.model == model) break;
    CS_TRY(fit, fit_from(data, fit, model, false));
  }
  return fit_from(data, fit, options.model, options.find_outliers);
}

}  // namespace

lens_parts::Problem lens_parts::problem_of(const BoardViews& data, const LensFit& fit) {
  Problem p;
  p.model = fit.lens.model();
  p.intrinsics = fit.lens.intrinsics();
  for (const Pose& pose : fit.camera_from_board) p.poses.push_back(array_of(pose));
  p.columns = data.board.grid_columns(), p.rows = data.board.grid_rows();
  p.width = data.width, p.height = data.height;
  p.spacing = data.board.square;
  p.core_moves = !is_splined(p.model);
  p.regularised = is_splined(p.model) || p.intrinsics.size() > 9;  // rational: numerator and denominator may cancel
  for (std::size_t v = 0; v < data.views.size(); ++v)
    for (int i = 0; i < data.board.points(); ++i) {
      const Eigen::Vector2d& q = data.views[v][i];
      if (fit.used[v][i])
        p.observations.push_back({q.x(), q.y(), 1});
      else
        p.observations.push_back({0, 0, -1});
    }
  return p;
}

Result<LensFit> fit_lens(const BoardViews& data, const LensFitOptions& options) {
  if (data.views.size() < 2)
    return error(ErrorCode::kRefused, "{} views of the board; a lens needs at least 2", data.views.size());
  if (options.start) return fit_from(data, *options.start, options.model, options.find_outliers);
  CS_TRY(const std::vector<LensFit> starts, starts_of(data));
  Result<LensFit> fit = starts.front();
  for (std::size_t i = 0; i < starts.size(); i += 3) {  // a bad start may run away: then one that differs by half
    fit = climb_to(data, starts[i], options);
    if (fit) break;
  }
  return fit;
}

std::optional<Pose> fit_pose(const BoardViews& data, const BoardView& view, const Lens& lens,
                             const std::vector<bool>& use) {
  // Seen by a pinhole camera of focal length 1 whose pixels are directions: the lens is taken out.
  Pairs pairs = pairs_of(data.board, view, use);
  for (cv::Point2d& q : pairs.in_photo) {
    const Eigen::Vector3d ray = lens.unproject({q.x, q.y});
    if (!(ray.z() > 0)) return std::nullopt;
    q = {ray.x() / ray.z(), ray.y() / ray.z()};
  }
  const PinholePose start = pinhole_pose(pairs, 1, 1, 1);
  if (!std::isfinite(start.rms)) return std::nullopt;
  BoardViews one = data;
  one.views = {view};
  LensFit fit;
  fit.lens = lens;
  fit.camera_from_board = {start.pose};
  fit.used.resize(1);
  for (int i = 0; i < data.board.points(); ++i) fit.used[0].push_back(seen(view[i]) && (use.empty() || use[i]));
  lens_parts::Problem problem = lens_parts::problem_of(one, fit);
  problem.lens_moves = false;
  if (!lens_parts::optimise(problem)) return std::nullopt;
  return pose_of(problem.poses[0]);
}

std::string splined_model(const Lens& lens, int columns) {
  // The widest angles at the picture's border, on the stereographic plane u = 2 tan(angle / 2) on which the knots lie.
  Eigen::Vector2d widest(0, 0);
  for (int side = 0; side < 4; ++side)
    for (int i = 0; i <= 16; ++i) {
      const double w = lens.width() - 1, h = lens.height() - 1, t = i / 16.0;
      const Eigen::Vector2d q = side == 0   ? Eigen::Vector2d(t * w, 0)
                                : side == 1 ? Eigen::Vector2d(t * w, h)
                                : side == 2 ? Eigen::Vector2d(0, t * h)
                                            : Eigen::Vector2d(w, t * h);
      const Eigen::Vector3d ray = lens.unproject(q);
      if (!ray.allFinite()) continue;
      widest = widest.cwiseMax((2 * ray.head<2>() / (1 + ray.z())).cwiseAbs());
    }
  // An odd knot more on each side: a cubic segment needs one beyond either end.
  const int fov =
      std::clamp(static_cast<int>(std::ceil(4 * std::atan(widest.x() / 2) * 180 / std::numbers::pi * 1.05)), 2, 300);
  const int rows = std::max(5, 3 + static_cast<int>(std::ceil((columns - 3) * widest.y() / widest.x())));
  return fmt::format("LENSMODEL_SPLINED_STEREOGRAPHIC_order=3_Nx={}_Ny={}_fov_x_deg={}", columns, rows, fov);
}

BoardViews subset(const BoardViews& data, const std::vector<int>& views) {
  BoardViews some{data.board, data.width, data.height, {}};
  for (int v : views) some.views.push_back(data.views[v]);
  return some;
}

LensFit subset(const LensFit& fit, const std::vector<int>& views) {
  LensFit some;
  some.lens = fit.lens;
  for (int v : views) {
    some.camera_from_board.push_back(fit.camera_from_board[v]);
    some.used.push_back(fit.used[v]);
  }
  return some;
}

}  // namespace countershade::solver
