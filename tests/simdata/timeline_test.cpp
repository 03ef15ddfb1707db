// What is visible when: a part's share is its share of the time.
#include "simdata/device/timeline.h"

#include <gtest/gtest.h>

#include <cmath>

namespace countershade::simdata {
namespace {

using Parts = std::vector<Timeline::Part>;

Shown shown(std::uint64_t hash) {
  return {nullptr, hash};
}
Timeline timeline(const SimulatedProjector& spec) {
  return Timeline(spec, 7, shown(1));
}
SimulatedProjector fifty_hertz() {
  SimulatedProjector p;
  p.id = "p";
  p.refresh_hz = 50;
  return p;
}
// Share of a picture, of one primary, in a row (shares that are equal in all rows are given once); 0 = not seen.
double share(const Parts& parts, std::uint64_t hash, int c = 0, int row = 0) {
  for (const Timeline::Part& p : parts)
    if (p.shown.hash == hash) return p.share[p.share.size() > 1 ? row : 0][c];
  return 0;
}

constexpr double kSnap = 1e-7;  // shares are multiples of 2^-24

TEST(Timeline, PictureIsSeenFromTheFirstRefreshAfterItsLatency) {
  SimulatedProjector p = fifty_hertz();
  for (const auto& [latency, from] : {std::pair{0., .02}, {15., .02}, {25., .04}, {60., .08}}) {
    p.latency_ms = latency;
    Timeline t = timeline(p);
    EXPECT_NEAR(t.show(shown(2), shown(2), .003), .02, 1e-12) << "the computer waits for the refresh alone";
    EXPECT_EQ(share(t.parts({from - .011, .01}, {}), 1), 1) << latency;
    EXPECT_EQ(share(t.parts({from, .01}, {}), 2), 1) << latency;
  }
  Timeline t = timeline(fifty_hertz());
  double now = 0;  // one show per refresh, however many refreshes
  for (int i = 1; i <= 1000; ++i) now = t.show(shown(2 + i), shown(2 + i), now);
  EXPECT_NEAR(now, 20, 1e-9);
}

TEST(Timeline, SharesOfAMixtureAreSharesOfTheTime) {
  SimulatedProjector p = fifty_hertz();
  p.latency_ms = 25;
  Timeline t = timeline(p);
  t.show(shown(2), shown(2), 0);
  t.show(shown(3), shown(3), .016);
  const Parts parts = t.parts({.033, .04}, {});  // 7 ms of the first, 20 of the second, 13 of the third
  ASSERT_EQ(parts.size(), 3u);
  EXPECT_NEAR(share(parts, 1), 7. / 40, kSnap);
  EXPECT_NEAR(share(parts, 2), 20. / 40, kSnap);
  EXPECT_NEAR(share(parts, 3), 13. / 40, kSnap);
  EXPECT_EQ(share(t.parts({.033, .04}, {}, true), 3), 0) << "the newest is not there yet";
}

TEST(Timeline, PictureThatIsSentAgainIsNoMixture) {
  Timeline t = timeline(fifty_hertz());
  t.show(shown(2), shown(2), 0);
  t.show(shown(2), shown(2), .03);
  const Parts parts = t.parts({.0237, .0313}, {});
  ASSERT_EQ(parts.size(), 1u);
  EXPECT_EQ(share(parts, 2), 1);
}

TEST(Timeline, RollingShutterSeesTheOldPictureInItsFirstRowsAndTheNewOneInItsLast) {
  Timeline t = timeline(fifty_hertz());
  t.show(shown(2), shown(2), 0);
  const RowExposure e{.005, .01, .02,
                      101};  // rows 200 us apart; the change, at 20 ms, is 15 ms after the first's start
  const Parts parts = t.parts(e, {});
  for (int y = 0; y < 101; ++y) {
    const double old = std::clamp((.015 - .0002 * y) / .01, 0., 1.);
    EXPECT_NEAR(share(parts, 1, 0, y), old, kSnap) << y;
    EXPECT_NEAR(share(parts, 2, 0, y), 1 - old, kSnap) << y;
  }
  EXPECT_EQ(share(parts, 1, 0, 25), 1);
  EXPECT_EQ(share(parts, 2, 0, 75), 1);
}

TEST(Timeline, WheelShowsOnePrimaryAfterTheOther) {
  SimulatedProjector p = fifty_hertz();
  p.colour_wheel_hz = 100;  // red 0 - 3.33 ms, green - 6.67, blue - 10
  const Timeline t = timeline(p);
  for (int turns = 1; turns <= 3; ++turns)
    for (double start : {0., .0017, .0123})
      for (int c = 0; c < 3; ++c) EXPECT_EQ(share(t.parts({start, .01 * turns}, {}), 1, c), 1) << start;
  const Parts green = t.parts({.034, .002}, {});
  EXPECT_EQ(share(green, 1, 0), 0);
  EXPECT_EQ(share(green, 1, 1), 3);
  EXPECT_EQ(share(green, 1, 2), 0);
  const Parts two = t.parts({.005, .0025}, {});  // 1.67 ms of green, .83 of blue
  EXPECT_NEAR(share(two, 1, 1), 2, kSnap * 3);
  EXPECT_NEAR(share(two, 1, 2), 1, kSnap * 3);
}

TEST(Timeline, PulsesAreOnForHalfOfEachPeriodAndKeepTheMean) {
  SimulatedProjector p = fifty_hertz();
  p.pwm_hz = 250;  // on for 2 ms, off for 2
  Timeline t = timeline(p);
  EXPECT_EQ(share(t.parts({.0013, .012}, {}), 1), 1);
  EXPECT_EQ(share(t.parts({.0081, .0015}, {}), 1), 2);
  EXPECT_TRUE(t.parts({.0101, .0015}, {}).empty()) << "dark: not even black is seen";
  EXPECT_NEAR(share(t.parts({.009, .004}, {}), 1), 1, kSnap);  // 1 ms on, 2 off, 1 on
  EXPECT_NEAR(share(t.parts({.009, .003}, {}), 1), 2. / 3, kSnap);
  p.pwm_hz = 1e6;
  EXPECT_EQ(share(timeline(p).parts({.009, .0300001}, {}), 1), 1) << "too fast to be counted: the mean";
}

TEST(Timeline, LampReachesItsLightExponentially) {
  SimulatedProjector p = fifty_hertz();
  p.warm_up = .4, p.warm_up_s = 20;
  const Timeline t = timeline(p);
  EXPECT_NEAR(share(t.parts({0, .001}, {}), 1), .6, 1e-4);  // half a millisecond of 20 s
  EXPECT_NEAR(share(t.parts({20, .001}, {}), 1), 1 - .4 * std::exp(-1), 1e-4);
  EXPECT_NEAR(share(t.parts({1000, .001}, {}), 1), 1, 1e-6);
}

TEST(Timeline, JitterAddsUpToItsBoundAndIsTheSameEachTime) {
  SimulatedProjector p = fifty_hertz();
  p.refresh_hz = 1000, p.latency_ms = 10, p.latency_jitter_ms = 20;
  std::vector<double> from;
  for (int twice = 0; twice < 2; ++twice) {
    Timeline t = timeline(p);
    for (int i = 0; i < 40; ++i) {
      const double now = .1 * i + .0005;
      t.show(shown(2 + i), shown(2 + i), now);
      const double late = .1 - .1 * share(t.parts({now, .1}, {}), 2 + i);
      EXPECT_GE(late, .0095);
      EXPECT_LE(late, .0315);
      from.push_back(late);
    }
  }
  EXPECT_GT(*std::max_element(from.begin(), from.end()) - *std::min_element(from.begin(), from.end()), .01);
  EXPECT_TRUE(std::equal(from.begin(), from.begin() + 40, from.begin() + 40));
}

TEST(Timeline, GlassesLetOneEyesRefreshesThroughAndALeakOfTheOthers) {
  Timeline t = timeline(fifty_hertz());
  t.show(shown(2), shown(3), 0);  // seen from 20 ms on; refresh 2, at 40 ms, is the left eye's
  for (const Glasses& g : {Glasses{1, 1}, Glasses{1, .1}, Glasses{.1, 1}}) {
    const Parts parts = t.parts({.04, .08}, g);
    EXPECT_NEAR(share(parts, 2), .5 * g.left, kSnap);
    EXPECT_NEAR(share(parts, 3), .5 * g.right, kSnap);
    const Parts left = t.parts({.041, .01}, g);
    EXPECT_NEAR(share(left, 2), g.left, kSnap);
    EXPECT_EQ(share(left, 3), 0);
  }
}

}  // namespace
}  // namespace countershade::simdata
