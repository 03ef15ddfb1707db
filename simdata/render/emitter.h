// A projector as a source of light: how strongly each of its pixels lights a point, and what a picture becomes.
#pragma once

#include <Eigen/Dense>
#include <array>
#include <memory>
#include <optional>
#include <vector>

#include "calib/file/rig.h"
#include "calib/geometry/lens.h"
#include "calib/image/image.h"
#include "simdata/device/colour_path.h"
#include "simdata/render/scene.h"

namespace countershade::simdata {

// The light of one picture, linear, 1 = white, black level included.
struct PictureLight {
  int width = 0, height = 0, margin = 0;  // of the picture; `blurred` extends by margin on each side
  std::vector<Light4> blurred;            // after defocus, zero far outside; one picture per level, one after another
  std::vector<Light4> block_mean;         // of the sharp picture, row by row

  // Blurred light at a projector pixel, bilinear, linear between levels; zero outside.
  Light4 at(float x, float y, float level = 0) const {
    const float gx = x + static_cast<float>(margin), gy = y + static_cast<float>(margin);
    const int columns = width + 2 * margin, rows = height + 2 * margin;
    if (!(gx >= 0 && gy >= 0 && gx < static_cast<float>(columns - 1) && gy < static_cast<float>(rows - 1)))
      return Light4::Zero();
    const int ix = static_cast<int>(gx), iy = static_cast<int>(gy);
    const float fx = gx - static_cast<float>(ix), fy = gy - static_cast<float>(iy);
    const auto lower = static_cast<std::size_t>(level);
    const Light4* top = blurred.data() + (lower * rows + iy) * columns + ix;
    const auto between = [&](const Light4* t) -> Light4 {
      const Light4* bottom = t + columns;
      return (t[0] * (1 - fx) + t[1] * fx) * (1 - fy) + (bottom[0] * (1 - fx) + bottom[1] * fx) * fy;
    };
    const float share = level - static_cast<float>(lower);
    if (share == 0) return between(top);
    return between(top) * (1 - share) + between(top + static_cast<std::size_t>(rows) * columns) * share;
  }
};

class Emitter {
 public:
  // depths: nearest and farthest along its axis that its picture meets [m]; only a lens with an aperture asks for them.
  Emitter(const SimulatedProjector& spec, const Device& device, int block_px, std::array<double, 2> depths = {1, 1});

  struct Beam {
    Eigen::Vector2d pixel;                  // projector pixel that lights the point
    double irradiance = 0;                  // at full white, in units of the reference irradiance
    double level = 0;                       // how blurred it is there, for PictureLight::at
    Eigen::Vector3d to_projector{0, 0, 1};  // unit, on the lit side even where the light comes through the screen
    bool from_behind = false;
  };
  // The beam at a point of a surface; none where the picture misses it, another surface is in between, or it comes from
  // behind a screen that lets no light through. `margin_px` widens the picture.
  //
  //   E = power falloff throw^2 W / H cos(theta) / (r^2 cos^3 alpha)
  //
  // since each of the W H pixels carries the same flux and covers the solid angle cos^3(alpha) / f^2, f = throw W. A
  // distorted lens packs the pixels denser by the determinant of its distortion's Jacobian, and E grows with it.
  std::optional<Beam> beam(const Scene& scene, const SurfacePoint& at, double margin_px = 0) const;
  // Sets `power` [m^2]: irradiance 1 on a perpendicular screen at `distance` from a projector of gain 1 like this one.
  double power_for(double distance) const;
  void set_power(double power) { power_ = power; }

  // Variance of the blur at a depth [px^2]. A lens of aperture D draws a point as a disc of D |z - z_f| / z_f there,
  // and a pixel is z / f_px wide:
  //
  //   sigma^2 = defocus_sigma_px^2 + (D f_px |1 / z_f - 1 / z| / 4)^2
  //
  // a disc's standard deviation along an axis being a quarter of its diameter; its edge is drawn as a Gaussian's.
  double blur_variance(double depth) const;

  // An empty picture is black. `share`: of r, g, b, where the primaries are not on for all of an exposure.
  PictureLight light_of(const Picture& picture, const Light4& share = Light4::Ones()) const;

  const Device& device() const { return device_; }
  int margin() const { return margin_; }
  int blocks_x() const { return blocks_x_; }
  int blocks() const { return blocks_x_ * blocks_y_; }
  // Block of a pixel inside the picture.
  int block_of(const Eigen::Vector2d& pixel) const;

 private:
  double level_of(double depth) const;
  // Pixels per pixel of the undistorted lens.
  double density(const Eigen::Vector3d& x_in_device) const;

  SimulatedProjector spec_;
  Device device_;
  ColourPath colours_;
  Eigen::Vector3d position_;
  int block_px_ = 1, blocks_x_ = 1, blocks_y_ = 1, margin_ = 0;
  std::vector<double> variances_;  // of the blur, per level, ascending [px^2]
  double power_ = 1;
  bool distorted_ = false;
  double reach_ = 0;  // tangent of the picture's farthest direction off the axis; what lies beyond is not in it, even
                      // where a distortion that folds projects it there
};

}  // namespace countershade::simdata
