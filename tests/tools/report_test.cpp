#include "tools/report/html.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <regex>
#include <set>

#include "calib/file/file.h"
#include "calib/image/image_file.h"
#include "tests/support/cli.h"
#include "tools/report/colour.h"
#include "tools/report/picture.h"
#include "tools/report/plot.h"

namespace countershade::tools {
namespace {

namespace fs = std::filesystem;
using countershade::testing::TemporaryFolder;
using ::testing::HasSubstr;
using ::testing::Not;

struct Fixture {
  Image u{96, 64, 3}, c{96, 64, 3}, t{96, 64, 3};
  Mask lit{96, 64, 1, 1}, edge{96, 64, 1};
  Report report;

  Fixture() {
    for (int y = 0; y < 64; ++y)
      for (int x = 0; x < 96; ++x) {
        lit.at(x, y) = y > 3;
        edge.at(x, y) = std::abs(x - 40) < 10;
        for (int k = 0; k < 3; ++k) {
          const double veil = 0.08 * std::exp(-std::abs(x - 40) / 20.0);
          t.at(x, y, k) = static_cast<float>(0.3 + 0.003 * y + 0.02 * k);
          u.at(x, y, k) = static_cast<float>(t.at(x, y, k) + veil);
          c.at(x, y, k) = static_cast<float>(t.at(x, y, k) - 0.05 * veil);
        }
      }
    report.title = "two walls <left & right>";
    report.input.uncompensated = &u, report.input.compensated = &c, report.input.target = &t;
    report.input.lit = &lit, report.input.edge = &edge;
    report.input.edge_text = "20 columns";
    report.numbers = measure(report.input);
    report.verdict = judge(report.numbers, report.thresholds);
    report.tables = {
        {"Ladder", {"model", "reason"}, {{"one k", "chi\u00b2 > 2"}, {"k per surface", "held-out <agrees>"}}}};
    report.options = {{"bits", "8"}};
    report.warnings = {"the lamp was on"};
  }
};

std::string text_of(const fs::path& path) {
  return read_text(path).value();
}

TEST(Report, FolderHoldsPageNumbersAndPictures) {
  const TemporaryFolder folder;
  const Fixture f;
  ASSERT_TRUE(write_report(folder / "report", f.report));
  std::set<std::string> names;
  for (const auto& entry : fs::directory_iterator(folder / "report")) names.insert(entry.path().filename());
  EXPECT_EQ(names, (std::set<std::string>{"report.html", "numbers.json", "u.png", "c.png", "t.png",
                                          "difference_uncompensated.png", "difference_compensated.png",
                                          "difference_compensated_x5.png"}));
  EXPECT_TRUE(nlohmann::json::parse(text_of(folder / "report" / "numbers.json"))["pass"]);
}

TEST(Report, NeedsNothingFromElsewhere) {
  const TemporaryFolder folder;
  const Fixture f;
  ASSERT_TRUE(write_report(folder / "report", f.report));
  const std::string html = text_of(folder / "report" / "report.html");
  EXPECT_THAT(html, Not(HasSubstr("http://")));
  EXPECT_THAT(html, Not(HasSubstr("https://")));
  EXPECT_THAT(html, Not(HasSubstr("@import")));
  EXPECT_THAT(html, Not(HasSubstr("url(")));
  EXPECT_THAT(html, Not(HasSubstr("<link")));
  EXPECT_THAT(html, Not(HasSubstr("<script")));
  int sources = 0;
  for (std::size_t at = html.find("src="); at != std::string::npos; at = html.find("src=", at + 1), ++sources)
    EXPECT_EQ(html.substr(at + 5, 22), "data:image/png;base64,");
  EXPECT_EQ(sources, 6);
}

TEST(Report, ShowsTextAsTextNotAsMarkup) {
  const TemporaryFolder folder;
  const Fixture f;
  ASSERT_TRUE(write_report(folder / "report", f.report));
  const std::string html = text_of(folder / "report" / "report.html");
  EXPECT_THAT(html, HasSubstr("two walls &lt;left &amp; right&gt;"));
  EXPECT_THAT(html, HasSubstr("held-out &lt;agrees&gt;"));
  EXPECT_THAT(html, Not(HasSubstr("<agrees>")));
  EXPECT_THAT(html, HasSubstr("the lamp was on"));
}

TEST(Report, EveryElementIsClosed) {
  const TemporaryFolder folder;
  const Fixture f;
  ASSERT_TRUE(write_report(folder / "report", f.report));
  std::string html = text_of(folder / "report" / "report.html");
  html = std::regex_replace(html, std::regex("data:image/png;base64,[A-Za-z0-9+/=]*"), "");
  for (const char* tag : {"div", "figure", "table", "tr", "td", "th", "svg", "text", "p", "ul", "li", "h2", "h3"}) {
    const auto count = [&](const std::string& pattern) {
      const std::regex expression(pattern);
      return std::distance(std::sregex_iterator(html.begin(), html.end(), expression), std::sregex_iterator());
    };
    EXPECT_EQ(count(fmt::format("<{}[ >]", tag)), count(fmt::format("</{}>", tag))) << tag;
  }
}

TEST(Report, SaysWhyItFails) {
  const TemporaryFolder folder;
  Fixture f;
  f.c = f.u;
  f.report.numbers = measure(f.report.input);
  f.report.verdict = judge(f.report.numbers, {});
  ASSERT_TRUE(write_report(folder / "report", f.report));
  const std::string html = text_of(folder / "report" / "report.html");
  EXPECT_THAT(html, HasSubstr(">FAIL<"));
  EXPECT_THAT(html, HasSubstr("suppression 1.0x is below 10x"));
}

TEST(Report, LeavesNothingBehindWhenItCannotBeWritten) {
  const TemporaryFolder folder;
  const Fixture f;
  // A file where a folder should be cannot be written below, whoever asks (root may write to read-only folders).
  ASSERT_TRUE(write_atomically(folder / "file", "x"));
  const Result<void> refused = write_report(folder / "file" / "report", f.report);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, ErrorCode::kIo);
  EXPECT_EQ(std::distance(fs::directory_iterator(folder.path()), fs::directory_iterator()), 1);
}

TEST(Report, LeavesNothingBehindWhenAnExhibitIsMissing) {
  const TemporaryFolder folder;
  Fixture f;
  f.report.exhibits = {{"rejected", folder / "missing.png"}};
  ASSERT_FALSE(write_report(folder / "report", f.report));
  EXPECT_TRUE(fs::is_empty(folder.path()));
}

TEST(Report, DoesNotReplaceAnEarlierOne) {
  const TemporaryFolder folder;
  const Fixture f;
  ASSERT_TRUE(write_report(folder / "report", f.report));
  const Result<void> again = write_report(folder / "report", f.report);
  ASSERT_FALSE(again);
  EXPECT_EQ(again.error().code, ErrorCode::kExists);
}

TEST(Report, PicturesHoldTheDocumentedScale) {
  const TemporaryFolder folder;
  Fixture f;
  f.c.at(70, 50, 1) = f.t.at(70, 50, 1) + 0.05f;  // white is 1: half of the scale's end
  f.t.at(20, 30, 0) = NAN;
  ASSERT_TRUE(write_report(folder / "report", f.report));
  const StoredImage difference = read_image(folder / "report" / "difference_compensated.png").value();
  const StoredImage amplified = read_image(folder / "report" / "difference_compensated_x5.png").value();
  const StoredImage target = read_image(folder / "report" / "t.png").value();
  const Rgb half = diverging(0.5), full = diverging(1);
  for (int k = 0; k < 3; ++k) {
    EXPECT_NEAR(difference.values.at(70, 50, k), 255 * half[k], 0.6);  // rounded to 8 bits
    EXPECT_NEAR(amplified.values.at(70, 50, k), 255 * full[k], 0.6);   // 25 % of the scale: clamped to its end
    EXPECT_NEAR(target.values.at(71, 50, k), 255 * srgb_encode(f.t.at(71, 50, k)), 0.6);
  }
  for (auto [x, y] : {std::pair{20, 30}, std::pair{50, 1}})  // not finite; not lit
    EXPECT_EQ(difference.values.at(x, y, 0), std::lround(255 * 0.33));
}

TEST(DataUri, EncodesEveryLengthAsTheStandardDoes) {
  const std::string head = "data:image/png;base64,";
  EXPECT_EQ(data_uri(""), head);
  EXPECT_EQ(data_uri("f"), head + "Zg==");
  EXPECT_EQ(data_uri("fo"), head + "Zm8=");
  EXPECT_EQ(data_uri("foo"), head + "Zm9v");
  EXPECT_EQ(data_uri("foobar"), head + "Zm9vYmFy");
  EXPECT_EQ(data_uri("\xff\xfe"), head + "//4=");
}

TEST(RoundTicks, CoverTheRangeWithRoundSteps) {
  for (auto [low, high] :
       {std::pair{0.0, 1.0}, std::pair{-3.7, 12.2}, std::pair{0.0, 0.00031}, std::pair{990.0, 1010.0}}) {
    const std::vector<double> ticks = round_ticks(low, high, 5);
    const double step = ticks[1] - ticks[0], mantissa = step / std::pow(10, std::floor(std::log10(step) + 1e-9));
    EXPECT_LE(ticks.front(), low + 1e-9);
    EXPECT_GE(ticks.back(), high - 1e-9);
    EXPECT_LE(ticks.size(), 8u);
    EXPECT_GE(ticks.size(), 3u);
    // Differences of ticks carry rounding of the ticks themselves.
    EXPECT_TRUE(std::abs(mantissa - 1) < 1e-6 || std::abs(mantissa - 2) < 1e-6 || std::abs(mantissa - 5) < 1e-6)
        << step;
  }
}

TEST(PlotSvg, BreaksTheLineWhereAPointIsMissing) {
  const Series s{"a", "red", {0, 1, 2, 3, 4}, {1, 2, NAN, 4, 5}};
  const std::string svg = plot_svg({s}, "x", "y");
  const std::string path = svg.substr(svg.find("<path d='") + 9);
  const std::string line = path.substr(0, path.find('\''));
  EXPECT_EQ(std::count(line.begin(), line.end(), 'M'), 2);
  EXPECT_THAT(svg, Not(HasSubstr("nan")));
}

TEST(PlotSvg, SaysWhenThereIsNoData) {
  EXPECT_THAT(plot_svg({{"a", "red", {0, 1}, {NAN, NAN}}}, "x", "y"), HasSubstr("no data"));
  EXPECT_THAT(plot_svg({}, "x", "y"), HasSubstr("no data"));
}

}  // namespace
}  // namespace countershade::tools
