// decode-real: photographs somebody else took (data/graycode-board): five poses of a chessboard under complementary
// Gray code.
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

// The white-black mask (difference above 40 of 255, the mask of the floors), as shares of it: what was accepted, and
// what the rest is, each pixel counted once.
struct Coverage {
  double accepted = 0;
  double washed = 0;  // on neither axis do the finest stripes make a third of what they make of white - black in the
                      // median of the mask: light reaches it by way of others, or wanders inside it
  double edge = 0;    // within 4 px of a pixel outside the mask, or of one three times as bright or dark
  double other = 0;
};

Result<Image> light_of(const Session& session, const std::function<bool(const Role&)>& is) {
  for (const Frame& frame : session.sequence().frames)
    if (is(frame.role)) {
      CS_TRY(const Photo photo, session.photo("camera", frame.index));
      return photo.value;
    }
  return error(ErrorCode::kBadFile,
               "the sequence of the data has changed: white, black or the finest bits are missing");
}

Result<Coverage> coverage_of_mask(const Session& session, const capture::Correspondence& c) {
  constexpr int kNear = 4;
  CS_TRY(Image contrast, light_of(session, [](const Role& r) { return r.kind == "white"; }));
  CS_TRY(const Image black, light_of(session, [](const Role& r) { return r.kind == "black"; }));
  for (std::size_t i = 0; i < contrast.data().size(); ++i) contrast.data()[i] -= black.data()[i];
  Image fine(contrast.width(), contrast.height(), 1);  // strongest modulation by a finest bit
  for (const char* axis : {"x", "y"}) {
    const auto finest = [&](bool inverse) {
      return light_of(session, [&](const Role& r) {
        return r.kind == "gray" && r.axis == axis && r.bit == 0 && r.inverse == inverse;
      });
    };
    CS_TRY(const Image plain, finest(false));
    CS_TRY(const Image inverse, finest(true));
    for (std::size_t i = 0; i < fine.data().size(); ++i)
      fine.data()[i] = std::max(fine.data()[i], std::abs(plain.data()[i] - inverse.data()[i]));
  }
  const auto in_mask = [&](float difference) { return difference > 40.0f / 255; };
  std::vector<float> shares;
  for (std::size_t i = 0; i < fine.data().size(); ++i) {
    if (!in_mask(contrast.data()[i])) continue;
    shares.push_back(fine.data()[i] / contrast.data()[i]);
  }
  if (shares.empty()) return Coverage();
  const auto middle = shares.begin() + static_cast<std::ptrdiff_t>(shares.size() / 2);
  std::nth_element(shares.begin(), middle, shares.end());
  const float washed = *middle / 3;
  Coverage result;
  std::size_t mask = 0;
  for (int y = 0; y < contrast.height(); ++y)
    for (int x = 0; x < contrast.width(); ++x) {
      const float own = contrast.at(x, y);
      if (!in_mask(own)) continue;
      ++mask;
      bool edge = false;
      for (int v = std::max(0, y - kNear); v <= std::min(contrast.height() - 1, y + kNear); ++v)
        for (int u = std::max(0, x - kNear); u <= std::min(contrast.width() - 1, x + kNear); ++u) {
          const float near = contrast.at(u, v);
          edge = edge || !in_mask(near) || near > 3 * own || own > 3 * near;
        }
      double& what = !c.reason.at(x, y)             ? result.accepted
                     : fine.at(x, y) < washed * own ? result.washed
                     : edge                         ? result.edge
                                                    : result.other;
      what += 1;
    }
  for (double* share : {&result.accepted, &result.washed, &result.edge, &result.other})
    *share /= std::max<double>(1, mask);
  return result;
}

