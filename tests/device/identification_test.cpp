// Identification pictures on a true display.
#include "tools/job/check/identification.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <future>
#include <set>
#include <thread>

#include "calib/file/file.h"
#include "capture/device/window.h"
#include "tests/support/cli.h"
#include "tests/support/xvfb.h"

namespace countershade::tools {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

int value(const Picture& picture, int x, int y) {
  return picture.at(x, y) / 257;
}

TEST(Identification, WhatIsCutOffOrScaledIsMissingOrUneven) {
  for (const auto& [width, height] : {std::pair{1280, 800}, {641, 479}, {64, 40}}) {
    const Picture picture = identification_picture(width, height, {"HDMI-1"});
    int border = 0, alternating = 0;
    std::set<int> greys;
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x) {
        if (x == 0 || y == 0 || x == width - 1 || y == height - 1) border += value(picture, x, y) == 255;
        const bool inside = x > 1 && y > 1 && x < width - 1 && y < height - 1;
        alternating += inside && value(picture, x, y) == 255 && value(picture, x - 1, y) == 0 &&
                       value(picture, x, y - 1) == 0 && value(picture, x - 1, y - 1) == 255;
        greys.insert(value(picture, x, y));
      }
    EXPECT_EQ(border, 2 * (width + height) - 4);
    if (width == 64) continue;  // hardly more than its frame
    EXPECT_GT(alternating, width * height / 200) << "single pixels";
    for (int step = 0; step < 8; ++step)
      EXPECT_TRUE(greys.contains(4 * step) && greys.contains(255 - 4 * step)) << step;
  }
}

TEST(Identification, NamesTheProjectorThatTheRigPutsThere) {
  Rig rig;
  rig.projectors.resize(2);
  rig.projectors[0].id = "left", rig.projectors[0].monitor = "HDMI-1";
  rig.projectors[1].id = "right", rig.projectors[1].monitor = "DP-2";
  EXPECT_THAT(identification_text({"DP-2", 1280, 800, 60}, &rig),
              ElementsAre("DP-2", "1280 x 800, 60 Hz", "projector right"));
  rig.projectors[0].monitor = "EPS EB-L1755U X4KJ930";  // wherever it is plugged in
  EXPECT_THAT(identification_text({"DP-3", 1280, 800, 60, "", "EPS EB-L1755U X4KJ930"}, &rig),
              ElementsAre("DP-3", "1280 x 800, 60 Hz", "EPS EB-L1755U X4KJ930", "projector left"));
  rig.projectors[0].monitor = "";
  EXPECT_THAT(identification_text({"DP-3", 1280, 800, 60}, &rig), ElementsAre("DP-3", "1280 x 800, 60 Hz"));
  EXPECT_THAT(identification_text({"DP-2", 1280, 800, 60}, nullptr), ElementsAre("DP-2", "1280 x 800, 60 Hz"));
  EXPECT_NE(identification_picture(640, 400, {"DP-2"}).data(), identification_picture(640, 400, {"DP-3"}).data());
}

TEST(Identification, IsShownPixelByPixelOnEveryMonitor) {
  const testing::TemporaryFolder folder;
  const testing::XvfbDisplay display(folder / "display", 400, 300);
  if (!display.running()) GTEST_SKIP() << "Xvfb is not installed";
  ASSERT_TRUE(write_atomically(folder / "rig.toml",
                               "[[camera]]\nid = \"camera\"\n[[projector]]\nid = \"left\"\nresolution = [400, 300]\n"
                               "output = \"window\"\nmonitor = \"screen\"\n"));
  setenv("DISPLAY", display.name().c_str(), 1);
  unsetenv("WAYLAND_DISPLAY");
  auto command = std::async(std::launch::async, [&] {
    return testing::run_countershade("devices --identify 4 --rig " + (folder / "rig.toml").string());
  });
  const Picture expected = identification_picture(400, 300, {"screen", "400 x 300", "projector left"});
  std::vector<std::uint8_t> bytes;
  for (const std::uint16_t v : expected.data()) bytes.push_back(static_cast<std::uint8_t>(v / 257));
  bool seen = false;
  for (int i = 0; i < 300 && !seen && command.wait_for(std::chrono::milliseconds(50)) != std::future_status::ready; ++i)
    seen = display.pixels(400, 300) == bytes;
  const testing::CommandResult said = command.get();
  EXPECT_TRUE(seen) << said.out << said.err;
  EXPECT_EQ(said.exit_code, 0);
  EXPECT_THAT(said.out, HasSubstr("monitor = \"screen\""));
}

// Test displays return no table that could be relied on; what is made of one is tested.
TEST(Desktop, ATableThatChangesColoursIsNamed) {
  const auto table = [](int size, double top, double exponent) {
    std::vector<unsigned short> values;
    for (int i = 0; i < size; ++i)
      values.push_back(static_cast<unsigned short>(std::lround(65535 * top * std::pow(i / (size - 1.0), exponent))));
    return values;
  };
  for (const int size : {2, 256, 1024}) {
    const auto whole = table(size, 1, 1), dim = table(size, 0.985, 1);
    EXPECT_EQ(capture::altered_by_table(whole, whole, whole), "");
    EXPECT_EQ(capture::altered_by_table(whole, whole, dim), "") << "rounding of profiles";
    EXPECT_EQ(capture::altered_by_table(table(size, 0, 1), table(size, 0, 1), table(size, 0, 1)), "");
  }
  EXPECT_EQ(capture::altered_by_table({}, {}, {}), "");
  EXPECT_THAT(
      capture::altered_by_table(table(1025, 1, 1), table(1025, 0.86, 1), table(1025, 0.71, 1)),
      ::testing::AllOf(HasSubstr("white leaves as 100, 86, 71 %, half as 50, 43, 36 %"), HasSubstr("night light")));
  const auto bent = table(257, 1, 1.1);
  EXPECT_THAT(capture::altered_by_table(bent, bent, bent), HasSubstr("half as 47, 47, 47 %"));
}

}  // namespace
}  // namespace countershade::tools
