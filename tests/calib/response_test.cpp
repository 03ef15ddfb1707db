#include "calib/photometry/response.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

namespace countershade {
namespace {

using ::testing::HasSubstr;

Response response(const std::string& text) {
  return Response::parse(text).value();
}

const char* const kAll[] = {"linear", "srgb", "gamma:0.45", "gamma:2.2", "gamma:2.6"};

TEST(Response, SrgbHasTheValuesOfTheStandard) {
  // IEC 61966-2-1, worked out in decimal arithmetic; tolerance: rounding of a power.
  const Response srgb = response("srgb");
  EXPECT_NEAR(srgb.decode(0.5), 0.214041140482232442, 1e-15);
  EXPECT_NEAR(srgb.decode(0.2), 0.033104766570885046, 1e-15);
  EXPECT_NEAR(srgb.decode(0.02), 0.02 / 12.92, 1e-17);
  EXPECT_NEAR(srgb.encode(0.18), 0.461356129500441650, 1e-15);
  EXPECT_NEAR(srgb.encode(0.001), 0.01292, 1e-17);
}

TEST(Response, GammaIsAPower) {
  const Response gamma = response("gamma:2.2");
  EXPECT_NEAR(gamma.decode(0.5), 0.2176376408240310, 1e-14);  // 2^-2.2; the digits given
  EXPECT_NEAR(gamma.encode(0.25), std::exp2(-2 / 2.2), 1e-15);
}

TEST(Response, EncodeUndoesDecode) {
  for (const char* text : kAll) {
    const Response r = response(text);
    for (int i = 0; i <= 4095; ++i) {
      const double v = i / 4095.0;
      EXPECT_NEAR(r.encode(r.decode(v)), v, 1e-12) << text;  // two powers, each good to a few 1e-16
      EXPECT_NEAR(r.decode(r.encode(v)), v, 1e-12) << text;
    }
  }
}

TEST(Response, RunsFromBlackToWhiteAndOnlyUp) {
  for (const char* text : kAll) {
    const Response r = response(text);
    EXPECT_EQ(r.decode(0), 0) << text;
    EXPECT_EQ(r.encode(0), 0) << text;
    EXPECT_NEAR(r.decode(1), 1, 1e-15) << text;  // 1.055 - .055 rounds
    EXPECT_NEAR(r.encode(1), 1, 1e-15) << text;
    for (int i = 0; i < 2000; ++i) {
      EXPECT_LT(r.decode(i / 2000.0), r.decode((i + 1) / 2000.0)) << text << " at " << i;
      EXPECT_LT(r.encode(i / 2000.0), r.encode((i + 1) / 2000.0)) << text << " at " << i;
    }
  }
}

TEST(Response, ClampsWhatLiesOutside) {
  for (const char* text : kAll) {
    const Response r = response(text);
    EXPECT_EQ(r.decode(-0.3), r.decode(0));
    EXPECT_EQ(r.decode(1.7), r.decode(1));
    EXPECT_EQ(r.encode(-0.3), r.encode(0));
    EXPECT_EQ(r.encode(1.7), r.encode(1));
  }
}

TEST(Response, TableHoldsDecodeAtEqualSteps) {
  const Response r = response("gamma:1.7");
  const std::vector<float> table = r.decode_table(1021);
  ASSERT_EQ(table.size(), 1021);
  EXPECT_EQ(table[0], 0);
  EXPECT_EQ(table[1020], 1);
  for (int i : {1, 17, 511, 1019}) EXPECT_EQ(table[i], static_cast<float>(std::pow(i / 1020.0, 1.7)));
  EXPECT_THROW(r.decode_table(1), Bug);
}

TEST(Response, KeepsItsText) {
  EXPECT_EQ(Response().text(), "linear");
  for (const char* text : kAll) EXPECT_EQ(response(text).text(), text);
}

TEST(Response, RefusesWhatItDoesNotKnowByName) {
  for (const char* text : {"", "sRGB", "gamma", "gamma:", "gamma:x", "gamma:2.2x", "gamma:0", "gamma:0.19",
                           "gamma:5.01", "gamma:-2", "gamma:nan", "gamma:inf", "measured", "linear "}) {
    const auto result = Response::parse(text);
    ASSERT_FALSE(result) << text;
    EXPECT_EQ(result.error().code, ErrorCode::kBadValue);
    EXPECT_THAT(result.error().message, HasSubstr("'" + std::string(text) + "'"));
    EXPECT_THAT(result.error().message, HasSubstr("gamma:2.2"));
  }
  EXPECT_TRUE(Response::parse("gamma:0.2"));
  EXPECT_TRUE(Response::parse("gamma:5"));
}

TEST(ProjectorResponse, EmitsItsBlackLevelAtLeast) {
  const ProjectorResponse projector{response("gamma:2.2"), 0.004};
  EXPECT_EQ(projector.light(0), 0.004);
  EXPECT_NEAR(projector.light(1), 1, 1e-15);                                     // rounding
  EXPECT_NEAR(projector.light(0.5), 0.004 + 0.996 * 0.2176376408240310, 1e-14);  // the digits given
  EXPECT_EQ(projector.encoded(0.001), 0);
  EXPECT_EQ(projector.encoded(1.3), 1);
  for (double v : {0.0, 0.1, 0.37, 0.92, 1.0})
    EXPECT_NEAR(projector.encoded(projector.light(v)), v, 1e-12);  // .1 is 1.5 times its black: no digits are lost
}

}  // namespace
}  // namespace countershade
