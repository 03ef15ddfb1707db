#include "calib/geometry/board.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <opencv2/aruco/charuco.hpp>
#include <regex>

#include "calib/base/random.h"
#include "calib/file/board_file.h"
#include "calib/file/file.h"
#include "calib/image/image_file.h"
#include "tests/support/cli.h"

namespace countershade {
namespace {

using ::testing::HasSubstr;
using testing::TemporaryFolder;

TEST(Board, NameIsReadBackAsTheSameBoard) {
  for (const char* text : {"chessboard:9x7:75mm", "apriltag:10x7:25mm:18.75mm", "charuco:8x5:4cm:30mm:4x4"}) {
    const Board board = parse_board(text).value();
    const Board again = parse_board(board.name()).value();
    EXPECT_EQ(board.name(), again.name());
    EXPECT_EQ(board.marker_bits, again.marker_bits);
    EXPECT_DOUBLE_EQ(board.square, again.square);
  }
  EXPECT_DOUBLE_EQ(parse_board("charuco:8x5:.04m").value().marker, 0.03);
}

TEST(Board, ErrorsNameTheValueTheBoundAndTheRemedy) {
  const auto said = [](const char* text) { return parse_board(text).error().message; };
  EXPECT_THAT(said("aprltag:5x5:25mm"), HasSubstr("nearest is 'apriltag'"));
  EXPECT_THAT(said("chessboard:9:25mm"), HasSubstr("chessboard:9x7:75mm"));
  EXPECT_THAT(said("chessboard:9x2:25mm"), HasSubstr("each must be 3 to 100"));
  EXPECT_THAT(said("chessboard:9x7:25"), HasSubstr("'25' must be a length from .1mm to 10m"));
  EXPECT_THAT(said("charuco:9x7:20mm:20mm"), HasSubstr("between .2 and .95"));
  EXPECT_THAT(said("charuco:9x7:20mm:15mm:7x7"), HasSubstr("4x4, 5x5 or 6x6"));
  EXPECT_THAT(said("apriltag:60x60:20mm"), HasSubstr("needs 1800 markers, its family has 587"));
}

class BoardPatternOf : public ::testing::TestWithParam<const char*> {};

TEST_P(BoardPatternOf, RectanglesCoverWhatIsDark) {
  const Board board = parse_board(GetParam()).value();
  const BoardPattern pattern(board);
  const auto rectangles = pattern.dark_rectangles();
  const Rectangle extent = pattern.extent();
  Random random(hash_name(GetParam()));
  int dark = 0;
  for (int i = 0; i < 20000; ++i) {
    const Eigen::Vector2d x(random.uniform(extent.low.x() - 0.01, extent.high.x() + 0.01),
                            random.uniform(extent.low.y() - 0.01, extent.high.y() + 0.01));
    bool covered = false;
    for (const Rectangle& r : rectangles)
      covered = covered || ((x - r.low).minCoeff() >= 0 && (r.high - x).minCoeff() > 0);
    ASSERT_EQ(pattern.dark(x), covered) << x.transpose();
    dark += covered;
  }
  EXPECT_GT(dark, 20000 / 4);
}

TEST_P(BoardPatternOf, PointsAreSaddles) {
  const Board board = parse_board(GetParam()).value();
  const BoardPattern pattern(board);
  const double e = 0.05 * board.square;
  for (int i = 0; i < board.points(); ++i) {
    const Eigen::Vector2d x = board.point(i).head<2>();
    const bool first = pattern.dark(x + Eigen::Vector2d(e, e));
    EXPECT_EQ(pattern.dark(x - Eigen::Vector2d(e, e)), first);
    EXPECT_EQ(pattern.dark(x + Eigen::Vector2d(e, -e)), !first);
    EXPECT_EQ(pattern.dark(x + Eigen::Vector2d(-e, e)), !first);
  }
}

INSTANTIATE_TEST_SUITE_P(AllKinds, BoardPatternOf,
                         ::testing::Values("chessboard:8x5:20mm", "apriltag:7x5:20mm", "charuco:8x5:20mm:14mm:6x6",
                                           "charuco:7x6:20mm"));

TEST(Board, CharucoIsOpenCvs) {
  const Board board = parse_board("charuco:7x5:20mm:14mm:5x5").value();
  const BoardPattern pattern(board);
  const auto dictionary = cv::aruco::getPredefinedDictionary(cv::aruco::DICT_5X5_50);
  const auto theirs = cv::aruco::CharucoBoard::create(7, 5, 0.02F, 0.014F, dictionary);
  ASSERT_EQ(static_cast<int>(theirs->ids.size()), board.markers());
  // Their origin is the corner of the board, ours its first inner corner.
  for (int i = 0; i < board.markers(); ++i) {
    const cv::Point3f corner = theirs->objPoints[i][0];
    EXPECT_NEAR(corner.x - 0.02, board.marker_corner(theirs->ids[i]).x(), 1e-6);  // their points are floats
    EXPECT_NEAR(corner.y - 0.02, board.marker_corner(theirs->ids[i]).y(), 1e-6);
  }
  cv::Mat picture;
  theirs->draw({700, 500}, picture);
  int wrong = 0;
  for (int y = 0; y < 500; y += 3)
    for (int x = 0; x < 700; x += 3)
      wrong +=
          pattern.dark({x * 0.0002 - 0.02 + 1e-4, y * 0.0002 - 0.02 + 1e-4}) != (picture.at<std::uint8_t>(y, x) < 128);
  EXPECT_LT(wrong, 0.02 * 500 * 700 / 9);  // their markers are drawn with whole pixels
}

TEST(BoardFile, PdfIsTrueToScale) {
  const TemporaryFolder folder;
  const Board board = parse_board("apriltag:10x7:25mm").value();
  const Sheet sheet = write_board(folder / "board.pdf", board).value();
  EXPECT_EQ(sheet.paper, "A4");
  const std::string pdf = read_text(folder / "board.pdf").value();
  std::smatch found;
  ASSERT_TRUE(std::regex_search(pdf, found, std::regex("MediaBox \\[0 0 ([0-9.]+) ([0-9.]+)\\]")));
  EXPECT_NEAR(std::stod(found[1]), 297 * 72 / 25.4, 1e-3);
  EXPECT_NEAR(std::stod(found[2]), 210 * 72 / 25.4, 1e-3);
  EXPECT_THAT(pdf, HasSubstr("2.834646 0 0 2.834646 0 0 cm"));  // millimetres from here on
  double low = 1e9, high = -1e9, longest = 0;
  const std::regex bar("\n([0-9.]+) ([0-9.]+) ([0-9.]+) ([0-9.]+) re");
  for (std::sregex_iterator i(pdf.begin(), pdf.end(), bar), end; i != end; ++i) {
    if (std::stod((*i)[2]) < 15) {
      longest = std::max(longest, std::stod((*i)[3]));
      continue;
    }
    low = std::min(low, std::stod((*i)[1]));
    high = std::max(high, std::stod((*i)[1]) + std::stod((*i)[3]));
  }
  EXPECT_NEAR(high - low, 250, 1e-3);  // ten squares
  EXPECT_NEAR(longest, 100, 1e-9);     // the ruler
}

TEST(BoardFile, PdfFindsItsObjects) {
  const TemporaryFolder folder;
  ASSERT_TRUE(write_board(folder / "board.pdf", parse_board("charuco:8x6:30mm").value(), "a2"));
  const std::string pdf = read_text(folder / "board.pdf").value();
  const std::regex place("([0-9]{10}) 00000 n ");
  int number = 0;
  for (std::sregex_iterator i(pdf.begin(), pdf.end(), place), end; i != end; ++i)
    EXPECT_EQ(pdf.substr(std::stoul((*i)[1]), 7), fmt::format("{} 0 obj", ++number));
  EXPECT_EQ(number, 5);
  const std::size_t start = std::stoul(pdf.substr(pdf.find("startxref") + 10));
  EXPECT_EQ(pdf.substr(start, 4), "xref");
}

TEST(BoardFile, PngHasTenPixelsPerMillimetre) {
  const TemporaryFolder folder;
  ASSERT_TRUE(write_board(folder / "board.png", parse_board("chessboard:9x6:25mm").value()));
  const Image page = read_image(folder / "board.png").value().values;
  ASSERT_TRUE(page.same_size(2970, 2100));
  int first = -1, last = -1;
  for (int x = 0; x < page.width(); ++x)
    if (page.at(x, 300) < 128) first = first < 0 ? x : first, last = x;
  EXPECT_NEAR((last - first + 1) / 10.0, 225 + 25 * (first < 400 && last > 2500), 0.2);
}

TEST(BoardFile, SaysWhatFits) {
  const Board large = parse_board("chessboard:9x6:50mm").value();
  const auto small_paper = sheet_for(large, "A4");
  ASSERT_FALSE(small_paper);
  EXPECT_THAT(small_paper.error().message, HasSubstr("squares of at most 25.4 mm"));
  EXPECT_EQ(sheet_for(large).value().paper, "A2");
  EXPECT_THAT(sheet_for(large, "A9").error().message, HasSubstr("papers: A4, A3"));
  EXPECT_THAT(write_board("board.gif", large).error().message, HasSubstr(".pdf or .png"));
}

}  // namespace
}  // namespace countershade