// Share of accepted pixels off the board that none of their four sides continues to within 1.5 px.
double local_outliers(const capture::Correspondence& c, const std::vector<cv::Point2f>& hull) {
  std::size_t judged = 0, outliers = 0;
  for (int y = 2; y + 2 < c.x.height(); ++y)
    for (int x = 2; x + 2 < c.x.width(); ++x) {
      if (c.reason.at(x, y) || cv::pointPolygonTest(hull, cv::Point2f(x, y), false) > 0) continue;
      int sides = 0;
      bool continued = false;
      for (const auto& [dx, dy] : {std::pair(1, 0), {-1, 0}, {0, 1}, {0, -1}}) {
        if (c.reason.at(x + dx, y + dy) || c.reason.at(x + 2 * dx, y + 2 * dy)) continue;
        ++sides;
        const auto off = [&](const Image& q) {
          return std::abs(2 * q.at(x + dx, y + dy) - q.at(x + 2 * dx, y + 2 * dy) - q.at(x, y));
        };
        continued = continued || std::max(off(c.x), off(c.y)) <= 1.5f;
      }
      if (sides < 2) continue;
      ++judged, outliers += !continued;
    }
  return static_cast<double>(outliers) / std::max<std::size_t>(1, judged);
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

Result<Study> decode_real(const StudyContext& context) {
  const fs::path data = fs::path(COUNTERSHADE_SOURCE_DIR).parent_path() / "shared" / "data" / "graycode-board";
  Study study;
  study.title =
      "Real Gray-code photographs of a chessboard (kamino410/procam-calibration): import and calibrate, geometry only";
  study.columns = {
      "pose",          "accepted % of mask",    "fixed thresholds %", "rest: washed out %",   "rest: edge %",
      "rest: other %", "board: off > 1.5 px %", "board: rms px",      "elsewhere: outliers %"};
  study.bound = ">= 90 %, or all but 1 % washed out or edge; <= .2 % off";
  if (!fs::exists(data)) {
    study.figure = "skipped: '" + data.string() + "' is not on this machine";
    study.ok = true;
    return study;
  }
  const fs::path scratch = context.output / "decode-real";
  std::error_code code;
  fs::remove_all(scratch, code);
  fs::create_directories(scratch, code);
  CS_TRY_VOID(
      write_atomically(scratch / "rig.toml",
                       "[[camera]]\nid = \"camera\"\n\n[[projector]]\nid = \"projector\"\nresolution = [1024, 768]\n"));
  CS_TRY(const Rig rig, read_rig(scratch / "rig.toml"));
  CS_TRY(const Sequence sequence, read_sequence(data / "sequence.json"));
  double least = 1, least_explained = 1, most_off = 0, most_outliers = 0;
  bool above_floors = true;
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
    CS_TRY(const Coverage coverage, coverage_of_mask(session, c));
    const double outliers = local_outliers(c, hull);
    least = std::min(least, coverage.accepted);
    least_explained = std::min(least_explained, 1 - coverage.other);
    above_floors = above_floors && 100 * coverage.accepted >= kFloors[pose];
    most_off = std::max(most_off, board.off_share), most_outliers = std::max(most_outliers, outliers);
    study.rows.push_back({fmt::format("{}", pose), fmt::format("{:.1f}", 100 * coverage.accepted),
                          fmt::format("{:.1f}", kFloors[pose]), fmt::format("{:.1f}", 100 * coverage.washed),
                          fmt::format("{:.1f}", 100 * coverage.edge), fmt::format("{:.2f}", 100 * coverage.other),
                          fmt::format("{:.3f}", 100 * board.off_share), fmt::format("{:.3f}", board.rms_px),
                          fmt::format("{:.3f}", 100 * outliers)});
    study.notes.push_back("what was rejected and why: " +
                          (calibration / "correspondence" / "camera-projector-reasons.png").string());
  }
  study.figure = fmt::format(
      "{:.1f} % accepted at least, at most {:.2f} % of the mask unexplained, {:.3f} % off, {:.3f} % outliers",
      100 * least, 100 * (1 - least_explained), 100 * most_off, 100 * most_outliers);
  study.ok = above_floors && (least >= 0.9 || least_explained >= 0.99) && most_off <= 0.002 && most_outliers <= 0.002;
  return study;
}

}  // namespace countershade::bench
