// real-board: photographs somebody else took (data/graycode-board): five poses of a chessboard under complementary Gray
// code.
#include <algorithm>
#include <cmath>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>

#include "calib/base/random.h"
#include "calib/file/file.h"
#include "calib/file/session.h"
#include "capture/pattern/decode.h"
#include "capture/session/runner.h"
#include "tools/bench/study.h"
#include "tools/job/calibration.h"

namespace countershade::bench {

namespace {

namespace fs = std::filesystem;

constexpr double kFloors[] = {75.6, 60.2, 68.7, 72.9, 73.2};  // % of the mask that fixed thresholds accept, poses 0-4

// Hull of the board's inner corners in a photo lit everywhere: a pixel-wise maximum of a pattern and its inverse.
Result<std::vector<cv::Point2f>> board_hull(const Session& session, const std::string& camera) {
  CS_TRY(const Photo a, session.photo(camera, 0));
  CS_TRY(const Photo b, session.photo(camera, 1));
  cv::Mat lit(a.value.height(), a.value.width(), CV_8U);
  for (int y = 0; y < lit.rows; ++y)
    for (int x = 0; x < lit.cols; ++x)
      lit.at<std::uint8_t>(y, x) = cv::saturate_cast<std::uint8_t>(255 * std::max(a.value.at(x, y), b.value.at(x, y)));
  std::vector<cv::Point2f> corners, hull;
  if (!cv::findChessboardCornersSB(lit, {9, 7}, corners, cv::CALIB_CB_NORMALIZE_IMAGE | cv::CALIB_CB_EXHAUSTIVE))
    return error(ErrorCode::kRefused, "no 9 x 7 chessboard in frames 0 and 1");
  cv::convexHull(corners, hull);
  return hull;
}

// Share of the white-black mask (difference above 40 of 255, the mask of the floors) that was accepted.
Result<double> accepted_of_mask(const Session& session, const capture::Correspondence& c) {
  int white = -1, black = -1;
  for (const Frame& frame : session.sequence().frames) {
    if (frame.role.kind == "white") white = frame.index;
    if (frame.role.kind == "black") black = frame.index;
  }
  CS_TRY(const Photo lit, session.photo("camera", white));
  CS_TRY(const Photo dark, session.photo("camera", black));
  std::size_t mask = 0, accepted = 0;
  for (std::size_t i = 0; i < c.x.data().size(); ++i) {
    if (lit.value.data()[i] - dark.value.data()[i] <= 40.0f / 255) continue;
    ++mask;
    accepted += c.reason.data()[i] == 0;
  }
  return mask ? static_cast<double>(accepted) / mask : 0.0;
}

struct BoardResidual {
  double off_share = 0, rms_px = 0;
  int pixels = 0;
};

// How far accepted pixels on the board are from a smooth map of the plane: a homography with a radial term for either
// lens would fit in sigma; a quadratic surface on top of the homography takes what distortion leaves, so that what
// remains is decoding.
BoardResidual residual_on_board(const capture::Correspondence& c, const std::vector<cv::Point2f>& hull) {
  std::vector<cv::Point2f> from, to;
  for (int y = 0; y < c.x.height(); ++y)
    for (int x = 0; x < c.x.width(); ++x)
      if (std::isfinite(c.x.at(x, y)) && std::isfinite(c.y.at(x, y)) &&
          cv::pointPolygonTest(hull, cv::Point2f(x, y), false) > 0) {
        from.emplace_back(x, y);
        to.emplace_back(c.x.at(x, y), c.y.at(x, y));
      }
  BoardResidual result;
  result.pixels = static_cast<int>(from.size());
  if (from.size() < 100) return result;
  const cv::Mat H = cv::findHomography(from, to, cv::RANSAC, 3.0);
  std::vector<cv::Point2f> mapped;
  cv::perspectiveTransform(from, mapped, H);
  const auto basis = [&](const cv::Point2f& p) {
    const double u = (p.x - c.x.width() / 2.0) / c.x.width(), v = (p.y - c.x.height() / 2.0) / c.x.width();
    Eigen::Matrix<double, 10, 1> b;
    b << 1, u, v, u * u, u * v, v * v, u * u * u, u * u * v, u * v * v, v * v * v;
    return b;
  };
  Eigen::Matrix<double, 10, 10> A = Eigen::Matrix<double, 10, 10>::Zero();
  Eigen::Matrix<double, 10, 2> rhs = Eigen::Matrix<double, 10, 2>::Zero();
  for (std::size_t i = 0; i < from.size(); ++i) {
    const Eigen::Vector2d r(to[i].x - mapped[i].x, to[i].y - mapped[i].y);
    if (r.norm() > 3) continue;
    const auto b = basis(from[i]);
    A += b * b.transpose();
    rhs += b * r.transpose();
  }
  const Eigen::Matrix<double, 10, 2> smooth = A.ldlt().solve(rhs);
  int off = 0;
  double squares = 0;
  for (std::size_t i = 0; i < from.size(); ++i) {
    const Eigen::Vector2d r =
        Eigen::Vector2d(to[i].x - mapped[i].x, to[i].y - mapped[i].y) - smooth.transpose() * basis(from[i]);
    off += r.norm() > 1.5;
    if (r.norm() <= 1.5) squares += r.squaredNorm();
  }
  result.off_share = static_cast<double>(off) / from.size();
  result.rms_px = std::sqrt(squares / std::max<std::size_t>(1, from.size() - off));
  return result;
}

}  // namespace

Result<Study> real_board(const StudyContext& context) {
  const fs::path data = fs::path(COUNTERSHADE_SOURCE_DIR).parent_path() / "shared" / "data" / "graycode-board";
  Study study{
      "Real Gray-code photographs of a chessboard (kamino410/procam-calibration): import and calibrate, geometry only",
      {"pose", "accepted % of mask", "floor %", "board pixels", "off > 1.5 px %", "rms px on board"},
      {},
      {},
      "",
      "",
      false};
  study.bound = "accepted >= floors, off <= .2 %";
  if (!fs::exists(data)) {
    study.figure = "skipped: '" + data.string() + "' is not on this machine";
    study.ok = true;
    return study;
  }
  const fs::path scratch = context.output / "real-board";
  std::error_code code;
  fs::remove_all(scratch, code);
  fs::create_directories(scratch, code);
  CS_TRY_VOID(
      write_atomically(scratch / "rig.toml",
                       "[[camera]]\nid = \"camera\"\n\n[[projector]]\nid = \"projector\"\nresolution = [1024, 768]\n"));
  CS_TRY(const Rig rig, read_rig(scratch / "rig.toml"));
  CS_TRY(const Sequence sequence, read_sequence(data / "sequence.json"));
  double least_margin = HUGE_VAL, most_off = 0;
  for (int pose = 0; pose < 5; ++pose) {
    const fs::path session_folder = scratch / fmt::format("session_{}", pose),
                   calibration = scratch / fmt::format("calibration_{}", pose);
    CS_TRY_VOID(capture::import_session(rig, sequence, data / fmt::format("pose_{}", pose) / "photos", session_folder,
                                        *context.progress));
    CS_TRY(const tools::CalibrationSummary summary,
           tools::calibrate(session_folder, calibration, {}, *context.progress));
    CS_TRY(const Session session, Session::open(session_folder));
    CS_TRY(const capture::Correspondence c, capture::decode(session, "camera", "projector", {}, *context.progress));
    CS_TRY(const auto hull, board_hull(session, "camera"));
    const BoardResidual board = residual_on_board(c, hull);
    CS_TRY(const double share, accepted_of_mask(session, c));
    const double accepted = 100 * share;
    least_margin = std::min(least_margin, accepted - kFloors[pose]);
    most_off = std::max(most_off, board.off_share);
    study.rows.push_back({fmt::format("{}", pose), fmt::format("{:.1f}", accepted),
                          fmt::format("{:.1f}", kFloors[pose]), fmt::format("{}", board.pixels),
                          fmt::format("{:.3f}", 100 * board.off_share), fmt::format("{:.3f}", board.rms_px)});
    study.notes.push_back("what was rejected and why: " +
                          (calibration / "correspondence" / "camera-projector-reasons.png").string());
  }
  study.figure = fmt::format("least margin over fixed thresholds {:+.1f} points, at most {:.3f} % off", least_margin,
                             100 * most_off);
  study.ok = least_margin >= 0 && most_off <= 0.002;
  return study;
}

}  // namespace countershade::bench
