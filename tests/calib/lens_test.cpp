#include "calib/geometry/lens.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

extern "C" {
#include <mrcal/mrcal.h>
}

#include <array>
#include <cmath>
#include <opencv2/calib3d.hpp>

#include "calib/base/parallel.h"
#include "calib/base/random.h"
#include "calib/file/file.h"
#include "tests/support/cli.h"

namespace countershade {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;
using ::testing::AllOf;
using ::testing::HasSubstr;
using testing::TemporaryFolder;

constexpr int kWidth = 1920, kHeight = 1200;

Random seeded() {
  const auto* info = ::testing::UnitTest::GetInstance()->current_test_info();
  return Random(hash_name(fmt::format("{}.{}", info->test_suite_name(), info->name())));
}

// Every parameter differs from every other, none is zero.
Lens lens_of(const std::string& model) {
  const std::vector<double> all = {1510,   1493.5, 931.25, 617.5,  -0.17,  0.063,   0.0021, -0.0034,
                                   -0.011, 0.02,   -0.004, 0.0013, 0.0007, -0.0004, 0.0011, 0.0003};
  mrcal_lensmodel_t parsed;
  EXPECT_TRUE(mrcal_lensmodel_from_name(&parsed, model.c_str()));
  std::vector<double> intrinsics(mrcal_lensmodel_num_params(&parsed));
  Random random(hash_name(model));
  for (std::size_t i = 0; i < intrinsics.size(); ++i)
    intrinsics[i] = i < 4 || intrinsics.size() <= all.size() ? all[i] : 0.02 * random.normal();
  return Lens::make(model, intrinsics, kWidth, kHeight).value();
}

const char* const kOwn[] = {"LENSMODEL_PINHOLE", "LENSMODEL_OPENCV4", "LENSMODEL_OPENCV5", "LENSMODEL_OPENCV8"};
const char* const kOthers[] = {"LENSMODEL_OPENCV12", "LENSMODEL_STEREOGRAPHIC", "LENSMODEL_LATLON",
                               "LENSMODEL_SPLINED_STEREOGRAPHIC_order=3_Nx=12_Ny=9_fov_x_deg=80"};

Vector2d mrcal_projection(const Lens& lens, const Vector3d& x) {
  mrcal_lensmodel_t model;
  EXPECT_TRUE(mrcal_lensmodel_from_name(&model, lens.model().c_str()));
  const mrcal_point3_t p{.x = x.x(), .y = x.y(), .z = x.z()};
  mrcal_point2_t q;
  EXPECT_TRUE(mrcal_project(&q, nullptr, nullptr, &p, 1, &model, lens.intrinsics().data()));
  return {q.x, q.y};
}

cv::Matx33d camera_matrix(const Lens& lens) {
  const auto& k = lens.intrinsics();
  return {k[0], 0, k[2], 0, k[1], k[3], 0, 0, 1};
}

std::vector<double> distortion(const Lens& lens) {
  std::vector<double> d(lens.intrinsics().begin() + 4, lens.intrinsics().end());
  d.resize(std::max<std::size_t>(4, d.size()));
  return d;
}

Vector3d point_in_view(Random& random) {
  const double z = random.uniform(0.3, 8);
  return {z * random.uniform(-0.6, 0.65), z * random.uniform(-0.4, 0.38), z};
}

TEST(Lens, PinholeDividesByDepth) {
  const Lens lens = Lens::pinhole(1000, 639.5, 300, 1280, 800);
  EXPECT_EQ(lens.project({1, -0.5, 2}), Vector2d(639.5 + 500, 300 - 250));
  EXPECT_LT((lens.unproject({639.5 + 500, 50}) - Vector3d(1, -0.5, 2).normalized()).norm(), 1e-15);  // rounding
}

TEST(Lens, ProjectsAsMrcalDoes) {
  Random random = seeded();
  for (const char* model : kOwn) {
    const Lens lens = lens_of(model);
    for (int i = 0; i < 300; ++i) {
      const Vector3d x = point_in_view(random);
      // Rounding of pixels up to 2000, 4e-13.
      EXPECT_LT((lens.project(x) - mrcal_projection(lens, x)).norm(), 5e-12) << model << " " << x.transpose();
    }
  }
}

TEST(Lens, ProjectsAsOpenCvDoes) {
  Random random = seeded();
  for (const char* model : kOwn) {
    const Lens lens = lens_of(model);
    std::vector<cv::Point3d> points;
    for (int i = 0; i < 300; ++i) {
      const Vector3d x = point_in_view(random);
      points.emplace_back(x.x(), x.y(), x.z());
    }
    std::vector<cv::Point2d> q;
    cv::projectPoints(points, cv::Vec3d(0, 0, 0), cv::Vec3d(0, 0, 0), camera_matrix(lens), distortion(lens), q);
    for (std::size_t i = 0; i < q.size(); ++i) {
      const Vector2d ours = lens.project({points[i].x, points[i].y, points[i].z});
      EXPECT_LT((ours - Vector2d(q[i].x, q[i].y)).norm(), 5e-12) << model;  // rounding, as above
    }
  }
}

TEST(Lens, UnprojectsAsOpenCvDoes) {
  Random random = seeded();
  for (const char* model : kOwn) {
    const Lens lens = lens_of(model);
    std::vector<cv::Point2d> q, n;
    for (int i = 0; i < 200; ++i) q.emplace_back(random.uniform(200, 1750), random.uniform(100, 1100));
    cv::undistortPoints(q, n, camera_matrix(lens), distortion(lens), cv::noArray(), cv::noArray(),
                        cv::TermCriteria(cv::TermCriteria::COUNT | cv::TermCriteria::EPS, 2000, 1e-13));
    for (std::size_t i = 0; i < q.size(); ++i) {
      const Vector3d v = lens.unproject({q[i].x, q[i].y});
      // OpenCV stops when its reprojection is right to 1e-13.
      EXPECT_LT((v.hnormalized() - Vector2d(n[i].x, n[i].y)).norm(), 1e-12) << model;
      EXPECT_NEAR(v.norm(), 1, 1e-15);
    }
  }
}

TEST(Lens, UnprojectUndoesProjectInEveryPixel) {
  for (const char* model : kOwn) {
    const Lens lens = lens_of(model);
    double worst = 0;
    for (int y = 0; y < kHeight; y += 7)
      for (int x = 0; x < kWidth; x += 11) {
        const Vector2d q(x, y);
        worst = std::max(worst, (lens.project(lens.unproject(q)) - q).norm());
      }
    EXPECT_LT(worst, 1e-10) << model;  // the promised convergence; a NaN would not be counted, hence:
    EXPECT_TRUE(lens.unproject({0, 0}).allFinite() && lens.unproject({kWidth - 1, kHeight - 1}).allFinite()) << model;
  }
}

TEST(Lens, UnprojectStaysBeforeTheFoldOfAStrongBarrel) {
  // x (1 - .3 r^2) grows up to r = sqrt(1 / .9) = 1.0541, where it is .70273: 702.7 px from the centre.
  const Lens lens = Lens::make("LENSMODEL_OPENCV4", {1000, 1000, 800, 500, -0.3, 0, 0, 0}, 1600, 1000).value();
  for (double r : {0.2, 0.9, 1.04}) {
    const Vector2d q = lens.project({0.8 * r, 0.6 * r, 1});
    const Vector2d back = lens.unproject(q).hnormalized();
    // Near the fold rounding of q, 1e-13 of 1000 px, is stretched by 1 / (1 - .9 r^2) = 40.
    EXPECT_LT((back - Vector2d(0.8 * r, 0.6 * r)).norm(), 1e-13) << r;
  }
  EXPECT_TRUE(lens.unproject({800 + 702, 500}).allFinite());
  EXPECT_TRUE(lens.unproject({800 + 703.5, 500}).hasNaN()) << "no direction lands there";
  EXPECT_TRUE(lens.unproject({0, 0}).hasNaN());
}

TEST(Lens, UnprojectDoesNotJumpOverTheFold) {
  // r - r^3 + .4 r^5 folds at r = sqrt(.5), where it is .424264, and passes that height again from r = 1.07 on.
  const Lens lens = Lens::make("LENSMODEL_OPENCV4", {1000, 1000, 800, 500, -1, 0.4, 0, 0}, 1600, 1000).value();
  EXPECT_LT(lens.unproject({800 + 424.2, 500}).hnormalized().norm(), std::sqrt(0.5));
  for (double beyond : {424.3, 425.0, 430.0, 450.0, 500.0})
    EXPECT_TRUE(lens.unproject({800 + 0.8 * beyond, 500 - 0.6 * beyond}).hasNaN()) << beyond;
}

TEST(Lens, OtherModelsAreMrcals) {
  Random random = seeded();
  for (const char* model : kOthers) {
    const Lens lens = lens_of(model);
    for (int i = 0; i < 40; ++i) {
      const Vector3d x = point_in_view(random);
      const Vector2d q = lens.project(x);
      EXPECT_EQ(q, mrcal_projection(lens, x)) << model;
      // mrcal's iteration stops near 1e-8 of a pixel.
      EXPECT_LT((lens.project(lens.unproject(q)) - q).norm(), 1e-6) << model;
      EXPECT_LT((lens.unproject(q) - x.normalized()).norm(), 1e-8) << model;
    }
  }
}

TEST(Lens, GivesTheSameFromAllThreads) {
  for (const char* model : {"LENSMODEL_OPENCV8", kOthers[3]}) {
    const Lens lens = lens_of(model);
    const auto pixel = [](int i) { return Vector2d(i % 61 * 30.5, i / 61 * 21.25); };
    std::vector<Vector3d> one(61 * 50), many(61 * 50);
    for (int i = 0; i < static_cast<int>(one.size()); ++i) one[i] = lens.unproject(pixel(i));
    parallel_for(static_cast<int>(many.size()), [&](int i) { many[i] = lens.unproject(pixel(i)); });
    EXPECT_EQ(one, many) << model;
  }
}

TEST(Lens, SeesNothingBehindIt) {
  for (const char* model : {"LENSMODEL_OPENCV5", "LENSMODEL_STEREOGRAPHIC"})
    for (double z : {0.0, -1.0, std::nan("")}) EXPECT_TRUE(lens_of(model).project({0.1, 0.2, z}).array().isNaN().all());
  EXPECT_TRUE(lens_of("LENSMODEL_OPENCV5").unproject({NAN, 3}).hasNaN());
}

TEST(Lens, ContainsTheAreaOfItsPixels) {
  const Lens lens = Lens::pinhole(1, 0, 0, 30, 20);
  EXPECT_TRUE(lens.contains({-0.49, 19.49}));
  EXPECT_TRUE(lens.contains({29.49, -0.49}));
  EXPECT_FALSE(lens.contains({-0.5, 3}));
  EXPECT_FALSE(lens.contains({29.5, 3}));
  EXPECT_FALSE(lens.contains({3, 19.5}));
  EXPECT_FALSE(lens.contains({NAN, 3}));
}

TEST(Lens, RefusesWhatIsNoLens) {
  const auto message = [](const std::string& model, std::vector<double> intrinsics, int width, int height) {
    const auto result = Lens::make(model, std::move(intrinsics), width, height);
    if (result) return std::string("accepted");
    return result.error().message;
  };
  EXPECT_THAT(message("LENSMODEL_NONSENSE", {1, 1, 0, 0}, 3, 3), HasSubstr("'LENSMODEL_NONSENSE'"));
  EXPECT_THAT(message("", {1, 1, 0, 0}, 3, 3), HasSubstr("''"));
  EXPECT_THAT(message("LENSMODEL_SPLINED_STEREOGRAPHIC", {1, 1, 0, 0}, 3, 3), HasSubstr("not known"));
  EXPECT_THAT(message("LENSMODEL_OPENCV5", {1, 1, 0, 0}, 3, 3), AllOf(HasSubstr("9"), HasSubstr("4 are given")));
  EXPECT_THAT(message("LENSMODEL_PINHOLE", {1, 1, NAN, 0}, 3, 3), HasSubstr("finite"));
  EXPECT_THAT(message("LENSMODEL_PINHOLE", {1, -2, 0, 0}, 3, 3), AllOf(HasSubstr("-2"), HasSubstr("positive")));
  EXPECT_THAT(message("LENSMODEL_PINHOLE", {1, 1, 0, 0}, 0, 3), HasSubstr("0 x 3"));
  const auto cahvore = Lens::make("LENSMODEL_CAHVORE_linearity=0.34", std::vector<double>(12, 1), 3, 3);
  ASSERT_FALSE(cahvore);
  EXPECT_EQ(cahvore.error().code, ErrorCode::kUnsupported);
}

Device placed(const std::string& model) {
  return {lens_of(model), look_at({0.7, -3.1, 1.3}, {0.2, 2, 0.9}, Vector3d::UnitZ(), 0.07)};
}

TEST(Device, RayOfAPixelGoesThroughThePointsItSees) {
  const Device device = placed("LENSMODEL_OPENCV5");
  const Vector3d x(0.45, 1.7, 1.2);
  const Ray ray = device.ray(device.project(x));
  EXPECT_LT((ray.origin - Vector3d(0.7, -3.1, 1.3)).norm(), 1e-14);  // rounding
  EXPECT_EQ(ray.origin, device.position());
  EXPECT_LT((x - ray.origin).cross(ray.direction).norm(), 1e-13);  // 1e-10 px would be 3e-13
  EXPECT_GT((x - ray.origin).dot(ray.direction), 0);
}

TEST(Cameramodel, ComesBackDigitByDigit) {
  TemporaryFolder folder;
  for (const char* model : {kOwn[0], kOwn[3], kOthers[0], kOthers[3]}) {
    Device device = placed(model);
    device.device_from_world.translation.x() = 1e-9 / 3;
    ASSERT_TRUE(write_cameramodel(folder / "a.cameramodel", device));
    const auto back = read_cameramodel(folder / "a.cameramodel");
    ASSERT_TRUE(back) << back.error().message;
    EXPECT_EQ(back->lens.model(), model);
    EXPECT_EQ(back->lens.intrinsics(), device.lens.intrinsics());
    EXPECT_EQ(back->lens.width(), kWidth);
    EXPECT_EQ(back->lens.height(), kHeight);
    EXPECT_EQ(back->device_from_world.translation, device.device_from_world.translation);
    // Through a Rodrigues vector: rounding of a few 1e-16.
    EXPECT_LT((back->device_from_world.rotation - device.device_from_world.rotation).norm(), 2e-15);
  }
}

// Points in the reference frame must land where mrcal's own pose and projection put them.
TEST(Cameramodel, MeansTheSameToMrcal) {
  TemporaryFolder folder;
  const Device device = placed("LENSMODEL_OPENCV8");
  ASSERT_TRUE(write_cameramodel(folder / "a.cameramodel", device));
  mrcal_cameramodel_t* model = mrcal_read_cameramodel_file((folder / "a.cameramodel").c_str());
  ASSERT_TRUE(model);
  const Vector3d x(0.45, 1.7, 1.2);
  std::array<double, 3> in_camera;
  mrcal_transform_point_rt(in_camera.data(), nullptr, nullptr, model->rt_cam_ref, x.data());
  const mrcal_point3_t p{.x = in_camera[0], .y = in_camera[1], .z = in_camera[2]};
  mrcal_point2_t q;
  ASSERT_TRUE(mrcal_project(&q, nullptr, nullptr, &p, 1, &model->lensmodel, model->intrinsics));
  EXPECT_LT((Vector2d(q.x, q.y) - device.project(x)).norm(), 1e-11);  // rounding of 2000 px and of the pose
  EXPECT_EQ(model->imagersize[0], kWidth);
  mrcal_free_cameramodel(&model);
}

TEST(Cameramodel, IsReadAsMrcalsToolsWriteIt) {
  TemporaryFolder folder;
  ASSERT_TRUE(
      write_atomically(folder / "a.cameramodel",
                       "# generated on some day with\n#   mrcal-calibrate-cameras --focal 1900\n"
                       "{\n    'lensmodel':  'LENSMODEL_OPENCV4',\n\n"
                       "    # intrinsics are fx,fy,cx,cy,distortion0,...\n"
                       "    'intrinsics': [ 1901.25, 1899.5, 959, 601.5, -0.1, 2e-2, .001, -1E-3,],\n"
                       "    'valid_intrinsics_region': [\n    [ 0, 1.5 ],\n    [ 3, 4 ],\n    [ 0, 1.5 ],\n ],\n"
                       "    # extrinsics are rt_fromref\n"
                       "    'extrinsics': [ 0, 0, 1.5707963267948966, 10, 20, 30.5,],\n\n"
                       "    'imagersize': [ 1920, 1200,],\n\n    'icam_intrinsics': 0,\n"
                       "    'optimization_inputs': b'P)h>@6aWAK2mmw;000~S0Oe(X0',\n}\n"));
  const auto device = read_cameramodel(folder / "a.cameramodel");
  ASSERT_TRUE(device) << device.error().message;
  EXPECT_EQ(device->lens.intrinsics(), (std::vector<double>{1901.25, 1899.5, 959, 601.5, -0.1, 0.02, 0.001, -0.001}));
  // A quarter turn about z takes the reference's x to the camera's y.
  EXPECT_LT((device->device_from_world * Vector3d(2, 0, 0) - Vector3d(10, 22, 30.5)).norm(), 1e-14);  // rounding
}

TEST(Cameramodel, RefusesBrokenFilesByName) {
  TemporaryFolder folder;
  const std::string body = "'extrinsics': [0,0,0,0,0,0], 'imagersize': [30,40] }";
  const std::pair<const char*, std::string> files[] = {
      {"empty", ""},
      {"garbage", "\x01\xff no model"},
      {"cut", "{ 'lensmodel': 'LENSMODEL_PINHOLE', 'intrinsics': [1,1,"},
      {"few", "{ 'lensmodel': 'LENSMODEL_OPENCV5', 'intrinsics': [1,1,0,0], " + body},
      {"unknown", "{ 'lensmodel': 'LENSMODEL_OTHER', 'intrinsics': [1,1,0,0], " + body},
      {"mirrored", "{ 'lensmodel': 'LENSMODEL_PINHOLE', 'intrinsics': [-1,1,0,0], " + body},
  };
  for (const auto& [name, text] : files) {
    ASSERT_TRUE(write_atomically(folder / name, text));
    const auto result = read_cameramodel(folder / name);
    ASSERT_FALSE(result) << name;
    EXPECT_EQ(result.error().code, ErrorCode::kBadFile) << name;
    EXPECT_THAT(result.error().message, HasSubstr(name));
  }
  const auto missing = read_cameramodel(folder / "missing");
  ASSERT_FALSE(missing);
  EXPECT_EQ(missing.error().code, ErrorCode::kBadFile);
  EXPECT_THAT(missing.error().message, HasSubstr("missing"));
}

}  // namespace
}  // namespace countershade
