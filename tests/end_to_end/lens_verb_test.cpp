// countershade lens, as it is typed.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "calib/file/file.h"
#include "calib/geometry/lens.h"
#include "tests/support/cli.h"

namespace countershade {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;
using testing::run_countershade;
using testing::TemporaryFolder;

TEST(LensVerb, WritesABoardToPrint) {
  const TemporaryFolder folder;
  const std::string out = (folder / "board.pdf").string();
  const auto made = run_countershade("lens --board charuco:8x6:30mm -o " + out);
  EXPECT_EQ(made.exit_code, 0) << made.err;
  EXPECT_THAT(made.out, HasSubstr("charuco:8x6:30mm:22.5mm:5x5 on A3"));
  EXPECT_THAT(read_text(out).value(), HasSubstr("%PDF-1.7"));
  const auto again = run_countershade("lens --board -o " + out);
  EXPECT_EQ(again.exit_code, 1);
  EXPECT_THAT(again.err, HasSubstr("exists already"));
  const auto plain = run_countershade("lens --json --board -o " + (folder / "plain.png").string());
  EXPECT_EQ(plain.exit_code, 0) << plain.err;
  EXPECT_EQ(nlohmann::json::parse(plain.out)["paper"], "A4");
}

TEST(LensVerb, SaysWhatIsWrong) {
  EXPECT_THAT(run_countershade("lens").err, HasSubstr("no photos given"));
  EXPECT_THAT(run_countershade("lens --board chesboard:9x7:20mm").err, HasSubstr("nearest is 'chessboard'"));
  EXPECT_THAT(run_countershade("lens --help").out, HasSubstr("chessboard:COLUMNSxROWS:SQUARE"));
}

// Real photographs: five poses of a chessboard of 9 x 7 inner corners.
TEST(LensVerb, CalibratesTheRealCamera) {
  const fs::path data = fs::path(COUNTERSHADE_SOURCE_DIR).parent_path() / "shared" / "data" / "graycode-board";
  if (!fs::exists(data)) GTEST_SKIP() << "'" << data.string() << "' is not on this machine";
  const TemporaryFolder folder;
  std::string photos;
  for (int pose = 0; pose < 5; ++pose) {
    const fs::path copy = folder / fmt::format("{}.png", pose);
    fs::copy_file(data / fmt::format("pose_{}/photos/0040.png", pose), copy);  // the white frame of sequence.json
    photos += " " + copy.string();
  }
  const fs::path model = folder / "camera.cameramodel";
  const auto made = run_countershade("lens --json" + photos + " --board chessboard:9x7:75mm -o " + model.string());
  ASSERT_EQ(made.exit_code, 0) << made.err;
  const auto numbers = nlohmann::json::parse(made.out);
  EXPECT_LT(numbers["held_out_px"], 0.2);  // .12 measured
  const Lens lens = read_cameramodel(model).value().lens;
  EXPECT_NEAR(lens.intrinsics()[0], 3440, 60);  // OpenCV's calibrateCamera finds 3424 to 3453
  EXPECT_TRUE(fs::exists(folder / "camera.lens" / "provenance.json"));
}

}  // namespace
}  // namespace countershade
