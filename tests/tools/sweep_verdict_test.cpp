// The verdict of a sweep follows from its points alone.
#include "tools/bench/sweep/sweep_verdict.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace countershade::bench {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

constexpr SweepBounds kBounds{0.5, 0.4};

// A show that leaves `percent` of white, with a verify that passed.
SweepPoint shown(double percent) {
  SweepPoint p;
  p.series = "one";
  p.methods = {{4, 1}, {percent, 4 / percent}};
  p.pass = true;
  p.held_out_percent = 0.1;
  return p;
}

TEST(SweepVerdict, APassIsSilenceAboutAWrongShow) {
  EXPECT_EQ(judge(shown(0.51), kBounds), PointVerdict::kSilent);
  EXPECT_EQ(judge(shown(0.5), kBounds), PointVerdict::kRight);  // the bound itself is within
  SweepPoint unverified = shown(0.51);
  unverified.pass.reset();
  EXPECT_EQ(said(unverified, kBounds), Said::kNothing);
  EXPECT_EQ(judge(unverified, kBounds), PointVerdict::kSilent);
}

TEST(SweepVerdict, EveryKindOfComplaintEndsTheSilence) {
  std::vector<SweepPoint> points(4, shown(2));
  points[0].refusal = "k > 1";
  points[1].pass = false;
  points[2].check = "camera: stale frames";
  points[3].held_out_percent = 0.41;
  std::vector<Said> heard;
  for (const SweepPoint& p : points) heard.push_back(said(p, kBounds));
  EXPECT_THAT(heard, ElementsAre(Said::kRefused, Said::kFail, Said::kCheck, Said::kHeldOut));
  EXPECT_EQ(judge(points[0], kBounds), PointVerdict::kRefused);
  for (int i = 1; i < 4; ++i) EXPECT_EQ(judge(points[i], kBounds), PointVerdict::kSaidSo) << i;
}

TEST(SweepVerdict, ANoteIsNoComplaint) {
  SweepPoint wrong = shown(2), right = shown(0.1);
  wrong.notes = right.notes = "taking it again";
  EXPECT_EQ(said(wrong, kBounds), Said::kNoted);
  EXPECT_EQ(judge(wrong, kBounds), PointVerdict::kSilent);
  EXPECT_EQ(judge(right, kBounds), PointVerdict::kRight);
}

TEST(SweepVerdict, TheLoudestComplaintIsTheOneThatIsTold) {
  SweepPoint p = shown(2);
  p.notes = "taking it again", p.check = "latency", p.pass = false;
  EXPECT_EQ(said(p, kBounds), Said::kFail);
  p.pass = true;
  EXPECT_EQ(said(p, kBounds), Said::kCheck);
}

TEST(SweepVerdict, AComplaintAboutARightShowIsAFalseAlarm) {
  SweepPoint p = shown(0.3);
  p.pass = false;
  EXPECT_EQ(judge(p, kBounds), PointVerdict::kFalseAlarm);
}

// A decoded code, of which the program prints what is so.
SweepPoint decoded(double accepted, double wrong) {
  SweepPoint p;
  p.series = "one";
  Decoding& d = p.decoding.emplace();
  d.accepted_percent = d.printed_percent = accepted, d.forecast_percent = 99;
  d.wrong_percent = wrong, d.z = 1;
  return p;
}

TEST(SweepVerdict, DecodingIsRightWithFewWrongAmongManyAccepted) {
  EXPECT_EQ(judge(decoded(90, 0.2), kBounds), PointVerdict::kRight);  // the bounds themselves are within
  EXPECT_EQ(judge(decoded(95, 0.21), kBounds), PointVerdict::kSilent);
  SweepPoint blind = decoded(95, 0.1);
  blind.decoding->z = 3.1;
  EXPECT_EQ(judge(blind, kBounds), PointVerdict::kSilent);
  SweepPoint hidden = decoded(89, 0.1);
  hidden.decoding->printed_percent = 99;  // what was lost is not among what it takes for lit
  EXPECT_EQ(judge(hidden, kBounds), PointVerdict::kSilent);
  EXPECT_FALSE(judge(std::vector<SweepPoint>{hidden}, kBounds).ok());
  EXPECT_EQ(judge(decoded(kUnknown, kUnknown), kBounds), PointVerdict::kSilent);
}

TEST(SweepVerdict, PrintedSharesOfDecodedPixelsAreComplaintsBelowTheirBound) {
  EXPECT_EQ(judge(decoded(89, 0.1), kBounds), PointVerdict::kSaidSo);
  EXPECT_EQ(said(decoded(89, 0.1), kBounds), Said::kFew);
  SweepPoint forecast = decoded(95, 0.1);
  forecast.decoding->forecast_percent = 80;
  EXPECT_EQ(judge(forecast, kBounds), PointVerdict::kFalseAlarm);
  SweepPoint told = decoded(95, 5);
  told.calibrate = "something moved", told.notes = "taking it again";
  EXPECT_EQ(said(told, kBounds), Said::kCalibrate);
  EXPECT_EQ(judge(told, kBounds), PointVerdict::kSaidSo);
  told.refusal = "no";
  EXPECT_EQ(judge(told, kBounds), PointVerdict::kRefused);
}

