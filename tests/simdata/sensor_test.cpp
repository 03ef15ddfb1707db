// What a camera's lens and sensor add to the light, each by its formula.
#include "simdata/device/sensor.h"

#include <gtest/gtest.h>

extern "C" {
#include <mrcal/mrcal.h>
}

#include <cmath>
#include <filesystem>
#include <set>

#include "calib/base/random.h"
#include "calib/image/demosaic.h"
#include "simdata/device/device_lens.h"
#include "tests/simdata/small_room.h"
#include "tests/support/cli.h"

namespace countershade::simdata {
namespace {

using testing::TemporaryFolder;

const char* const kPatterns[] = {"RGGB", "GRBG", "GBRG", "BGGR"};

// Next to no noise: 16 bits, 1e9 electrons.
SimulatedCamera quiet() {
  SimulatedCamera c;
  c.bits = 16, c.full_well_e = 1e9, c.read_noise_e = 0;
  return c;
}

Image ramp(int width, int height) {
  Image light(width, height, 3);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x)
      for (int c = 0; c < 3; ++c) light.at(x, y, c) = static_cast<float>(.1 + .01 * x + .004 * y + .1 * c);
  return light;
}

TEST(Bayer, FlatGreyStaysFlat) {
  for (const char* pattern : kPatterns) {
    const Image rgb = demosaiced(Image(13, 10, 1, 1234), pattern);
    EXPECT_EQ(rgb.channels(), 3);
    for (float v : rgb.data()) EXPECT_EQ(v, 1234) << pattern;
  }
}

TEST(Bayer, EachPixelKeepsTheColourItMeasures) {
  for (const char* pattern : kPatterns) {
    SimulatedCamera camera = quiet();
    camera.bayer = pattern;
    const Image light = ramp(24, 18), rgb = expose(light, camera, {}, 10, 1).values;
    for (int y = 0; y < 18; ++y)
      for (int x = 0; x < 24; ++x) {
        const int c = static_cast<int>(std::string("RGB").find(pattern[y % 2 * 2 + x % 2]));
        EXPECT_NEAR(rgb.at(x, y, c) / 65535, light.at(x, y, c), 2e-4) << pattern;  // photon noise: 3e-5
      }
  }
}

// The mean of neighbours on both sides is exact on a plane; the rim, mirrored, is a pixel's slope off at most.
TEST(Bayer, PlaneIsInterpolatedExactly) {
  for (const char* pattern : kPatterns) {
    SimulatedCamera camera = quiet();
    camera.bayer = pattern;
    const Image light = ramp(24, 18), rgb = expose(light, camera, {}, 10, 1).values;
    for (int y = 0; y < 18; ++y)
      for (int x = 0; x < 24; ++x)
        for (int c = 0; c < 3; ++c) {
          const bool rim = x == 0 || y == 0 || x == 23 || y == 17;
          EXPECT_NEAR(rgb.at(x, y, c) / 65535, light.at(x, y, c), rim ? .0142 : 2e-4) << pattern << x << " " << y;
        }
  }
}

TEST(HotPixels, StayWhereTheyAreAndGrowWithTheExposure) {
  SimulatedCamera camera = quiet();
  camera.hot_pixels = 30;
  const Image dark(80, 60, 1);
  const auto hot = [&](double ms, std::uint64_t key, std::uint64_t sensor) {
    const Image values = expose(dark, camera, {}, ms, key, sensor).values;
    std::map<int, double> found;
    for (std::size_t i = 0; i < values.data().size(); ++i)
      if (values.data()[i] > 200) found[static_cast<int>(i)] = values.data()[i] / 65535;
    return found;
  };
  const auto first = hot(10, 1, 5), second = hot(4, 2, 5), other = hot(10, 1, 6);
  EXPECT_GE(first.size(), 28u);  // two may fall on one pixel
  EXPECT_LE(first.size(), 30u);
  ASSERT_EQ(first.size(), second.size());
  for (const auto& [place, value] : first) {
    ASSERT_TRUE(second.count(place));
    EXPECT_GT(value, .049);
    if (value < .99) {  // not clipped
      EXPECT_NEAR(second.at(place), .4 * value, 2e-4);
    }
  }
  int same = 0;
  for (const auto& [place, value] : other) same += first.count(place);
  EXPECT_LT(same, 5) << "another camera has its own";
}

TEST(VeilingGlare, LaysAShareOfEachChannelsMeanOverThePhoto) {
  SimulatedCamera camera;
  camera.psf_sigma_px = 0;
  Image light(4, 2, 3, .1f);
  light.at(3, 1, 1) = .9f;  // green's mean is .2
  camera.veiling_glare = .05;
  const Image seen = through_lens(light, camera);
  EXPECT_NEAR(seen.at(0, 0, 0), .1 + .05 * .1, 1e-7);
  EXPECT_NEAR(seen.at(0, 0, 1), .1 + .05 * .2, 1e-7);
  EXPECT_NEAR(seen.at(3, 1, 1), .9 + .05 * .2, 1e-7);
}

TEST(AutoExposure, BringsTheMeanTo18PercentByItsStrength) {
  SimulatedCamera camera;
  const Image light(10, 10, 3, .3f);
  EXPECT_EQ(adapted_exposure_ms(light, camera, 20), 20);
  camera.auto_exposure = 1;  // whatever was asked for
  EXPECT_NEAR(adapted_exposure_ms(light, camera, 20), 6, 1e-6);
  EXPECT_NEAR(adapted_exposure_ms(light, camera, 3), 6, 1e-6);
  camera.auto_exposure = .5;
  EXPECT_NEAR(adapted_exposure_ms(light, camera, 20), std::sqrt(6 * 20), 1e-6);
}

// ---- lenses ----

// mrcal's own projection of a point of the world.
Eigen::Vector2d by_mrcal(const Device& camera, const Eigen::Vector3d& x_in_world) {
  const Eigen::Vector3d x = camera.device_from_world * x_in_world;
  mrcal_lensmodel_t model;
  EXPECT_TRUE(mrcal_lensmodel_from_name(&model, camera.lens.model().c_str()));
  const mrcal_point3_t p{.x = x.x(), .y = x.y(), .z = x.z()};
  mrcal_point2_t q;
  EXPECT_TRUE(mrcal_project(&q, nullptr, nullptr, &p, 1, &model, camera.lens.intrinsics().data()));
  return {q.x, q.y};
}

std::vector<Lens> lenses() {
  std::vector<double> splines{170, 172, 121, 73};
  Random random(hash_name("AnyMrcalLensIsPhotographedThrough"));
  for (int i = 0; i < 2 * 8 * 6; ++i) splines.push_back(.04 * random.uniform(-1, 1));
  return {*Lens::make("LENSMODEL_OPENCV8", {170, 172, 121, 73, -.1, .02, 1e-3, -2e-3, .004, .01, .02, .003}, 240, 150),
          *Lens::make("LENSMODEL_SPLINED_STEREOGRAPHIC_order=3_Nx=8_Ny=6_fov_x_deg=110", splines, 240, 150),
          *Lens::make("LENSMODEL_CAHVOR", {170, 172, 121, 73, .02, -.01, .001, -.05, .01}, 240, 150)};
}

TEST(CameraLens, AnyMrcalLensIsPhotographedThrough) {
  const TemporaryFolder folder;
  for (const Lens& lens : lenses()) {
    auto room = test::small_room();
    SimulatedCamera& camera = room.simulation.cameras[0];
    camera.lens = folder / "true.cameramodel";
    ASSERT_TRUE(write_cameramodel(camera.lens, {lens, {}}));
    const auto simulator = test::simulate(room);
    const Device device = *true_camera(room.simulation, camera.id);
    EXPECT_EQ(device.lens.model(), lens.model());
    const TrueGeometry g = simulator->geometry(0);
    int checked = 0;
    for (int y = 3; y < 150; y += 9)
      for (int x = 2; x < 240; x += 11) {
        if (g.surface.at(x, y) < 0) continue;
        const auto& wall = simulator->screen().surfaces[static_cast<int>(g.surface.at(x, y))];
        const Eigen::Vector2d q = by_mrcal(device, wall->point(g.u.at(x, y), g.v.at(x, y)));
        EXPECT_NEAR((q - Eigen::Vector2d(x, y)).norm(), 0, 1e-3) << lens.model();  // u, v in single precision
        ++checked;
      }
    EXPECT_GT(checked, 100) << lens.model();
    // What is photographed lies where the lens says: the edge of a picture, against the same lens.
    const std::vector<Picture> pictures{test::picture([](int px, int, int) { return px < 80 ? 1. : 0.; }), {}};
    const Image lit = simulator->total_light(0, pictures),
                all = simulator->total_light(0, std::vector{test::flat(1), Picture()});
    for (int y = 20; y < 150; y += 10)
      for (int x = 0; x < 240; ++x) {
        const double column = g.projector_x[0].at(x, y);
        if (!(std::abs(column - 79.5) > 4) || all.at(x, y, 0) < .05 || !test::inside_wall(g, x, y)) continue;
        if (column < 79.5)
          EXPECT_GT(lit.at(x, y, 0), .8 * all.at(x, y, 0));
        else
          EXPECT_LT(lit.at(x, y, 0), .5 * all.at(x, y, 0));
      }
  }
}

TEST(CameraLens, LensOfAnotherResolutionIsRefused) {
  const TemporaryFolder folder;
  SimulatedCamera camera;
  camera.id = "cam";
  camera.lens = folder / "true.cameramodel";
  const auto missing = camera_lens(camera);
  ASSERT_FALSE(missing);
  EXPECT_NE(missing.error().message.find("true.cameramodel"), std::string::npos) << missing.error().message;
  ASSERT_TRUE(write_cameramodel(camera.lens, {Lens::pinhole(500, 319.5, 239.5, 640, 480), {}}));
  const auto lens = camera_lens(camera);
  ASSERT_FALSE(lens);
  for (const char* part : {"'cam'", "640 x 480", "[1920, 1200]", "set the resolution"})
    EXPECT_NE(lens.error().message.find(part), std::string::npos) << lens.error().message;
}

TEST(ProjectorLens, FoldInsideThePictureIsRefused) {
  SimulatedProjector p;
  p.id = "left";
  EXPECT_EQ(projector_lens(p, 640, 400)->model(), "LENSMODEL_PINHOLE");
  p.distortion = {-.1, .02, .001, -.002, 0};
  EXPECT_EQ(projector_lens(p, 640, 400)->model(), "LENSMODEL_OPENCV5");
  p.distortion = {-3, 0, 0, 0, 0};
  const auto lens = projector_lens(p, 640, 400);
  ASSERT_FALSE(lens);
  for (const char* part : {"'left'", "distortion = [-3", "folds", "smaller"})
    EXPECT_NE(lens.error().message.find(part), std::string::npos) << lens.error().message;
}

}  // namespace
}  // namespace countershade::simdata
