// Every fault does what its name says, from its photo on, and the same each time.
#include "simdata/device/faults.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <numeric>

#include "tests/simdata/small_room.h"

namespace countershade::simdata {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

const std::shared_ptr<Simulator>& room() {
  static const std::shared_ptr<Simulator> made = test::simulate(test::small_room());
  return made;
}

// Photos 0 .. last: all but the last of one pair of pictures, the last of another.
std::vector<capture::Exposure> photos(const std::string& faults, int last) {
  capture::Devices devices =
      simulated_devices(room(), faults.empty() ? std::vector<Fault>() : parse_faults(faults).value());
  const auto show = [&](double left, double right) {
    devices.projectors[0]->show(test::flat(left)).value();
    devices.projectors[1]
        ->show(test::picture(
            [=](int x, int y, int c) { return right * (0.4 + 0.3 * x / 160 + 0.2 * y / 100 + 0.05 * c); }))
        .value();
  };
  devices.cameras[0]->arm(0).value();
  show(0.5, 0.9);
  std::vector<capture::Exposure> taken;
  for (int i = 0; i <= last; ++i) {
    if (i == last) show(0.8, 0.6);
    taken.push_back(devices.cameras[0]->trigger().value());
  }
  return taken;
}

double mean_difference(const Image& a, const Image& b) {
  double sum = 0;
  for (std::size_t i = 0; i < a.data().size(); ++i) sum += std::abs(a.data()[i] - b.data()[i]);
  return sum / a.data().size();
}
double mean(const Image& a) {
  return std::accumulate(a.data().begin(), a.data().end(), 0.0) / a.data().size();
}

class FaultTest : public ::testing::TestWithParam<const FaultKind*> {};

TEST_P(FaultTest, ChangesPhotosFromItsOwnOnAndTheSameEachTime) {
  const FaultKind& kind = *GetParam();
  // The person needs some photos to come into the picture; the lamps some to cool.
  const int last = kind.photo + (std::string(kind.name) == "person-walks-in" ? 7
                                 : std::string(kind.name) == "warm-up"       ? 20
                                                                             : 0);
  const auto good = photos("", last), bad = photos(kind.name, last), again = photos(kind.name, last);
  if (std::string(kind.name) == "dropped-frame") {  // pictures are as good as ever, the counter tells
    EXPECT_EQ(good[last].counter - good[last - 1].counter, 1u);
    EXPECT_EQ(bad[last].counter - bad[last - 1].counter, 2u);
    return;
  }
  // Two photos of one scene differ by their noise, about 1 % of full scale; here the draws are equal, or nearly so.
  EXPECT_GT(mean_difference(good[last].values, bad[last].values), 0.002 * good[last].full_scale) << kind.name;
  EXPECT_EQ(bad[last].values.data(), again[last].values.data());
  for (int i = 0; i < kind.photo; ++i) ASSERT_EQ(good[i].values.data(), bad[i].values.data()) << i;
}

std::vector<const FaultKind*> all_kinds() {
  std::vector<const FaultKind*> all;
  for (const FaultKind& k : fault_kinds()) all.push_back(&k);
  return all;
}
INSTANTIATE_TEST_SUITE_P(All, FaultTest, ::testing::ValuesIn(all_kinds()), [](const auto& info) {
  std::string name = info.param->name;
  std::erase(name, '-');
  return name;
});

TEST(Faults, WhoComesAndStaysHidesTheSamePixelsInEveryPhotoFromThenOn) {
  const Faults faults(parse_faults("person-stays=0.25@3").value(), 1);
  const auto hidden = [&](std::uint64_t photo) {
    Image light(400, 300, 1, 1.f);
    faults.light(light, photo);
    return light.data();
  };
  EXPECT_EQ(hidden(2), std::vector<float>(400 * 300, 1.f));
  EXPECT_EQ(hidden(3), hidden(500));
  double sum = 0;
  for (float v : hidden(3)) sum += (1 - v) / .92;
  // An ellipse of .25 x 1.1 whose centre is .25 above the lower edge: that cuts off its share of acos(h) - h sqrt(1 -
  // h^2) over pi, h = .25 / .55.
  EXPECT_NEAR(sum / (400 * 300), .25 * std::numbers::pi / 4 * 1.1 * .779, .002);
}

TEST(Faults, GlareLaysTheMeanOverThePhoto) {
  Image light(4, 2, 1, 0.1f);
  light.at(3, 1) = 0.9f;  // mean .2
  Faults(parse_faults("glare=0.5").value(), 1).light(light, 0);
  EXPECT_NEAR(light.at(0, 0), 0.2, 1e-6);  // float sums
  EXPECT_NEAR(light.at(3, 1), 1.0, 1e-6);
  Image red(3, 2, 3);  // a lens scatters each colour as that colour
  red.at(1, 1, 0) = 0.6f;
  Faults(parse_faults("glare=0.5").value(), 1).light(red, 0);
  EXPECT_NEAR(red.at(0, 0, 0), 0.05, 1e-6);
  EXPECT_EQ(red.at(0, 0, 1), 0);
}

TEST(Faults, NightLightTakesBlueAndFewerGreens) {
  const auto shown = Faults(parse_faults("night-light=0.5").value(), 1).emitted({test::flat(0.8), {}}, 0);
  const double code = 65535 * 0.8;
  EXPECT_NEAR(shown[0].at(7, 9, 0), code, 1);
  EXPECT_NEAR(shown[0].at(7, 9, 1), 0.8 * code, 1);  // 40 % of what blue loses
  EXPECT_NEAR(shown[0].at(7, 9, 2), 0.5 * code, 1);
  EXPECT_TRUE(shown[1].empty());
}

TEST(Faults, NudgedAndMagnifiedPicturesShowTheirNeighbours) {
  const Picture ramp = test::picture([](int x, int y, int) { return 0.1 + 0.004 * x + 0.002 * y; });
  const auto nudged = Faults(parse_faults("projector-nudged=10@0").value(), 1).emitted({ramp}, 0);
  EXPECT_EQ(nudged[0].at(60, 40, 1), ramp.at(52, 46, 1));  // 8 to the right, 6 up
  const auto magnified = Faults(parse_faults("scaled-desktop=2").value(), 1).emitted({ramp}, 0);
  EXPECT_EQ(magnified[0].at(60, 40, 1), ramp.at(30, 20, 1));
}

// A turned camera sees the picture of its centre shifted by focal length times angle; a pushed one sees near things
// move more than far ones.
TEST(Faults, MovedCameraIsPosedAgain) {
  const auto simulator = test::simulate(test::small_room());
  const Device camera = *simdata::true_camera(simulator->simulation(), "camera");
  const double degrees = 2, mm = 300;
  const Pose turned = *Faults(parse_faults("camera-turned=2@0").value(), 1).camera_move(0);
  const Pose pushed = *Faults(parse_faults("camera-bumped=300@0").value(), 1).camera_move(0);
  EXPECT_FALSE(Faults(parse_faults("camera-turned=2@3").value(), 1).camera_move(2));
  EXPECT_NEAR(vector_from_rotation(turned.rotation).norm(), degrees * std::numbers::pi / 180, 1e-12);
  EXPECT_NEAR(pushed.inverse().translation.norm(), 1e-3 * mm, 1e-12);
  const std::vector<Picture> pictures{test::waves(0), test::waves(1)};
  const Image before = simulator->total_light(0, pictures);
  for (const Pose& move : {turned, pushed}) {
    using Share = simdata::Simulator::PictureShare;
    std::vector<std::vector<Share>> shown;
    for (const Picture& p : pictures) shown.push_back({{&p, simdata::Light4::Ones()}});
    const Image after = simulator->mixed_light(0, shown, simulator->moved_view(0, move).get());
    const simdata::TrueGeometry g = simulator->geometry(0);
    double wrong = 0, unmoved = 0, total = 0;
    for (int y = 20; y < 130; y += 3)
      for (int x = 20; x < 220; x += 3) {
        if (!test::inside_wall(g, x, y)) continue;
        const Ray ray = camera.ray({1. * x, 1. * y});
        const Eigen::Vector3d point = ray.origin + g.depth.at(x, y) * ray.direction;
        const Eigen::Vector2d q = camera.lens.project(move * (camera.device_from_world * point));
        const float there = sample_bilinear(after, q.x(), q.y(), 1);
        wrong += std::abs(there - before.at(x, y, 1)), unmoved += std::abs(after.at(x, y, 1) - before.at(x, y, 1));
        total += before.at(x, y, 1);
      }
    EXPECT_LT(wrong / total, .012);  // edges of picture and walls, interpolated
    EXPECT_GT(unmoved, 3 * wrong);
  }
}

TEST(Faults, StaleFrameSeesTheFormerPictureOnce) {
  const auto good = photos("", 12), bad = photos("stale-frame@12", 12);
  const double noise = mean_difference(good[10].values, good[11].values);
  EXPECT_LT(mean_difference(bad[12].values, good[11].values), 1.5 * noise);
  EXPECT_GT(mean_difference(bad[12].values, good[12].values), 5 * noise);
}

TEST(Faults, ExposureScalesWhatIsStored) {
  const auto good = photos("", 1), dark = photos("underexposed=0.25", 1);
  EXPECT_NEAR(mean(dark[1].values) / mean(good[1].values), 0.25, 0.002);  // 36,000 pixels, rounded to 12 bits
  EXPECT_EQ(dark[1].exposure_ms, good[1].exposure_ms);                    // the driver does not know
}

TEST(Faults, WarmUpLosesHalfOfItsShareIn35Photos) {
  Image light(1, 1, 1, 1.f);
  Faults(parse_faults("warm-up=0.2").value(), 1).light(light, 35);
  EXPECT_NEAR(light.at(0, 0), 0.9, 1e-6);
}

TEST(ParseFaults, ReadsValuesAndPhotos) {
  const auto faults = parse_faults("glare=0.01,stale-frame@7,exposure-jitter=0.5@3").value();
  ASSERT_EQ(faults.size(), 3u);
  EXPECT_EQ(faults[0].value, 0.01);
  EXPECT_EQ(faults[1].photo, 7u);
  EXPECT_EQ(faults[2].value, 0.5);
  EXPECT_EQ(faults[2].photo, 3u);
}

TEST(ParseFaults, NamesWhatIsWrongAndTheBound) {
  const auto message = [](const char* text) { return parse_faults(text).error().message; };
  EXPECT_THAT(message("glair"), AllOf(HasSubstr("'glair'"), HasSubstr("nearest is 'glare'")));
  EXPECT_THAT(message("glare=2"), AllOf(HasSubstr("glare=2"), HasSubstr("0.0001 to 1")));
  EXPECT_THAT(message("glare=nan"), HasSubstr("out of range"));
  EXPECT_THAT(message("glare=x"), HasSubstr("must be a number"));
  EXPECT_THAT(message("glare=0.1@-1"), HasSubstr("whole number"));
  EXPECT_THAT(message("glare,,dust"), HasSubstr("no fault ''"));
}

}  // namespace
}  // namespace countershade::simdata
