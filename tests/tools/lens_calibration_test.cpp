#include "tools/job/lens/lens_calibration.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <map>
#include <nlohmann/json.hpp>

#include "calib/file/file.h"
#include "calib/image/image_file.h"
#include "simdata/render/board_photo.h"
#include "tests/support/cli.h"
#include "tools/report/picture.h"

namespace countershade::tools {
namespace {

namespace fs = std::filesystem;
using countershade::testing::TemporaryFolder;
using ::testing::HasSubstr;
using ::testing::Not;

constexpr const char* kBoard = "chessboard:7x5:25mm";

Lens true_lens(double scale = 1) {
  return Lens::make("LENSMODEL_OPENCV4",
                    {260 * scale, 262 * scale, 157 * scale, 122 * scale, -0.18, 0.07, 0.001, -0.001},
                    static_cast<int>(320 * scale), static_cast<int>(240 * scale))
      .value();
}

std::string png_of(const Image& light) {
  Image rgb(light.width(), light.height(), 3);
  for (std::size_t i = 0; i < rgb.data().size(); ++i) rgb.data()[i] = 255 * light.data()[i / 3];
  return png_bytes(rgb).value();
}

// PNG bytes of a photo of the board; made once, used by all tests.
const std::string& photo(int index, double most_tilt = 0.8, double scale = 1, const char* name = kBoard) {
  static std::map<std::tuple<int, double, double, std::string>, std::string> made;
  std::string& bytes = made[{index, most_tilt, scale, name}];
  if (bytes.empty()) {
    const Board board = parse_board(name).value();
    Random random(hash_name("lens photos") + index);
    const Pose pose = simdata::board_pose(board, true_lens(scale), 0.7, most_tilt, random);
    const Image light = simdata::BoardCamera(true_lens(scale)).photo(BoardPattern(board), pose, {}, random);
    bytes = png_of(light);
  }
  return bytes;
}

struct Place {
  TemporaryFolder folder;
  fs::path photos = folder / "photos", model = folder / "camera.cameramodel";
  SilentProgress progress;
  LensOptions options;

