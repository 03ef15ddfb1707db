// Photos in time: what a camera sees is the mean over each row's exposure of what the projectors showed.
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "tests/simdata/small_room.h"

namespace countershade {
namespace {

using test::flat;
using test::waves;

// Next to no noise; a refresh takes 20 ms.
simdata::RigAndRoom quiet_room() {
  simdata::RigAndRoom room = test::small_room();
  SimulatedCamera& c = room.simulation.cameras[0];
  c.bits = 16, c.full_well_e = 1e9, c.read_noise_e = 0;
  for (SimulatedProjector& p : room.simulation.projectors) p.refresh_hz = 50;
  return room;
}

struct Opened {
  std::shared_ptr<const simdata::Simulator> simulator;
  capture::Devices devices;
  explicit Opened(const simdata::RigAndRoom& room, const std::string& faults = "")
      : simulator(test::simulate(room)),
        devices(simdata::simulated_devices(
            simulator, faults.empty() ? std::vector<simdata::Fault>() : simdata::parse_faults(faults).value())) {}
  void show(int q, const Picture& picture) const { devices.projectors[q]->show(picture).value(); }
  Image photo(double ms) const {
    devices.cameras[0]->arm(ms).value();
    Image values = devices.cameras[0]->trigger()->values;
    for (float& v : values.data()) v /= static_cast<float>(65535 * ms / 10);
    return values;
  }
  Image light(const Picture& left, const Picture& right) const {
    return simulator->optics(0, simulator->total_light(0, std::vector<Picture>{left, right}));
  }
};

// Largest difference, rows `from` to `to`. Rounding and photon noise of 16 bits at a tenth of the exposure: below
// kNoise.
double difference(const Image& a, const Image& b, int from = 0, int to = 150) {
  double largest = 0;
  for (int y = from; y < to; ++y)
    for (int i = 0; i < a.width() * a.channels(); ++i)
      largest = std::max<double>(largest, std::abs(a.row(y)[i] - b.row(y)[i]));
  return largest;
}
Image mean(const Image& a, double share, const Image& b) {
  Image out = a;
  for (std::size_t i = 0; i < out.data().size(); ++i)
    out.data()[i] = static_cast<float>(share * a.data()[i] + (1 - share) * b.data()[i]);
  return out;
}
constexpr double kNoise = 5e-4;

TEST(Stage, PhotoTakenTooEarlyIsAMixtureByTimeAndThenTheNewPicture) {
  auto room = quiet_room();
  room.simulation.projectors[0].latency_ms = 45;
  const Opened o(room);
  o.show(1, waves(1));  // returns at 20 ms
  o.show(0, waves(0));  // returns at 40 ms; seen from 80 ms on
  const Image before = o.light({}, waves(1)), after = o.light(waves(0), waves(1));
  EXPECT_GT(difference(before, after), .1);
  EXPECT_LT(difference(o.photo(5), before), kNoise);                    // 40 - 45, read out until 65
  o.devices.wait(7);                                                    // 72
  EXPECT_LT(difference(o.photo(20), mean(before, .4, after)), kNoise);  // 8 of 20 ms; until 112
  EXPECT_LT(difference(o.photo(5), after), kNoise);
}

// A photo's noise is its own: of its exposure, whichever other ones were taken before; and it is another one each time.
TEST(Stage, EachExposureOfABracketHasItsNoiseWhicheverWereBefore) {
  const auto room = test::small_room();
  const auto photos = [&](const std::vector<double>& exposures) {
    const Opened o(room);
    o.show(0, flat(.6)), o.show(1, flat(.3));
    std::vector<Image> all;
    for (double ms : exposures) {
      o.devices.cameras[0]->arm(ms).value();
      all.push_back(o.devices.cameras[0]->trigger()->values);
    }
    return all;
  };
  const auto bracket = photos({10, 5, 2.5, 10}), alone = photos({5}), other = photos({2.5, 5});
  EXPECT_EQ(bracket[1].data(), alone[0].data());
  EXPECT_EQ(bracket[1].data(), other[1].data());
  EXPECT_NE(bracket[0].data(), bracket[3].data());
  // Of one light, in units of their exposure: no two draws are the same.
  double same = 0, count = 0;
  for (std::size_t i = 0; i < bracket[0].data().size(); ++i) {
    const double a = bracket[0].data()[i] / 4 - bracket[3].data()[i] / 4,
                 b = bracket[1].data()[i] / 2 - bracket[2].data()[i];
    if (a != 0 && b != 0) same += a * b > 0 ? 1 : -1, ++count;
  }
  EXPECT_LT(std::abs(same), 5 * std::sqrt(count));
}

TEST(Stage, TimePassesForShowsPhotosAndWaits) {
  auto room = quiet_room();
  room.simulation.cameras[0].clock_drift_ppm = 1000, room.simulation.cameras[0].timestamp_offset_ms = -250;
  room.simulation.cameras[0].rolling_shutter_ms = 5;
  const Opened o(room);
  o.devices.cameras[0]->arm(15).value();
  const auto at = [&] { return (o.devices.cameras[0]->trigger()->timestamp_s + .25) / 1.001; };
  EXPECT_NEAR(at(), 0, 1e-9);
  EXPECT_NEAR(at(), .04, 1e-9) << "15 ms of exposure, 5 from the first to the last row, 20 of reading out";
  o.devices.wait(1000);
  EXPECT_NEAR(at(), 1.08, 1e-9);
  o.show(0, flat(1));  // at 1.12, a refresh: the next
  EXPECT_NEAR(at(), 1.14, 1e-9);
}

TEST(Stage, RollingShutterShowsBandsOfTheOldPictureTheMixtureAndTheNew) {
  auto room = quiet_room();
  room.simulation.cameras[0].rolling_shutter_ms = 30;
  room.simulation.cameras[0].psf_sigma_px = 0;
  room.simulation.projectors[0].latency_ms = 25;
  const Opened o(room);
  o.show(1, waves(1));  // returns at 20
  o.show(0, waves(0));  // returns at 40, seen from 60 ms on: 20 ms after the first row begins
  const Image photo = o.photo(10), before = o.light({}, waves(1)), after = o.light(waves(0), waves(1));
  EXPECT_LT(difference(photo, before, 0, 49), kNoise);  // row y begins y / 149 * 30 ms later
  EXPECT_LT(difference(photo, after, 100, 150), kNoise);
  for (int y : {55, 71, 90})
    EXPECT_LT(difference(photo, mean(before, (20 - y / 149. * 30) / 10, after), y, y + 1), kNoise);
  const Image next = o.photo(10);
  EXPECT_LT(difference(next, after), kNoise);
}

// Lamps on the mains: mean of 1 + swing cos(2 pi hz t) over that time, summed up by moments.
double lamps(double swing, double hz, double from_s, double exposure_s) {
  double sum = 0;
  for (int i = 0; i < 10000; ++i)
    sum += 1 + swing * std::cos(2 * std::numbers::pi * hz * (from_s + (i + .5) / 10000 * exposure_s));
  return sum / 10000;
}

TEST(Stage, LampsOnTheMainsSwingInPartsOfAPeriodAndNotInWholeOnes) {
  auto room = quiet_room();
  room.simulation.ambient = .2;
  const Opened steady(room);
  const Image still = steady.light({}, {}), white = steady.light(flat(1), flat(1));
  room.simulation.ambient_swing = .8, room.simulation.ambient_hz = 90;
  const Opened o(room);
  EXPECT_LT(difference(o.photo(100. / 9), still), kNoise) << "a whole period";
  double from = .02 + 1 / 90., smallest = 2, largest = 0;
  for (const double ms : {4., 4., 4., 15., 15., 30.}) {
    const double lit = lamps(.8, 90, from, 1e-3 * ms);
    EXPECT_LT(difference(o.photo(ms), mean(still, lit, Image(still.width(), still.height(), 3))), 2 * kNoise) << ms;
    from += .02 + 1e-3 * ms;
    smallest = std::min(smallest, lit), largest = std::max(largest, lit);
  }
  EXPECT_GT(largest - smallest, .5);
  // What the projectors add does not swing.
  o.show(0, flat(1)), o.show(1, flat(1));
  from = (std::floor((from + 1e-9) * 50) + 2) / 50;
  Image expected = white;
  const auto more = static_cast<float>(lamps(.8, 90, from, .004) - 1);
  for (std::size_t i = 0; i < white.data().size(); ++i) expected.data()[i] += more * still.data()[i];
  EXPECT_LT(difference(o.photo(4), expected), 2 * kNoise);
}

TEST(Stage, ARollingShutterSeesTheMainsAsBands) {
  auto room = quiet_room();
  room.simulation.ambient = .2, room.simulation.ambient_swing = .8, room.simulation.ambient_hz = 90;
  room.simulation.cameras[0].rolling_shutter_ms = 30;
  room.simulation.cameras[0].psf_sigma_px = 0;
  const Opened o(room);
  const Image still = o.light({}, {}), dark(still.width(), still.height(), 3), photo = o.photo(4);
  for (int y = 0; y < 150; y += 7) {
    const double lit = lamps(.8, 90, y / 149. * .03, .004);
    EXPECT_LT(difference(photo, mean(still, lit, dark), y, y + 1), kNoise) << y;
  }
  room.simulation.surfaces[0].daylight = .3;
  SilentProgress progress;
  const auto made = simdata::Simulator::make(room.rig, room.simulation, progress);
  ASSERT_FALSE(made);
  EXPECT_NE(made.error().message.find("ambient_swing = 0.8"), std::string::npos) << made.error().message;
}

TEST(Stage, WholeTurnsOfTheWheelAreAsNoWheelAndPartsOfOneShowItsPrimaries) {
  const Opened plain(quiet_room());
  auto room = quiet_room();
  for (SimulatedProjector& p : room.simulation.projectors) p.colour_wheel_hz = 100;
  const Opened wheel(room);
  for (SimulatedProjector& p : room.simulation.projectors) p.pwm_hz = 200;
  const Opened pulses(room);
  for (const Opened* o : {&plain, &wheel, &pulses}) o->show(0, waves(0)), o->show(1, waves(1));
  EXPECT_EQ(plain.photo(10).data(), wheel.photo(10).data());
  // At 40 ms; green's third: 3.33 to 6.67 ms of the turn, pulses are off from 2.5 to 5.
  pulses.devices.wait(5.3);  // 45.3: green, on until 46.667
  const Image green = pulses.photo(1), steady = plain.light(waves(0), waves(1));
  double lit = 0;
  for (std::size_t i = 0; i < green.pixels(); ++i) {
    EXPECT_LT(green.data()[3 * i], kNoise * 2);
    EXPECT_LT(green.data()[3 * i + 2], kNoise * 2);
    EXPECT_NEAR(green.data()[3 * i + 1], std::min(10.f, 6 * steady.data()[3 * i + 1]), kNoise * 4);
    lit = std::max<double>(lit, green.data()[3 * i + 1]);
  }
  EXPECT_GT(lit, .5);
}

TEST(Stage, RollingShutterTurnsTheWheelIntoColouredBands) {
  auto room = quiet_room();
  room.simulation.cameras[0].rolling_shutter_ms = 10;
  room.simulation.cameras[0].psf_sigma_px = 0;
  for (SimulatedProjector& p : room.simulation.projectors) p.colour_wheel_hz = 100;
  const Opened o(room);
  o.show(0, waves(0)), o.show(1, waves(1));  // 40 ms: a turn begins
  const Image photo = o.photo(2), light = o.light(waves(0), waves(1));
  for (int y = 0; y < 150; y += 7) {
    const double from = y / 149. * 10, to = from + 2;  // ms; segments of 10 / 3
    for (int c = 0; c < 3; ++c) {
      double share = 0;
      for (int turn : {0, 1})
        share += std::max(0., std::min(to, 10. * turn + (c + 1) * 10 / 3.) - std::max(from, 10. * turn + c * 10 / 3.)) /
                 2 * 3;
      for (int x = 0; x < 240; x += 5)
        EXPECT_NEAR(photo.at(x, y, c), std::min(5., share * light.at(x, y, c)), 2 * kNoise) << y << " " << c;
    }
  }
}

TEST(Stage, ColdLampIsDimmerAndBlackWithIt) {
  auto room = quiet_room();
  room.simulation.projectors[0].warm_up = .5, room.simulation.projectors[0].warm_up_s = 10;
  const Opened o(room);
  o.show(0, flat(1));
  const Image cold = o.photo(10), warm = o.light(flat(1), {}), right = o.light({}, {});
  EXPECT_NEAR(cold.at(80, 80, 1) / warm.at(80, 80, 1), .5, .003);  // .5 exp(-.025 / 10), and the right one's black
  o.devices.wait(200e3);
  EXPECT_LT(difference(o.photo(10), warm), kNoise);
}

TEST(Stage, GlassesSeeTheirEyesPictureForHalfOfTheTime) {
  auto room = quiet_room();
  room.simulation.projectors[0].stereo = true;
  for (SimulatedProjector& p : room.simulation.projectors) p.refresh_hz = 200;
  room.simulation.ambient = .02;
  for (const std::string eye : {"both", "left", "right"}) {
    room.simulation.cameras[0].eye = eye, room.simulation.cameras[0].glasses_leak = .1;
    const Opened o(room);
    ASSERT_TRUE(o.devices.projectors[0]->show_stereo(waves(0), waves(2)));
    o.show(1, waves(1));
    const Image left = o.light(waves(0), waves(1)), right = o.light(waves(2), waves(1));
    const double open_left = eye == "right" ? .1 : 1, open_right = eye == "left" ? .1 : 1;
    Image expected = left;
    for (std::size_t i = 0; i < left.data().size(); ++i)
      expected.data()[i] = static_cast<float>((open_left * left.data()[i] + open_right * right.data()[i]) / 2);
    EXPECT_LT(difference(o.photo(10), expected), kNoise) << eye;  // two refreshes
  }
  const Opened o(quiet_room());
  const auto refused = o.devices.projectors[0]->show_stereo(waves(0), waves(1));
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, ErrorCode::kUnsupported);
  EXPECT_NE(refused.error().message.find("set stereo = true"), std::string::npos);
}

TEST(Stage, CameraThatAdaptsSaysNothing) {
  auto room = quiet_room();
  room.simulation.cameras[0].auto_exposure = 1;
  const Opened o(room);
  o.devices.cameras[0]->arm(10).value();
  for (double level : {1., .8}) {
    o.show(0, flat(level)), o.show(1, flat(level));
    const capture::Exposure e = *o.devices.cameras[0]->trigger();
    double sum = 0;
    for (float v : e.values.data()) sum += v;
    EXPECT_NEAR(sum / e.values.data().size() / 65535, .18, .001);  // little is clipped
    EXPECT_EQ(e.exposure_ms, 10);
  }
}

TEST(Stage, PhotosOfTheSameStateAreEqualButForNoiseUnderEveryDevice) {
  auto room = test::small_room();
  SimulatedCamera& c = room.simulation.cameras[0];
  c.bayer = "GRBG", c.hot_pixels = 20, c.veiling_glare = .01, c.rolling_shutter_ms = 12;
  for (SimulatedProjector& p : room.simulation.projectors) {
    p.distortion = {-.05, .01, .001, -.002, 0};
    p.white_segment = .3, p.flare = .01, p.native_resolution = {200, 120}, p.latency_ms = 8;
    p.colour_mixing = {.9, .05, .05, .04, .92, .04, .02, .08, .9};
  }
  std::vector<float> photos[2];
  for (std::vector<float>& photo : photos) {
    const Opened o(room, "glare@1");
    o.show(0, waves(0)), o.show(1, waves(1));
    o.devices.wait(100);
    photo = o.photo(10).data();
  }
  EXPECT_EQ(photos[0], photos[1]);
}

}  // namespace
}  // namespace countershade
