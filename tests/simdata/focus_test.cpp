// A projector's lens is sharp at one depth, and a camera may not stand still.
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "simdata/device/faults.h"
#include "simdata/render/emitter.h"
#include "tests/simdata/small_room.h"

namespace countershade {
namespace {

SimulatedProjector lens(double aperture_mm) {
  auto p = test::small_room().simulation.projectors[0];
  p.aperture_mm = aperture_mm, p.focus_distance = 2.3, p.defocus_sigma_px = 0.7;
  return p;
}
simdata::Emitter emitter(const SimulatedProjector& p, std::array<double, 2> depths) {
  const auto room = test::small_room();
  return {p, *simdata::true_projector(room.simulation, room.rig, p.id), 8, depths};
}

TEST(Focus, DiscIsThatOfAThinLens) {
  const SimulatedProjector p = lens(30);
  const simdata::Emitter e = emitter(p, {1.7, 4});
  EXPECT_NEAR(e.blur_variance(2.3), 0.49, 1e-12);
  for (double z : {1.7, 3.1, 4.0}) {
    // Rays through the rims of the aperture that meet in the focal plane are so far apart at z.
    const double apart = 0.03 * std::abs(z - 2.3) / 2.3, pixel = z / (p.throw_ratio * 160);
    // Variance of a uniform disc along one axis: radius^2 / 4.
    EXPECT_NEAR(e.blur_variance(z) - 0.49, std::pow(apart / pixel / 2, 2) / 4, 1e-12) << z;
  }
}

// A sinusoid that is blurred loses exp(-2 pi^2 sigma^2 / period^2), at any depth, also between the levels that are
// kept.
TEST(Focus, StripesLoseWhatTheirDepthAsksFor) {
  for (double aperture : {60.0, 300.0}) {
    const SimulatedProjector p = lens(aperture);
    const simdata::Emitter e = emitter(p, {1.7, 4});
    const auto room = test::small_room();
    const auto scene = *simdata::Scene::make(*simdata::make_shapes(room.simulation));
    const Device device = *simdata::true_projector(room.simulation, room.rig, p.id);
    constexpr double kPeriod = 16;
    const double omega = 2 * std::numbers::pi / kPeriod;
    const simdata::PictureLight light =
        e.light_of(test::picture([&](int x, int, int) { return std::pow(0.5 + 0.4 * std::cos(omega * x), 1 / 2.2); }));
    int checked = 0;
    for (double z : {1.75, 2.0, 2.3, 2.9, 3.6, 3.95}) {
      simdata::SurfacePoint at = scene->point(0, 0.5, 0.5);
      const Eigen::Vector3d in_device = device.lens.unproject({80, 50});
      at.x = device.device_from_world.inverse() * (in_device / in_device.z() * z);
      const Ray ray = device.ray({80, 50});
      at.normal = -ray.direction.normalized();
      at.surface = 0;
      const auto beam = e.beam(*scene, at);
      if (!beam) continue;
      ++checked;
      const auto level = static_cast<float>(beam->level);
      const double swing = light.at(80, 50, level)[1] - light.at(72, 50, level)[1];
      const double left = std::exp(-omega * omega / 2 * e.blur_variance(z));
      // Interpolation in the variance: .5 %; a kernel that ends at four sigma, and 16-bit pictures: less.
      EXPECT_NEAR(swing / (2 * 0.4 * (1 - p.black_level)), left, 0.006) << aperture << " mm at " << z;
    }
    EXPECT_GT(checked, 3);
  }
}

TEST(Focus, WithoutAnApertureDepthDoesNotMatter) {
  const simdata::Emitter near = emitter(lens(0), {0.3, 0.4}), far = emitter(lens(0), {5, 50});
  const Picture waves = test::waves(1);
  const auto a = near.light_of(waves), b = far.light_of(waves);
  ASSERT_EQ(a.blurred.size(), b.blurred.size());
  for (std::size_t i = 0; i < a.blurred.size(); ++i) ASSERT_TRUE((a.blurred[i] == b.blurred[i]).all());
}

// No light is lost by blurring: the sum over a picture is the same at every level.
TEST(Focus, EveryLevelHasAllTheLight) {
  const simdata::Emitter e = emitter(lens(300), {1.7, 4});
  const auto light = e.light_of(test::waves(0));
  const std::size_t size = static_cast<std::size_t>(light.width + 2 * light.margin) * (light.height + 2 * light.margin);
  ASSERT_GT(light.blurred.size(), 5 * size);
  std::vector<double> sums;
  for (std::size_t level = 0; level < light.blurred.size() / size; ++level) {
    double sum = 0;
    for (std::size_t i = 0; i < size; ++i) sum += light.blurred[level * size + i][2];
    sums.push_back(sum);
  }
  for (double sum : sums) EXPECT_NEAR(sum / sums[0], 1, 1e-4);  // float sums
}

// Angles of a shaken camera: rms as stated, independent of the photo before, 3 : 4 between nodding and turning.
TEST(ShakenCamera, HasTheStatedAngleAndNoMemory) {
  const simdata::Faults faults(simdata::parse_faults("camera-shaken=0.5@2").value(), 7);
  EXPECT_FALSE(faults.camera_move(1));
  constexpr int kPhotos = 4000;
  double nod = 0, turn = 0, mean = 0, memory = 0;
  Eigen::Vector3d former = Eigen::Vector3d::Zero();
  for (int i = 0; i < kPhotos; ++i) {
    const Eigen::Vector3d a = vector_from_rotation(faults.camera_move(2 + i)->rotation) * 180 / std::numbers::pi;
    nod += a.x() * a.x() / kPhotos, turn += a.y() * a.y() / kPhotos, mean += a.y() / kPhotos;
    memory += a.dot(former) / kPhotos;
    former = a;
  }
  const double chance = 0.25 / std::sqrt(kPhotos);  // one sigma of each sum is below this
  EXPECT_NEAR(nod, 0.36 * 0.25, 4 * chance * 0.36 * 1.42);
  EXPECT_NEAR(turn, 0.64 * 0.25, 4 * chance * 0.64 * 1.42);
  EXPECT_NEAR(mean, 0, 4 * 0.4 / std::sqrt(kPhotos));
  EXPECT_NEAR(memory, 0, 4 * chance);
}

TEST(ShakenCamera, StandsElsewhereInEachPhotoAndTheSameEachTime) {
  const auto simulator = test::simulate(test::small_room());
  const auto taken = [&](const char* faults) {
    capture::Devices devices = simdata::simulated_devices(
        simulator, *faults ? simdata::parse_faults(faults).value() : std::vector<simdata::Fault>());
    devices.projectors[0]->show(test::waves(0)).value();
    devices.cameras[0]->arm(0).value();
    std::vector<Image> photos;
    for (int i = 0; i < 3; ++i) photos.push_back(devices.cameras[0]->trigger().value().values);
    return photos;
  };
  const auto a = taken("camera-shaken=1"), b = taken("camera-shaken=1"), still = taken("");
  const auto difference = [](const Image& one, const Image& other) {
    double sum = 0;
    for (std::size_t i = 0; i < one.data().size(); ++i) sum += std::abs(one.data()[i] - other.data()[i]);
    return sum / static_cast<double>(one.data().size());
  };
  for (int i = 0; i < 3; ++i) EXPECT_EQ(a[i].data(), b[i].data());
  // Three pixels of shift show at edges, noise everywhere.
  const double noise = difference(still[0], still[1]);
  EXPECT_GT(difference(a[0], a[1]), 1.5 * noise);
  EXPECT_GT(difference(a[1], a[2]), 1.5 * noise);
}

TEST(DriftingCamera, GoesOnEvenly) {
  const simdata::Faults faults(simdata::parse_faults("camera-drifts=0.25@3").value(), 1);
  EXPECT_FALSE(faults.camera_move(2));
  for (int photo : {3, 4, 10}) {
    const Eigen::Vector3d a = vector_from_rotation(faults.camera_move(photo)->rotation) * 180 / std::numbers::pi;
    EXPECT_NEAR((a - 0.25 * (photo - 2) * Eigen::Vector3d(0.8, -0.6, 0)).norm(), 0, 1e-9) << photo;
  }
  EXPECT_NE(faults.acting(4), faults.acting(5));
}

}  // namespace
}  // namespace countershade
