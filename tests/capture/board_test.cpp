#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "capture/board/detect.h"
#include "simdata/render/board_photo.h"

namespace countershade::capture {
namespace {

using ::testing::HasSubstr;

Lens brown_lens() {
  return Lens::make("LENSMODEL_OPENCV5", {520, 524, 313, 246, -0.21, 0.09, 0.0011, -0.0007, -0.015}, 640, 480).value();
}

// A board turned about all axes and off the centre of the picture.
Pose tilted(const Board& board, double distance) {
  Pose pose;
  pose.rotation = rotation_from_vector({0.35, -0.42, 0.12});
  const Eigen::Vector3d centre = board.point(board.points() - 1) / 2;
  pose.translation = Eigen::Vector3d(0.02, -0.015, distance) - pose.rotation * centre;
  return pose;
}

struct Errors {
  int seen = 0;
  double rms = 0, worst = 0;
  Eigen::Vector2d mean{0, 0};
};

Errors errors_of(const Detection& found, const Board& board, const Pose& pose, const Lens& lens) {
  Errors errors;
  double squares = 0;
  // A chessboard of odd counts looks the same upside down: either numbering is right.
  const bool turned =
      board.kind == BoardKind::kChessboard && (found.q_px[0] - lens.project(pose * board.point(0))).norm() > 50;
  for (int i = 0; i < board.points(); ++i) {
    if (!std::isfinite(found.q_px[i].x())) continue;
    const Eigen::Vector2d off = found.q_px[i] - lens.project(pose * board.point(turned ? board.points() - 1 - i : i));
    ++errors.seen;
    squares += off.squaredNorm();
    errors.mean += off;
    errors.worst = std::max(errors.worst, off.norm());
  }
  errors.mean /= std::max(1, errors.seen);
  errors.rms = std::sqrt(squares / std::max(1, 2 * errors.seen));
  return errors;
}

class BoardDetection : public ::testing::TestWithParam<const char*> {};

TEST_P(BoardDetection, IsSubpixelUnderPerspectiveDistortionBlurAndNoise) {
  const Board board = parse_board(GetParam()).value();
  const BoardPattern pattern(board);
  const simdata::BoardCamera camera(brown_lens());
  Random random(hash_name(GetParam()));
  const Pose pose = tilted(board, 0.34);
  const Image photo = camera.photo(pattern, pose, {}, random);
  const Detection found = detect_board(photo, board);
  ASSERT_TRUE(found.found) << found.reason;
  const Errors e = errors_of(found, board, pose, camera.lens());
  printf("%s seen %d/%d rms %.4f worst %.4f mean %.4f %.4f\n", GetParam(), e.seen, board.points(), e.rms, e.worst,
         e.mean.x(), e.mean.y());
  EXPECT_EQ(e.seen, found.seen);
  EXPECT_GE(e.seen, 0.95 * board.points());
  EXPECT_LT(e.rms, 0.08);
}

INSTANTIATE_TEST_SUITE_P(AllKinds, BoardDetection,
                         ::testing::Values("chessboard:9x7:20mm", "apriltag:9x7:22mm", "charuco:9x7:22mm"),
                         [](const auto& info) {
                           return std::string(info.param).substr(0, std::string(info.param).find(':'));
                         });

}  // namespace
}  // namespace countershade::capture
