#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <mutex>
#include <set>
#include <thread>

#include "calib/base/parallel.h"
#include "simdata/device/sensor.h"
#include "tests/simdata/small_room.h"

namespace countershade {
namespace {

using test::flat;

const std::shared_ptr<simdata::Simulator>& shared() {
  static const auto simulator = test::simulate(test::small_room());
  return simulator;
}

// Photon transfer (EMVA 1288): variance of stored values against their mean is a line; its slope is the inverse of the
// electrons per stored unit, its intercept the read noise.
TEST(Sensor, VarianceAgainstMeanGivesFullWellAndReadNoise) {
  SimulatedCamera camera;
  camera.full_well_e = 8000, camera.read_noise_e = 12, camera.bits = 12;
  CameraSpec spec;
  spec.pedestal = 60;
  double s = 0, sx = 0, sy = 0, sxx = 0, sxy = 0;
  for (int level = 1; level <= 8; ++level) {
    const Image light(400, 300, 1, .1f * level);
    const capture::Exposure e = simdata::expose(light, camera, spec, 10, level);
    double mean = 0, square = 0;
    for (float v : e.values.data()) mean += v, square += static_cast<double>(v) * v;
    const double n = e.values.data().size();
    mean /= n;
    const double variance = square / n - mean * mean - 1. / 12;  // rounding
    // Mean within 5 standard errors.
    EXPECT_NEAR(mean, 60 + (4095 - 60) * .1 * level, 5 * std::sqrt(variance / n) + .01);
    const double w = 1 / (variance * variance), x = mean - 60;
    s += w, sx += w * x, sy += w * variance, sxx += w * x * x, sxy += w * x * variance;
  }
  const double slope = (s * sxy - sx * sy) / (s * sxx - sx * sx), intercept = (sy - slope * sx) / s;
  const double stored_per_electron = (4095. - 60) / 8000;
  EXPECT_NEAR(slope / stored_per_electron, 1, .01);  // 120,000 pixels per level: variance to .4 %
  EXPECT_NEAR(std::sqrt(intercept) / stored_per_electron, 12, 2);
}

TEST(Sensor, ClipsAtFullScaleAndCountsIt) {
  Image light(50, 20, 3, .3f);
  for (int x = 0; x < 10; ++x) light.at(x, 4, 1) = 3;
  const capture::Exposure e = simdata::expose(light, {}, {}, 10, 1);
  EXPECT_EQ(e.full_scale, 4095);
  EXPECT_EQ(e.values.at(3, 4, 1), 4095);
  EXPECT_DOUBLE_EQ(e.saturated, 10 / 1000.);
  for (float v : e.values.data()) EXPECT_EQ(v, std::round(v));
}

TEST(Sensor, LightAndExposureTimeAreInterchangeable) {
  const Image light(200, 100, 1, .2f);
  const auto mean = [&](double ms) {
    const capture::Exposure e = simdata::expose(light, {}, {}, ms, 3);
    double sum = 0;
    for (float v : e.values.data()) sum += v;
    return sum / 20000;
  };
  EXPECT_NEAR(mean(25) / mean(10), 2.5, .005);  // noise of 1 % over 20,000 pixels
}

TEST(Optics, KeepsTheSumAndHasTheStatedWidth) {
  Image light(240, 150, 3);
  light.at(100, 70, 1) = 1;
  const Image seen = shared()->optics(0, light);
  double sum = 0, second = 0;
  for (int y = 60; y < 80; ++y)
    for (int x = 90; x < 110; ++x) sum += seen.at(x, y, 1), second += seen.at(x, y, 1) * (x - 100) * (x - 100);
  EXPECT_NEAR(sum, 1, 1e-6);
  EXPECT_NEAR(std::sqrt(second), .6, .01);  // a Gaussian sampled at whole pixels
  EXPECT_EQ(seen.at(100, 70, 0), 0);
}

TEST(SimulatedDevices, PhotoIsTheLightOfWhatIsShown) {
  const capture::Devices devices = simdata::simulated_devices(shared());
  ASSERT_EQ(devices.cameras.size(), 1u);
  ASSERT_EQ(devices.projectors.size(), 2u);
  const std::vector<Picture> pictures{test::waves(0), test::waves(1)};
  for (int q = 0; q < 2; ++q) ASSERT_TRUE(devices.projectors[q]->show(pictures[q]));
  ASSERT_TRUE(devices.cameras[0]->arm(0));
  const capture::Exposure e = *devices.cameras[0]->trigger();
  EXPECT_EQ(e.exposure_ms, 10);
  simdata::TrueLight light = shared()->light(0, pictures);
  for (std::size_t i = 0; i < light.direct.data().size(); ++i) light.direct.data()[i] += light.indirect.data()[i];
  const Image seen = shared()->optics(0, light.direct);
  double chi2 = 0;
  for (std::size_t i = 0; i < seen.data().size(); ++i) {
    const double mean = seen.data()[i], variance = mean / 10000 + 25e-8 + 1. / 12 / 4095 / 4095;
    if (mean < .01) continue;  // clipped at zero
    chi2 += std::pow(e.values.data()[i] / 4095 - mean, 2) / variance / seen.data().size();
  }
  std::size_t counted = 0;
  for (float v : seen.data()) counted += v >= .01f;
  EXPECT_NEAR(chi2 * seen.data().size() / counted, 1, .03);  // sqrt(2 / 50,000) is .6 %
}

TEST(SimulatedDevices, ResumedSessionHasTheBytesOfAnUndisturbedOne) {
  const auto photos = [](std::initializer_list<int> frames) {
    const capture::Devices devices = simdata::simulated_devices(shared());
    EXPECT_TRUE(devices.cameras[0]->arm(5));
    std::vector<std::vector<float>> taken;
    for (int frame : frames) {
      EXPECT_TRUE(devices.projectors[0]->show(test::waves(frame)));
      EXPECT_TRUE(devices.projectors[1]->show(flat(.1 * frame)));
      for (int i = 0; i < 2; ++i) taken.push_back(devices.cameras[0]->trigger()->values.data());
    }
    return taken;
  };
  const auto whole = photos({1, 2, 3}), rest = photos({3});
  EXPECT_EQ(whole[4], rest[0]);
  EXPECT_EQ(whole[5], rest[1]);
  EXPECT_NE(whole[4], whole[5]) << "two photos of one state have their own noise";
}

TEST(SimulatedDevices, PicturesOfAnotherSizeAreABug) {
  const capture::Devices devices = simdata::simulated_devices(shared());
  EXPECT_THROW((void)devices.projectors[0]->show(Picture(20, 10, 3)), Bug);
}

TEST(SimulatedDevices, NegativeExposureIsRefused) {
  const capture::Devices devices = simdata::simulated_devices(shared());
  EXPECT_EQ(devices.cameras[0]->arm(-1).error().code, ErrorCode::kBadValue);
}

TEST(Simulator, LeavesTheProcessItsThreads) {
  // Embree's thread limit once held for every loop of the process while a room was open.
  if (std::thread::hardware_concurrency() < 2) GTEST_SKIP() << "one core";
  ASSERT_TRUE(shared());
  std::mutex mutex;
  std::set<std::thread::id> threads;
  parallel_for(64, [&](int) {
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
    const std::lock_guard lock(mutex);
    threads.insert(std::this_thread::get_id());
  });
  EXPECT_GT(threads.size(), 1u);
}

TEST(Simulator, TotalLightIsDirectAndIndirect) {
  const std::vector<Picture> pictures{flat(.7), flat(.4)};
  const simdata::TrueLight parts = shared()->light(0, pictures);
  const Image total = shared()->total_light(0, pictures);
  for (std::size_t i = 0; i < total.data().size(); ++i)
    ASSERT_NEAR(total.data()[i], parts.direct.data()[i] + parts.indirect.data()[i], 1e-6) << i;  // float sums
}

}  // namespace
}  // namespace countershade
