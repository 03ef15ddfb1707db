// How the surfaces of a room reflect light.
//
// A point lit by irradiance E from direction i leaves towards o the radiance
//
//   L = albedo E / pi  lobe(i, o),     lobe = (1 - gloss) directing(o) + gloss pi ggx(i, o)
//
// with the integral of lobe cos(o) / pi over the hemisphere 1 (directing, exactly) or a little less (ggx: masking).
#pragma once

#include <Eigen/Dense>
#include <array>
#include <vector>

#include "calib/file/rig.h"
#include "simdata/room/shape.h"

namespace countershade::simdata {

// BRDF of a rough mirror without losses but masking, divided by 1: D G / (4 cos_i cos_o) with the GGX distribution and
// the height-correlated Smith term (Walter 2007; Heitz 2014). Directions are unit and leave the surface; 0 below it.
double ggx(const Eigen::Vector3d& normal, const Eigen::Vector3d& in, const Eigen::Vector3d& out, double alpha);

class Paint {
 public:
  explicit Paint(const Simulation& simulation);

  // Of every surface, per channel, and one idle lane.
  const std::vector<Eigen::Array4f>& base() const { return base_; }
  // Albedo of a point against its surface's: the texture times the patchwork.
  double texture(const SurfacePoint& at) const;
  bool is_glossy(int surface) const { return of_[surface].gloss > 0; }
  bool is_diffuse(int surface) const { return of_[surface].gloss == 0 && of_[surface].directing == 0; }
  // Both directions unit, away from the point.
  double lobe(const SurfacePoint& at, const Eigen::Vector3d& in, const Eigen::Vector3d& out) const;
  // The two parts of lobe: what does not depend on where the light comes from, and what does.
  double directed(const SurfacePoint& at, const Eigen::Vector3d& out) const;
  double glossy(const SurfacePoint& at, const Eigen::Vector3d& in, const Eigen::Vector3d& out) const;
  double gloss(int surface) const { return of_[surface].gloss; }
  // A direction from which the glossy part of the lobe mirrors light towards `out`, for (a, b) in the unit square, so
  // that its weight is the estimate of glossy() cos(in) / pi over the hemisphere; no weight where (a, b) leads below
  // the surface. Normals are drawn as `out` sees them (Heitz 2018).
  struct Mirrored {
    Eigen::Vector3d direction;
    double weight = 0;
  };
  Mirrored mirrored(const SurfacePoint& at, const Eigen::Vector3d& out, double a, double b) const;
  // The lobe's value towards `out` where light comes evenly from everywhere.
  double evenly_lit(const SurfacePoint& at, const Eigen::Vector3d& out) const;
  // Share of light from behind that the screen lets through, in albedos.
  double transmission(int surface) const { return of_[surface].transmission; }
  // Irradiance by daylight.
  double daylight(const SurfacePoint& at) const;
  bool has_daylight(int surface) const { return of_[surface].daylight > 0; }

 private:
  std::vector<SimulatedSurface> of_;
  std::vector<Eigen::Array4f> base_;
  std::vector<double> directing_scale_;             // 1 / (its integral for the tilt)
  std::vector<std::vector<double>> glossy_albedo_;  // of the GGX lobe, at even steps of cos(out)
  std::uint64_t seed_ = 1;
};

}  // namespace countershade::simdata
