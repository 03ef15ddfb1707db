#include "capture/device/video/photo_clock.h"

#include <gtest/gtest.h>

#include <functional>

#include "calib/base/random.h"

namespace countershade::capture {
namespace {

constexpr double kPeriod = 0.03, kReadOut = 0.02;

// A camera that exposes from n periods on, whose driver gives photo n the time `stamp`. Asked at many moments: the
// earliest start of an exposure that is given out, relative to the question; and how long it took at most to get it.
struct Served {
  double earliest = 1e9, latest = 0;
};
Served served(double exposure, bool same_clock, const std::function<double(int, double start, double arrived)>& stamp,
              double known_exposure) {
  Served s;
  Random random(hash_name("photo clock"));
  PhotoClock clock;
  double now = 2000;
  int next = 0;  // photo that arrives next
  for (int question = 0; question < 200; ++question) {
    now += random.uniform(0, 0.2);
    while (next * kPeriod + exposure + kReadOut <= now) ++next;  // what waited was thrown away
    clock.ask(now);
    for (;; ++next) {
      const double start = next * kPeriod, arrived = start + exposure + kReadOut;
      if (clock.of_before(stamp(next, start, arrived), same_clock, arrived, known_exposure)) continue;
      s.earliest = std::min(s.earliest, start - now), s.latest = std::max(s.latest, arrived - now);
      now = arrived, ++next;
      break;
    }
  }
  return s;
}

TEST(PhotoClock, GivesOutNoPhotoThatWasBegunBefore) {
  for (const double exposure : {0.001, 0.01, 0.03}) {
    const auto start = [](int, double from, double) { return from; };
    const auto end = [&](int, double from, double) { return from + exposure; };
    for (const auto& stamp : {std::function<double(int, double, double)>(start), {end}}) {
      const Served s = served(exposure, true, stamp, exposure);
      EXPECT_GE(s.earliest, 0) << exposure;
      EXPECT_LE(s.latest, exposure + kPeriod + exposure + kReadOut + 1e-9) << "and no later than it must";
    }
  }
}

// Then two photos that were under way are dropped; and a contradiction is seen at once, not after many photos.
TEST(PhotoClock, TimesThatCannotBeTrueAreNotBelieved) {
  using Stamp = std::function<double(int, double start, double arrived)>;
  struct Case {
    const char* name;
    Stamp stamp;
    int photos;  // that may go by before the first is given out
  };
  const Case cases[] = {
      {"in the future", [](int, double, double arrived) { return arrived + 0.17; }, 4},
      {"standing still", [](int, double, double) { return 1990.0; }, 4},
      {"backwards", [](int n, double from, double) { return 1990 - 1e-3 * (n % 7) + 0 * from; }, 4},
      {"of another clock that runs", [](int, double from, double) { return from - 1000; }, 64},
  };
  for (const Case& c : cases) {
    const Served s = served(0.01, true, c.stamp, 0.01);
    EXPECT_GE(s.earliest, 0) << c.name;
    EXPECT_LE(s.latest, c.photos * kPeriod + 0.01 + kReadOut) << c.name;
  }
  EXPECT_GE(served(
                0.01, false, [](int, double from, double) { return from + 0.2; }, 0.01)
                .earliest,
            0);
  EXPECT_GE(served(
                0.03, true, [](int, double from, double) { return from + 0.03; }, 0)
                .earliest,
            0)
      << "not known";
}

TEST(PhotoClock, AChangeOfExposureIsNoContradiction) {
  PhotoClock clock;
  clock.ask(1);
  EXPECT_FALSE(clock.of_before(1.05, true, 1.06, 0.01));
  clock.ask(1.07);
  EXPECT_TRUE(clock.of_before(1.08, true, 1.09, 0.05));
  EXPECT_TRUE(clock.believed());
  EXPECT_FALSE(clock.of_before(1.13, true, 1.14, 0.05));
}

}  // namespace
}  // namespace countershade::capture
