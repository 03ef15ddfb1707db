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
  EXPECT_EQ(e.seen, found.seen);
  EXPECT_GE(e.seen, 0.95 * board.points());
  EXPECT_LT(e.rms, 0.08);
}

INSTANTIATE_TEST_SUITE_P(AllKinds, BoardDetection,
                         ::testing::Values("chessboard:9x7:20mm", "apriltag:9x7:22mm", "charuco:9x7:22mm"),
                         [](const auto& info) {
                           return std::string(info.param).substr(0, std::string(info.param).find(':'));
                         });

Image photo_of(const char* text, const Pose& pose, const simdata::BoardPhotoOptions& options = {}) {
  Random random(hash_name(text));
  return simdata::BoardCamera(brown_lens()).photo(BoardPattern(parse_board(text).value()), pose, options, random);
}

TEST(BoardDetection, PartOfAMarkerBoardIsEnough) {
  const Board board = parse_board("apriltag:9x7:22mm").value();
  Pose pose = tilted(board, 0.34);
  pose.translation += Eigen::Vector3d(-0.2, -0.09, 0);
  const Detection found = detect_board(photo_of("apriltag:9x7:22mm", pose), board);
  ASSERT_TRUE(found.found) << found.reason;
  const Errors e = errors_of(found, board, pose, brown_lens());
  EXPECT_GE(e.seen, kLeastPoints);
  EXPECT_LT(e.seen, board.points());
  EXPECT_LT(e.worst, 0.3);  // pixels: no point under another's number
}

TEST(BoardDetection, PointsInALineAreNotEnough) {
  const Board board = parse_board("charuco:14x3:30mm").value();  // two rows of points
  Pose pose;
  pose.translation =
      Eigen::Vector3d(-0.108, -0.222, 0.42);  // of the upper border only the second row is in the picture
  const simdata::BoardCamera camera(Lens::pinhole(500, 319.5, 239.5, 640, 480));
  Random random(3);
  const Image photo = camera.photo(BoardPattern(board), pose, {}, random);
  const Detection found = detect_board(photo, board);
  EXPECT_FALSE(found.found);
  EXPECT_THAT(found.reason, HasSubstr("almost in a line"));
}

TEST(BoardDetection, SaysWhichOtherSizeWasSeen) {
  const Board chessboard = parse_board("chessboard:9x7:20mm").value();
  const Image photo = photo_of("chessboard:9x7:20mm", tilted(chessboard, 0.34));
  const Detection wrong = detect_board(photo, parse_board("chessboard:8x6:20mm").value());
  EXPECT_FALSE(wrong.found);
  EXPECT_THAT(wrong.reason, HasSubstr("another board size was found: 9x7"));
  const Board tags = parse_board("apriltag:9x7:22mm").value();
  const Detection columns =
      detect_board(photo_of("apriltag:9x7:22mm", tilted(tags, 0.34)), parse_board("apriltag:10x7:22mm").value());
  EXPECT_FALSE(columns.found);
  EXPECT_THAT(columns.reason, HasSubstr("lie in 9 columns"));
}

TEST(BoardDetection, SaysThatThereIsNone) {
  Image empty(320, 240, 1, 0.4F);
  for (const char* text : {"chessboard:9x7:20mm", "apriltag:9x7:22mm", "charuco:9x7:22mm"}) {
    const Detection found = detect_board(empty, parse_board(text).value());
    EXPECT_FALSE(found.found);
    EXPECT_THAT(found.reason, HasSubstr("sharp and lit"));
  }
}

TEST(BoardDetection, DimPhotosAreFoundAsWell) {
  const Board board = parse_board("chessboard:9x7:20mm").value();
  const Pose pose = tilted(board, 0.34);
  simdata::BoardPhotoOptions dim;
  dim.white = 0.02, dim.black = 0.002, dim.surround = 0.01, dim.noise = 0.0003;
  const Detection found = detect_board(photo_of("chessboard:9x7:20mm", pose, dim), board);
  ASSERT_TRUE(found.found) << found.reason;
  EXPECT_LT(errors_of(found, board, pose, brown_lens()).rms, 0.08);
}

TEST(BoardDetection, RecognisesABoardThatNobodyNamed) {
  for (const char* text : {"chessboard:9x7:25mm", "apriltag:9x7:25mm:18.75mm", "charuco:9x7:25mm:17.5mm:6x6"}) {
    const Board board = parse_board(text).value();
    const std::optional<Board> found = recognise_board(photo_of(text, tilted(board, 0.42)));
    ASSERT_TRUE(found) << text;
    EXPECT_EQ(found->kind, board.kind);
    EXPECT_EQ(found->columns, board.columns);
    EXPECT_EQ(found->rows, board.rows);
    EXPECT_EQ(found->marker_bits, board.marker_bits);
    // Contours lie up to half a pixel inside a marker of 21; the edge only tells where points are sought.
    EXPECT_NEAR(found->marker, board.marker, 0.051 * board.square);
  }
  EXPECT_FALSE(recognise_board(Image(320, 240, 1, 0.4F)));
}

}  // namespace
}  // namespace countershade::capture
