#include "capture/pattern/read/reject.h"

#include <gmock/gmock.h>

#include <cmath>
#include <functional>
#include <limits>
#include <set>

#include "calib/base/random.h"
#include "tests/capture/fake_view.h"

namespace countershade::capture {
namespace {

constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();

// What is read of a map at every pixel; where `read` says no, the reason is given.
Correspondence reading(int width, int height, const std::function<std::pair<double, double>(int, int)>& map,
                       const std::function<bool(int, int)>& read, Reason why) {
  Correspondence c;
  c.projector_resolution = {1280, 800};
  c.x = c.y = c.sigma = Image(width, height, 1, kNaN);
  c.reason = Mask(width, height, 1);
  for (int v = 0; v < height; ++v)
    for (int u = 0; u < width; ++u) {
      ++c.lit;
      if (!read(u, v)) {
        c.reason.at(u, v) = static_cast<std::uint8_t>(why);
        continue;
      }
      const auto [x, y] = map(u, v);
      c.x.at(u, v) = static_cast<float>(x), c.y.at(u, v) = static_cast<float>(y), c.sigma.at(u, v) = 0.05f;
      ++c.accepted;
    }
  return c;
}

int count(const Correspondence& c, Reason reason) {
  return static_cast<int>(
      std::count(c.reason.data().begin(), c.reason.data().end(), static_cast<std::uint8_t>(reason)));
}

// A slanted border, and a band of three pixels along it that nothing is read in.
double across(int u, int v) {
  return u + 0.4 * v - 30;
}
bool beside(int u, int v) {
  return std::abs(across(u, v)) > 1.5;
}

TEST(NameMixed, IsWhatLiesBetweenTwoSurfaces) {
  for (const Reason why : {Reason::kUncertainBit, Reason::kInconsistent, Reason::kIsolated, Reason::kPhase}) {
    Correspondence c = reading(
        60, 40,
        [](int u, int v) {
          const double jump = across(u, v) > 0 ? 9 : 0;
          return std::pair(100 + 1.4 * u + 0.1 * v + jump, 50 - 0.2 * u + 1.1 * v);
        },
        beside, why);
    const int unread = count(c, why);
    name_mixed(c);
    EXPECT_GT(count(c, Reason::kMixed), 0.9 * unread);  // the ends of the band have one side only
    EXPECT_EQ(count(c, Reason::kAccepted), static_cast<int>(c.accepted));
  }
}

TEST(NameMixed, IsNotWhatLiesAtACreaseNorAHoleNorInTheDark) {
  const auto crease = [](int u, int v) {
    return std::pair(100 + 1.4 * u + 0.1 * v + 1.5 * std::max(0.0, across(u, v)), 50 - 0.2 * u + 1.1 * v);
  };
  Correspondence c = reading(60, 40, crease, beside, Reason::kPhase);
  name_mixed(c);
  EXPECT_EQ(count(c, Reason::kMixed), 0);
  c = reading(
      60, 40, [](int u, int v) { return std::pair(3.0 * u, 2.0 * v); },
      [](int u, int v) { return u % 7 > 1 || v % 7 > 1; }, Reason::kPhase);
  name_mixed(c);
  EXPECT_EQ(count(c, Reason::kMixed), 0);
  for (const Reason why : {Reason::kDark, Reason::kSaturated, Reason::kIndirect}) {
    c = reading(
        60, 40, [](int u, int v) { return std::pair(u + (across(u, v) > 0 ? 50.0 : 0.0), 1.0 * v); }, beside, why);
    name_mixed(c);
    EXPECT_EQ(count(c, Reason::kMixed), 0);
  }
}

TEST(NameMixed, DecodingNamesThePixelsAlongAnEdge) {
  fake::View view;
  view.full_well = 10000, view.blur_px = 0.8;
  view.map = [](double u, double v) {
    const double jump = u + 0.2 * v > 140 ? 43 : 0;  // a nearer surface
    return std::pair(12 + 0.9 * u + 0.05 * v + jump, 8 + 1.2 * v + 0.04 * u - 0.2 * jump);
  };
  view.projector_width = 400;
  const Sequence sequence = fake::sequence_of(view, "micro-phase");
  SilentProgress silent;
  const auto c = decode_frames(sequence, view.photos(sequence, fake::test_name()), "cam", "p", {}, silent);
  ASSERT_TRUE(c) << c.error().message;
  int along = 0, mixed = 0, elsewhere = 0;
  for (int v = 5; v < view.height - 5; ++v)
    for (int u = 5; u < view.width - 5; ++u) {
      const bool is_mixed = c->reason.at(u, v) == static_cast<std::uint8_t>(Reason::kMixed);
      const bool near = std::abs(u + 0.2 * v - 140) < 4;
      along += near && c->reason.at(u, v) != 0, mixed += near && is_mixed, elsewhere += !near && is_mixed;
    }
  EXPECT_GT(along, view.height / 2);
  EXPECT_GT(mixed, 0.8 * along);
  EXPECT_EQ(elsewhere, 0);
}

// A camera and a projector that look at a room with a step in depth.
struct Pair {
  Device camera, projector;
  int width = 120, height = 80;
  Pair() {
    camera.lens = Lens::pinhole(110, 60.3, 39.1, width, height);
    projector.lens = Lens::pinhole(1500, 640, 700, 1280, 800);
    const double c = std::cos(0.2), s = std::sin(0.2);
    projector.device_from_world.rotation << c, 0, -s, 0, 1, 0, s, 0, c;
    projector.device_from_world.translation = {0.5, 0.15, 0.1};
  }
  std::pair<double, double> map(int u, int v) const {
    const Eigen::Vector3d direction = camera.lens.unproject({static_cast<double>(u), static_cast<double>(v)});
    const Eigen::Vector2d q = projector.project(direction / direction.z() * (u < 50 ? 2.0 : 2.6));
    return {q.x(), q.y()};
  }
  // Unit vector along the line that a pixel's ray projects to.
  Eigen::Vector2d along(int u, int v) const {
    const Eigen::Vector3d direction = camera.lens.unproject({static_cast<double>(u), static_cast<double>(v)});
    return (projector.project(direction * 3) - projector.project(direction * 2)).normalized();
  }
  Correspondence seen() const {
    return reading(
        width, height, [this](int u, int v) { return map(u, v); }, [](int, int) { return true; }, Reason::kDark);
  }
};

TEST(RejectOffEpipolar, FindsWhatNoPointOfSpaceExplains) {
  const Pair pair;
  Correspondence c = pair.seen();
  Random random(hash_name("epipolar"));
  std::set<std::pair<int, int>> planted;
  for (int i = 0; i < 300; ++i) {
    const int u = static_cast<int>(random.uniform() * pair.width), v = static_cast<int>(random.uniform() * pair.height);
    const Eigen::Vector2d along = pair.along(u, v), across(-along.y(), along.x());
    // A third is moved along its line, which nobody can see, a third by less than is allowed, and a third off it.
    const Eigen::Vector2d moved = i % 3 == 0 ? 30 * along : i % 3 == 1 ? Eigen::Vector2d(1.3 * across) : -1.7 * across;
    if (!planted.insert({u, v}).second) continue;
    if (i % 3 != 2) planted.erase({u, v});
    c.x.at(u, v) = static_cast<float>(pair.map(u, v).first + moved.x());
    c.y.at(u, v) = static_cast<float>(pair.map(u, v).second + moved.y());
  }
  EXPECT_EQ(reject_off_epipolar(pair.camera, pair.projector, c), planted.size());
  EXPECT_GT(planted.size(), 50u);
  EXPECT_EQ(c.accepted, c.lit - planted.size());
  for (const auto& [u, v] : planted) {
    EXPECT_EQ(c.reason.at(u, v), static_cast<std::uint8_t>(Reason::kEpipolar));
    EXPECT_TRUE(std::isnan(c.x.at(u, v)) && std::isnan(c.y.at(u, v)) && std::isnan(c.sigma.at(u, v)));
  }
  EXPECT_THAT(c.rejected(),
              testing::ElementsAre(testing::Pair(
                  "epipolar inconsistent", testing::DoubleNear(static_cast<double>(planted.size()) / c.lit, 1e-12))));
}

TEST(RejectOffEpipolar, AllowsWhatAllPixelsAreOffAndWhatSigmaSays) {
  const Pair pair;
  Correspondence c = pair.seen();
  for (int v = 0; v < pair.height; ++v)  // a lens that nobody has calibrated
    for (int u = 0; u < pair.width; ++u) c.y.at(u, v) += 3 * std::sin(u / 20.0f);
  EXPECT_EQ(reject_off_epipolar(pair.camera, pair.projector, c), 0u);
  c = pair.seen();
  const Eigen::Vector2d along = pair.along(60, 40);
  c.x.at(60, 40) -= static_cast<float>(4 * along.y()), c.y.at(60, 40) += static_cast<float>(4 * along.x());
  c.sigma.at(60, 40) = 0.9f;
  EXPECT_EQ(reject_off_epipolar(pair.camera, pair.projector, c), 0u);
  c.sigma.at(60, 40) = 0.7f;
  EXPECT_EQ(reject_off_epipolar(pair.camera, pair.projector, c), 1u);
}

TEST(RejectOffEpipolar, SaysNothingOfOneAxisAlone) {
  const Pair pair;
  Correspondence c = pair.seen();
  for (float& y : c.y.data()) y = kNaN;
  c.x.at(60, 40) += 20;
  EXPECT_EQ(reject_off_epipolar(pair.camera, pair.projector, c), 0u);
}

}  // namespace
}  // namespace countershade::capture