TEST(SweepVerdict, WorstSilentDecodingIsCountedInWrongPixels) {
  const SweepVerdict v = judge(std::vector<SweepPoint>{decoded(99, 0.7), decoded(99, 3)}, kBounds);
  EXPECT_DOUBLE_EQ(v.worst_silent_percent, 3);
  EXPECT_THAT(text_of(v), HasSubstr("2 wrong in silence (up to 3.00 % wrong pixels)"));
}

TEST(SweepVerdict, AResidualThatIsNoNumberIsNotWithinTheBound) {
  SweepPoint p = shown(0.3);
  p.methods.back().percent = kUnknown;
  EXPECT_EQ(judge(p, kBounds), PointVerdict::kSilent);
  p.methods.clear();
  EXPECT_EQ(judge(p, kBounds), PointVerdict::kSilent);
}

TEST(SweepVerdict, OneSilentWrongAnswerMakesASweepShort) {
  SweepPoint refused = shown(9), told = shown(3);
  refused.refusal = "no";
  told.pass = false;
  std::vector<SweepPoint> points{shown(0.1), refused, told};
  EXPECT_TRUE(judge(points, kBounds).ok());
  points.push_back(shown(0.7));
  points.push_back(shown(0.6));
  const SweepVerdict v = judge(points, kBounds);
  EXPECT_FALSE(v.ok());
  EXPECT_EQ(v.right, 1);
  EXPECT_EQ(v.refused, 1);
  EXPECT_EQ(v.said_so, 1);
  EXPECT_EQ(v.silent, 2);
  EXPECT_DOUBLE_EQ(v.worst_silent_percent, 0.7);
  EXPECT_THAT(text_of(v), HasSubstr("2 wrong in silence (up to 0.70 % of white)"));
}

TEST(SweepVerdict, CountsWhatOnlyVerifyNoticed) {
  SweepPoint failed = shown(2), checked = shown(2), alarmed = shown(0.1);
  failed.pass = checked.pass = alarmed.pass = false;
  failed.notes = "taking it again";
  checked.check = "latency";
  const SweepVerdict v = judge(std::vector<SweepPoint>{failed, checked, alarmed}, kBounds);
  EXPECT_EQ(v.said_so, 2);
  EXPECT_EQ(v.by_verify_alone, 1);
}

TEST(SweepVerdict, ASweepWithoutPointsProvesNothing) {
  EXPECT_FALSE(judge(std::vector<SweepPoint>(), kBounds).ok());
  SweepPoint refused;
  refused.refusal = "no";
  EXPECT_FALSE(judge(std::vector<SweepPoint>(2, refused), kBounds).ok());
}

TEST(SweepTable, HasOneCellPerColumnAndADashForWhatIsUnknown) {
  SweepPoint refused;
  refused.series = "two", refused.value = 3, refused.methods = {{4, 1}};
  refused.refusal = "surface 0 reflects 104 %, more than all";
  Study study;
  fill_table({"none", "ours"}, {shown(0.25), refused}, kBounds, study);
  ASSERT_EQ(study.rows.size(), 2u);
  for (const auto& row : study.rows) EXPECT_EQ(row.size(), study.columns.size());
  EXPECT_THAT(study.columns,
              ElementsAre("series", "value", "predictor", "none % W", "none x", "ours % W", "ours x", "held-out % W",
                          "chi2", "reprojection px", "verify x", "said", "verdict", "in its words"));
  EXPECT_EQ(study.rows[0][5], "0.250");
  EXPECT_EQ(study.rows[1][5], "-");
  EXPECT_EQ(study.rows[1][11], "refused");
  EXPECT_EQ(study.rows[1][13], "surface 0 reflects 104 %, more than all");
}

TEST(SweepTable, OfDecodingHasItsOwnColumns) {
  SweepPoint refused;
  refused.decoding.emplace(), refused.refusal = "no stripes";
  SweepPoint right = decoded(98, 0.05);
  right.decoding->codes = "gray, xor-04";
  Study study;
  fill_table({"ours"}, {right, refused}, kBounds, study);
  ASSERT_EQ(study.rows.size(), 2u);
  for (const auto& row : study.rows) EXPECT_EQ(row.size(), study.columns.size());
  EXPECT_EQ(study.columns[3], "accepted %");
  EXPECT_EQ(study.rows[0][3], "98.00");
  EXPECT_EQ(study.columns[8], "code");
  EXPECT_EQ(study.rows[0][8], "gray, xor-04");
  EXPECT_EQ(study.rows[1][3], "-");
  EXPECT_EQ(study.rows[1].back(), "no stripes");
}

TEST(SweepTable, QuotesCellsThatWouldBreakACsv) {
  Study study;
  study.columns = {"a", "b"};
  study.rows = {{"1, 2", "say \"no\""}, {"plain", "two\nlines"}};
  EXPECT_EQ(csv_of(study), "a,b\n\"1, 2\",\"say \"\"no\"\"\"\nplain,\"two\nlines\"\n");
}

}  // namespace
}  // namespace countershade::bench