  Place() {
    fs::create_directories(photos);
    options.board = parse_board(kBoard).value();
  }
  void add(const std::string& name, const std::string& bytes) const { std::ofstream(photos / name) << bytes; }
  void add_views(int count) const {
    for (int i = 0; i < count; ++i) add(fmt::format("{:02}.png", i), photo(i));
  }
  Result<LensReport> run() { return calibrate_lens({photos}, model, options, progress); }
  std::string refusal() {
    const auto report = run();
    EXPECT_FALSE(report);
    return report ? "" : report.error().message;
  }
};

TEST(LensCalibration, FindsTheLensAndWritesAllFiles) {
  Place place;
  place.add_views(12);
  const LensReport report = place.run().value();
  EXPECT_EQ(report.fit().lens.model(), "LENSMODEL_OPENCV4");
  EXPECT_LT(report.choice.rung().held_out_px, 0.1);
  const Lens read = read_cameramodel(place.model).value().lens;
  EXPECT_EQ(read.intrinsics(), report.fit().lens.intrinsics());
  const auto q = solver::pixel_grid(320, 240, 5, 4);
  for (const Eigen::Vector2d& d : solver::lens_difference(true_lens(), read, q)) EXPECT_LT(d.norm(), 1.0);
  ASSERT_TRUE(report.halves);
  for (const char* name : {"lens.html", "lens.json", "coverage.svg", "residuals.svg", "uncertainty_near.svg",
                           "uncertainty_far.svg", "halves.svg"})
    EXPECT_TRUE(fs::exists(place.folder / "camera.lens" / name)) << name;
  const auto numbers = nlohmann::json::parse(read_text(place.folder / "camera.lens" / "lens.json").value());
  EXPECT_EQ(numbers["model"], "LENSMODEL_OPENCV4");
  EXPECT_EQ(numbers["ladder"].size(), 5);
  EXPECT_EQ(numbers["photos"].size(), 12);
  const std::string html = read_text(place.folder / "camera.lens" / "lens.html").value();
  EXPECT_THAT(html, HasSubstr("chosen"));
  EXPECT_THAT(html, Not(HasSubstr("http://www.w3.org/1999")));
}

TEST(LensCalibration, EqualPhotosGiveEqualBytesAtAnyPlace) {
  Place a, b;
  for (Place* p : {&a, &b}) {
    p->add_views(6);
    ASSERT_TRUE(p->run());
  }
  EXPECT_EQ(read_text(a.model).value(), read_text(b.model).value());
  for (const char* name : {"lens.json", "lens.html"})
    EXPECT_EQ(read_text(a.folder / "camera.lens" / name).value(), read_text(b.folder / "camera.lens" / name).value());
}

TEST(LensCalibration, TheFormerModelStaysBesideTheNewOne) {
  Place place;
  place.add_views(6);
  ASSERT_TRUE(place.run());
  const std::string first = read_text(place.model).value();
  const std::string first_numbers = read_text(place.folder / "camera.lens" / "lens.json").value();
  place.add("99.png", photo(20));
  ASSERT_TRUE(place.run());
  EXPECT_NE(read_text(place.model).value(), first);
  EXPECT_EQ(read_text(place.folder / "camera.former.cameramodel").value(), first);
  EXPECT_EQ(read_text(place.folder / "camera.former.lens" / "lens.json").value(), first_numbers);
  ASSERT_TRUE(place.run());
  EXPECT_TRUE(fs::exists(place.folder / "camera.former2.cameramodel"));
}

TEST(LensCalibration, SaysWhenTheFormerModelIsBetter) {
  Place place;
  place.add_views(14);
  ASSERT_TRUE(place.run());
  for (int i = 4; i < 14; ++i) fs::remove(place.photos / fmt::format("{:02}.png", i));
  const LensReport report = place.run().value();
  EXPECT_THAT(report.warnings, ::testing::Contains(HasSubstr("may be the better one")))
      << ::testing::PrintToString(report.notes);
}

TEST(LensCalibration, TooFewViewsLeaveTheFormerModelUntouched) {
  Place place;
  place.add_views(3);
  place.add("copy.png", photo(2));
  place.add("nothing.png", png_of(Image(320, 240, 1, 0.35F)));
  std::ofstream(place.model) << "former";
  const std::string said = place.refusal();
  EXPECT_THAT(said, HasSubstr("3 views of the board that differ, at least 4 are needed"));
  EXPECT_THAT(said, HasSubstr("no board found in 1 of 5 photos"));
  EXPECT_THAT(said, HasSubstr("'nothing.png'"));
  EXPECT_THAT(said, HasSubstr("nothing was overwritten"));
  EXPECT_EQ(read_text(place.model).value(), "former");
  EXPECT_FALSE(fs::exists(place.folder / "camera.lens"));
  const std::string page = read_text(place.folder / "camera.refused.html").value();
  EXPECT_THAT(page, HasSubstr("nothing.png"));
  EXPECT_THAT(page, HasSubstr("data:image/png;base64"));
}

TEST(LensCalibration, FacingViewsAreRefusedWithTheViewToAdd) {
  Place place;
  for (int i = 0; i < 7; ++i) place.add(fmt::format("{}.png", i), photo(i, 0.02));
  const std::string said = place.refusal();
  EXPECT_THAT(said, HasSubstr("too much alike"));
  EXPECT_THAT(said, HasSubstr("tilted by about 30 to 45 degrees"));
}

TEST(LensCalibration, PhotosWithoutABoardAreListedAndDoNotStopTheRest) {
  Place place;
  place.add_views(6);
  place.add("broken.png", photo(7).substr(0, 200));
  place.add("notes.txt", "not a photo, and not meant as one");
  const LensReport report = place.run().value();
  EXPECT_EQ(report.photos.size(), 7);
  EXPECT_THAT(report.warnings,
              ::testing::Contains(HasSubstr("no board found in 1 of 7 photos: not a picture that can be read")));
}

TEST(LensCalibration, FilesOfOneNameInManyFoldersAreToldApart) {
  Place place;
  std::vector<fs::path> inputs;
  for (int i = 0; i < 5; ++i) {
    const fs::path folder = place.photos / fmt::format("pose_{}", i);
    fs::create_directories(folder);
    std::ofstream(folder / "white.png") << photo(i);
    inputs.push_back(folder / "white.png");
  }
  const LensReport report = calibrate_lens(inputs, place.model, place.options, place.progress).value();
  EXPECT_EQ(report.photos[3].name, "pose_3/white.png");
}

TEST(LensCalibration, BadInputIsNamed) {
  Place place;
  EXPECT_THAT(place.refusal(), HasSubstr("holds no photos"));
  place.add_views(4);
  place.add("large.png", photo(0, 0.8, 1.5));
  const std::string sizes = place.refusal();
  EXPECT_THAT(sizes, HasSubstr("different sizes"));
  EXPECT_THAT(sizes, HasSubstr("4 of 320 x 240"));
  EXPECT_THAT(sizes, HasSubstr("1 of 480 x 360 ('large.png')"));
  fs::remove(place.photos / "large.png");
  place.options.board = parse_board("chessboard:6x5:25mm").value();
  EXPECT_THAT(place.refusal(), HasSubstr("another board size was found: 7x5"));
  const auto missing = calibrate_lens({place.folder / "none"}, place.model, place.options, place.progress);
  EXPECT_THAT(missing.error().message, HasSubstr("does not exist"));
  place.add("notes.txt", "x");
  const auto text = calibrate_lens({place.photos / "notes.txt"}, place.model, place.options, place.progress);
  EXPECT_THAT(text.error().message, HasSubstr("notes.txt' is not a picture"));
  const auto name = calibrate_lens({place.photos}, place.folder / "camera.xml", place.options, place.progress);
  EXPECT_THAT(name.error().message, HasSubstr("must end in .cameramodel"));
  EXPECT_FALSE(fs::exists(place.model));
}

TEST(LensCalibration, APlaceThatCannotBeWrittenIsNamedBeforeTheWork) {
  Place place;  // without photos: nothing was looked at
  const auto nowhere =
      calibrate_lens({place.photos}, place.folder / "no" / "x.cameramodel", place.options, place.progress);
  EXPECT_THAT(nowhere.error().message, HasSubstr("no' does not exist"));
  fs::create_directories(place.model);
  EXPECT_THAT(place.refusal(), HasSubstr("camera.cameramodel' is a folder"));
  EXPECT_FALSE(fs::exists(place.folder / "camera.lens"));
}

TEST(LensCalibration, AFailureBetweenTheFilesPutsTheFormerOnesBack) {
  Place place;
  place.add_views(6);
  ASSERT_TRUE(place.run());
  const std::string model = read_text(place.model).value();
  const std::string numbers = read_text(place.folder / "camera.lens" / "lens.json").value();
  place.add("99.png", photo(20));
  // Where the new model is first written stands something that a file cannot replace.
  fs::create_directories(place.folder / "camera.new.cameramodel" / "full");
  const std::string said = place.refusal();
  EXPECT_EQ(read_text(place.model).value(), model) << said;
  EXPECT_EQ(read_text(place.folder / "camera.lens" / "lens.json").value(), numbers);
}

TEST(LensCalibration, ABoardThatNobodyNamedIsRecognised) {
  Place place;
  place.add_views(6);
  place.options.board.reset();
  const LensReport report = place.run().value();
  EXPECT_TRUE(report.board_recognised);
  EXPECT_EQ(report.board.name(), kBoard);
}

}  // namespace
}  // namespace countershade::tools
