// lens: does a calibrated lens know how wrong it is, and is it as good as OpenCV's on photographs somebody else took.
#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <numeric>
#include <opencv2/calib3d.hpp>

#include "calib/base/parallel.h"
#include "calib/base/random.h"
#include "calib/file/session.h"
#include "calib/image/image_file.h"
#include "capture/board/detect.h"
#include "simdata/render/board_photo.h"
#include "solver/fit/lens/ladder.h"
#include "solver/fit/lens/model_file.h"
#include "solver/fit/lens/uncertainty.h"
#include "tools/bench/study.h"

namespace countershade::bench {

namespace {

namespace fs = std::filesystem;
using solver::BoardViews;
using solver::LensFit;
using solver::LensUncertainty;

constexpr double kOneSigma = 39.35, kTwoSigma = 86.47;  // % of a two-dimensional Gaussian: 1 - exp(-1/2), 1 - exp(-2)
constexpr double kBound = 5;                            // points

enum class Way { kFixed, kLadder, kPhotos };

struct LensRig {
  std::string name;
  std::string model;  // of the true lens, and fitted
  int views = 10;
  std::string board = "chessboard:9x7:20mm";
  Way way = Way::kFixed;
  int trials = 400;  // the pixels of one trial err together: a share has a sigma of about 2 points
  double most_tilt = 0.8;
};

// Coefficients as cameras with a field of view of 45 to 75 degrees have them.
Lens random_lens(const std::string& model, Random& random) {
  const double f = random.uniform(430, 780);
  std::vector<double> p = {f, f * random.uniform(0.99, 1.01), 319.5 + random.uniform(-15, 15),
                           239.5 + random.uniform(-15, 15)};
  const double strong = std::pow(f / 520, 2);  // narrow lenses have as much distortion within the picture
  const double more[] = {strong * random.uniform(-0.25, 0.05), strong * random.uniform(0, 0.1),
                         random.uniform(-0.002, 0.002), random.uniform(-0.002, 0.002), random.uniform(-0.03, 0.03)};
  const std::size_t count = model == "LENSMODEL_PINHOLE" ? 0 : model == "LENSMODEL_OPENCV4" ? 4 : 5;
  p.insert(p.end(), more, more + count);
  return Lens::make(model, p, 640, 480).value();
}

struct Trial {
  int inside[2][2] = {{0, 0}, {0, 0}};  // near or far, one or two sigma
  int points = 0;
  bool fitted = false;
};

// Where a point that the boards hold where they truly stood is seen by the fit.
Eigen::Vector2d seen_through(const std::vector<Pose>& truth, const LensFit& fit, const Eigen::Vector3d& x, bool far) {
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (std::size_t f = 0; f < truth.size(); ++f) {
    Pose from = truth[f], to = fit.camera_from_board[f];
    if (far) from.translation.setZero(), to.translation.setZero();
    mean += to * (from.inverse() * x) / static_cast<double>(truth.size());
  }
  return fit.lens.project(mean);
}

Result<LensFit> fit_of(const LensRig& rig, const BoardViews& data) {
  if (rig.way != Way::kLadder)
    return solver::fit_lens(data, {.model = rig.model, .start = nullptr, .find_outliers = rig.way == Way::kPhotos});
  std::vector<int> group(data.views.size());
  std::iota(group.begin(), group.end(), 0);
  SilentProgress progress;
  solver::LadderOptions options;
  options.splined = false;
  CS_TRY(const solver::LensChoice choice, solver::choose_lens(data, group, options, progress));
  return choice.rung().fit;
}

// The view of one pose, by noise in the points or in the pixels of a photo.
solver::BoardView view_of(const Board& board, const Lens& lens, const Pose& pose, double sigma,
                          const simdata::BoardCamera* camera, Random& random) {
  if (!camera) return simdata::seen_points(board, lens, pose, sigma, random);
  simdata::BoardPhotoOptions options;
  options.noise = sigma / 10;
  return capture::detect_board(camera->photo(BoardPattern(board), pose, options, random), board).q_px;
}

Trial run_trial(const LensRig& rig, int index) {
  Random random(mix(hash_name("lens") ^ hash_name(rig.name)) + 1000003ull * index);
  const Board board = parse_board(rig.board).value();
  const Lens lens = random_lens(rig.model, random);
  const double sigma = std::exp(random.uniform(std::log(0.03), std::log(0.5)));
  std::optional<simdata::BoardCamera> camera;
  if (rig.way == Way::kPhotos) camera.emplace(lens);
  BoardViews data{board, 640, 480, {}};
  std::vector<Pose> poses;
  for (int v = 0; v < rig.views; ++v) {
    const Pose pose = simdata::board_pose(board, lens, 0.6, rig.most_tilt, random);
    const auto view = view_of(board, lens, pose, sigma, camera ? &*camera : nullptr, random);
    if (std::none_of(view.begin(), view.end(), [](const auto& q) { return std::isfinite(q.x()); })) continue;
    // A chessboard of odd counts is seen either way up.
    Pose numbered = pose;
    if (rig.way == Way::kPhotos && board.kind == BoardKind::kChessboard &&
        (lens.project(pose * board.point(0)) - view[0]).norm() > 20) {
      numbered.translation = pose * board.point(board.points() - 1);
      numbered.rotation.leftCols<2>() *= -1;
    }
    poses.push_back(numbered);
    data.views.push_back(view);
  }
  Trial trial;
  const Result<LensFit> fit = fit_of(rig, data);
  if (!fit) return trial;
  trial.fitted = true;
  const LensUncertainty uncertainty(data, *fit);
  for (const Eigen::Vector2d& q : solver::pixel_grid(640, 480, 7, 5)) {
    ++trial.points;
    for (int far = 0; far < 2; ++far) {
      const Eigen::Vector3d x = lens.unproject(q) * (far ? 1 : poses[0].translation.norm());
      const Eigen::Vector2d found = seen_through(poses, *fit, x, far == 1);
      const double square = (found - q).dot(
          uncertainty.covariance(found, far ? LensUncertainty::kInfinity : x.norm()).inverse() * (found - q));
      trial.inside[far][0] += square < 1;
      trial.inside[far][1] += square < 4;
    }
  }
  return trial;
}

struct Coverage {
  double least[2] = {100, 100}, most[2] = {0, 0};  // one and two sigma, of all rigs, near and far
  int trials = 0;
  bool ok = true;
};

void run_rig(const LensRig& rig, Study& study, Coverage& all, Progress& progress) {
  std::vector<Trial> trials(rig.trials);
  std::atomic<int> done = 0;
  progress.step("lens: " + rig.name, 0, rig.trials);
  parallel_for(rig.trials, [&](int i) {
    trials[i] = run_trial(rig, i);
    progress.step("lens: " + rig.name, ++done, rig.trials);
  });
  Trial sum;
  int fitted = 0;
  for (const Trial& t : trials) {
    fitted += t.fitted;
    sum.points += t.points;
    for (int k = 0; k < 4; ++k) sum.inside[k / 2][k % 2] += t.inside[k / 2][k % 2];
  }
  std::vector<std::string> row = {rig.name, fmt::format("{}", rig.trials), fmt::format("{}", rig.trials - fitted)};
  for (int far = 0; far < 2; ++far)
    for (int k = 0; k < 2; ++k) {
      const double share = 100.0 * sum.inside[far][k] / std::max(1, sum.points);
      row.push_back(fmt::format("{:.1f}", share));
      all.least[k] = std::min(all.least[k], share), all.most[k] = std::max(all.most[k], share);
      all.ok = all.ok && std::abs(share - (k ? kTwoSigma : kOneSigma)) <= kBound;
    }
  all.trials += rig.trials;
  row.insert(row.end(), {"", ""});
  study.rows.push_back(row);
}

// --- mrcal in Python ----------------------------------------------------------------------------------------------

// Largest relative difference of a covariance from that which Python's mrcal computes from the file that we wrote;
// nothing where it is not installed.
Result<std::optional<double>> difference_from_python(const fs::path& scratch) {
  if (std::system("/usr/bin/python3 -c 'import mrcal' >/dev/null 2>&1") != 0) return std::optional<double>();
  std::ofstream(scratch / "check.py")
      << "import sys, numpy, mrcal\n"
         "m = mrcal.cameramodel(sys.argv[1])\n"
         "for i in range(20):\n"
         "  q = numpy.array((639. * (i % 5) / 4, 479. * (i // 5) / 3))\n"
         "  for far in (False, True):\n"
         "    v = mrcal.unproject(q, *m.intrinsics(), normalize = True) * (1 if far else .3)\n"
         "    C = mrcal.projection_uncertainty(v, m, atinfinity = far, what = 'covariance', observed_pixel_uncertainty "
         "= "
         "float(sys.argv[2]))\n"
         "    print(C[0, 0], C[0, 1], C[1, 1])\n";
  double worst = 0;
  for (int i = 0; i < 3; ++i) {
    Random random(hash_name("lens python") + i);
    const Lens lens = random_lens("LENSMODEL_OPENCV5", random);
    BoardViews data{parse_board("chessboard:9x7:20mm").value(), 640, 480, {}};
    for (int v = 0; v < 10; ++v)
      data.views.push_back(
          simdata::seen_points(data.board, lens, simdata::board_pose(data.board, lens, 0.6, 0.8, random), 0.2, random));
    CS_TRY(LensFit fit, solver::fit_lens(data, {}));
    if (i == 2) {
      const LensFit brown = fit;
      CS_TRY(fit, solver::fit_lens(data, {.model = solver::splined_model(brown.lens, 9), .start = &brown}));
    }
    CS_TRY_VOID(solver::write_fitted_cameramodel(scratch / "camera.cameramodel", data, fit));
    const std::string command = fmt::format("/usr/bin/python3 {0}/check.py {0}/camera.cameramodel {1:.17g} > {0}/said",
                                            scratch.string(), fit.sigma_px);
    if (std::system(command.c_str()) != 0)
      return error(ErrorCode::kBadFile, "Python's mrcal cannot read '{}'", (scratch / "camera.cameramodel").string());
    const LensUncertainty uncertainty(data, fit);
    std::ifstream said(scratch / "said");
    for (const Eigen::Vector2d& q : solver::pixel_grid(640, 480, 5, 4))
      for (double distance : {0.3, LensUncertainty::kInfinity}) {
        const Eigen::Matrix2d ours = uncertainty.covariance(q, distance);
        Eigen::Matrix2d theirs;
        said >> theirs(0, 0) >> theirs(0, 1) >> theirs(1, 1);
        theirs(1, 0) = theirs(0, 1);
        worst = std::max(worst, (ours - theirs).norm() / theirs.norm());
      }
  }
  return std::optional<double>(worst);
}

// --- the real board -----------------------------------------------------------------------------------------------

Result<BoardViews> real_views(const fs::path& data) {
  CS_TRY(const Sequence sequence, read_sequence(data / "sequence.json"));
  int white = -1;
  for (const Frame& frame : sequence.frames)
    if (frame.role.kind == "white") white = frame.index;
  BoardViews views{parse_board("chessboard:9x7:75mm").value(), 0, 0, {}};
  for (int pose = 0; pose < 5; ++pose) {
    CS_TRY(const StoredImage photo,
           read_image(data / fmt::format("pose_{}", pose) / "photos" / fmt::format("{:04}.png", white)));
    views.width = photo.values.width(), views.height = photo.values.height();
    const capture::Detection found = capture::detect_board(photo.values, views.board);
    if (!found.found) return error(ErrorCode::kRefused, "pose {}: {}", pose, found.reason);
    views.views.push_back(found.q_px);
  }
  return views;
}

// OpenCV's calibrateCamera with its five coefficients on the same points.
Lens opencv_lens(const BoardViews& data) {
  std::vector<std::vector<cv::Point3f>> on_board;
  std::vector<std::vector<cv::Point2f>> in_photo;
  for (const auto& view : data.views) {
    on_board.emplace_back();
    in_photo.emplace_back();
    for (int i = 0; i < data.board.points(); ++i) {
      const Eigen::Vector3f x = data.board.point(i).cast<float>();
      on_board.back().emplace_back(x.x(), x.y(), x.z());
      in_photo.back().emplace_back(static_cast<float>(view[i].x()), static_cast<float>(view[i].y()));
    }
  }
  cv::Mat K, distortion;
  std::vector<cv::Mat> r, t;
  cv::calibrateCamera(on_board, in_photo, {data.width, data.height}, K, distortion, r, t);
  const cv::Mat k = distortion.reshape(1, 1);
  std::vector<double> p = {K.at<double>(0, 0), K.at<double>(1, 1), K.at<double>(0, 2), K.at<double>(1, 2)};
  for (int i = 0; i < 5; ++i) p.push_back(k.at<double>(i));
  return Lens::make("LENSMODEL_OPENCV5", p, data.width, data.height).value();
}

struct RealBoard {
  double ours = 0, opencv = 0;  // held-out error, px rms of a coordinate
};

// Each pose predicted by lenses that the other four give.
Result<RealBoard> run_real(const BoardViews& data, Study& study, Progress& progress) {
  std::vector<int> group(data.views.size());
  std::iota(group.begin(), group.end(), 0);
  CS_TRY(const solver::LensChoice choice, solver::choose_lens(data, group, {}, progress));
  study.notes.push_back("graycode-board: " + choice.reason);
  const std::vector<bool> all(data.board.points(), true);
  RealBoard result;
  double low = HUGE_VAL, high = 0;
  for (int out = 0; out < 5; ++out) {
    std::vector<int> rest;
    for (int v = 0; v < 5; ++v)
      if (v != out) rest.push_back(v);
    const BoardViews some = solver::subset(data, rest);
    CS_TRY(const LensFit fit,
           solver::fit_lens(some, {.model = choice.rung().model, .start = nullptr, .find_outliers = true}));
    const double ours = solver::held_out_square(data, data.views[out], fit.lens, all);
    const double theirs = solver::held_out_square(data, data.views[out], opencv_lens(some), all);
    result.ours += ours / 5, result.opencv += theirs / 5;
    low = std::min(low, fit.lens.intrinsics()[0]), high = std::max(high, fit.lens.intrinsics()[0]);
    study.rows.push_back({fmt::format("graycode-board, pose {} held out", out), "", "", "", "", "", "",
                          fmt::format("{:.4f}", std::sqrt(ours)), fmt::format("{:.4f}", std::sqrt(theirs))});
  }
  result.ours = std::sqrt(result.ours), result.opencv = std::sqrt(result.opencv);
  study.rows.push_back({"graycode-board, all", "", "", "", "", "", "", fmt::format("{:.4f}", result.ours),
                        fmt::format("{:.4f}", result.opencv)});
  const LensUncertainty uncertainty(data, choice.rung().fit);
  study.notes.push_back(
      fmt::format("graycode-board: leaving one pose out moves the focal length over {:.0f} to {:.0f} px; one sigma of "
                  "all five is {:.1f} "
                  "px",
                  low, high, uncertainty.focal_sigma() * choice.rung().fit.lens.intrinsics()[0]));
  return result;
}

}  // namespace

Result<Study> lens_calibration(const StudyContext& context) {
  Study study{"Lenses: coverage of predicted ellipses (39.3 and 86.5 % for one and two sigma), and held-out error",
              {"rig", "trials", "refused", "1 sigma %", "2 sigma %", "1 sigma % far", "2 sigma % far", "held-out px",
               "OpenCV px"},
              {},
              {},
              "",
              "",
              false};
  const std::vector<LensRig> rigs = {
      {"pinhole, 10 views", "LENSMODEL_PINHOLE", 10},
      {"OPENCV4, 6 views", "LENSMODEL_OPENCV4", 6},
      {"OPENCV4, 10 views, tilts to 30 deg", "LENSMODEL_OPENCV4", 10, "chessboard:9x7:20mm", Way::kFixed, 400, 0.52},
      {"OPENCV5, 10 views", "LENSMODEL_OPENCV5", 10},
      {"OPENCV5, 25 views", "LENSMODEL_OPENCV5", 25},
      {"OPENCV4, model by the ladder", "LENSMODEL_OPENCV4", 12, "chessboard:9x7:20mm", Way::kLadder, 300},
      {"OPENCV4, photos of a chessboard", "LENSMODEL_OPENCV4", 10, "chessboard:9x7:20mm", Way::kPhotos, 150},
      {"OPENCV4, photos of AprilTags", "LENSMODEL_OPENCV4", 10, "apriltag:8x6:24mm", Way::kPhotos, 150}};
  Coverage coverage;
  for (const LensRig& rig : rigs) run_rig(rig, study, coverage, *context.progress);
  const fs::path scratch = context.output / "lens";
  std::error_code code;
  fs::create_directories(scratch, code);
  CS_TRY(const std::optional<double> python, difference_from_python(scratch));
  study.notes.push_back(python ? fmt::format("Python's mrcal: covariances equal ours to {:.1e}", *python)
                               : "skipped: python3-mrcal is not installed, its uncertainty is not compared");
  const fs::path data = fs::path(COUNTERSHADE_SOURCE_DIR).parent_path() / "shared" / "data" / "graycode-board";
  std::optional<RealBoard> real;
  if (fs::exists(data)) {
    CS_TRY(const BoardViews views, real_views(data));
    CS_TRY(real, run_real(views, study, *context.progress));
  } else {
    study.notes.push_back("skipped: '" + data.string() + "' is not on this machine");
  }
  study.figure = fmt::format("{:.1f} to {:.1f} % and {:.1f} to {:.1f} % within one and two sigma, {} trials",
                             coverage.least[0], coverage.most[0], coverage.least[1], coverage.most[1], coverage.trials);
  if (real)
    study.figure +=
        fmt::format("; graycode-board held-out {:.4f} px, calibrateCamera {:.4f}", real->ours, real->opencv);
  study.bound = "39.3 and 86.5 % +- 5 points; at most calibrateCamera's; Python's mrcal to 1e-4";
  study.ok = coverage.ok && (!real || real->ours <= real->opencv) && (!python || *python <= 1e-4);
  return study;
}

}  // namespace countershade::bench
