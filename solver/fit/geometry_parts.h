// The steps of fit_geometry, in order; each is tested on its own.
#pragma once

#include <optional>
#include <vector>

#include "solver/fit/geometry_fit.h"

namespace countershade::solver::parts {

// One decoded camera pixel: direction of its ray in the camera frame (z = 1), its projector pixel, sigma [px].
struct Match {
  Eigen::Vector2d ray;  // (x / z, y / z)
  Eigen::Vector2d q;
  double sigma = 0.3;
  int pixel = 0;  // index into the camera picture, row-major
  int plane = -1;
};
using Matches = std::vector<Match>;

// Up to `count` decoded pixels, drawn at random (same seed, same pixels).
Matches draw_matches(const Device& camera, const ProjectorObservation& observation, int count, std::uint64_t seed);

// Labels matches by homography (camera ray -> projector pixel), the largest first, until no further one explains
// min_share of all; the rest keeps -1. Returns the homographies, each with how many matches it explains.
struct PlaneMap {
  Eigen::Matrix3d H;
  int support = 0;
};
std::vector<PlaneMap> segment_planes(Matches& matches, int max_planes, double min_share, std::uint64_t seed);

// Gives planes of several projectors common labels where their camera pixels coincide (within `reach` pixels).
// labels[q][own label] = common label; returns the number of common planes.
int merge_planes(const std::vector<Matches>& matches, int camera_width, double reach,
                 std::vector<std::vector<int>>& labels);

// Where a projector may stand: starting values for the bundle adjustment, best first.
struct Start {
  double focal = 1, cx = 0, cy = 0;
  Pose projector_from_camera;  // |translation| = 1
  double score = 0;            // smaller is better
};
// From the epipolar geometry of >= 2 planes and a principal column [px]: f and principal row by the equality of the
// essential matrix's singular values over a grid (Hartley & Zisserman 2004, 9.6).
std::vector<Start> starts_from_epipolar(const Matches& matches, const ProjectorSpec& spec, double column);
// From one plane and known intrinsics: decomposition of its homography (Malis & Vargas 2007).
std::vector<Start> starts_from_plane(const Matches& matches, const ProjectorSpec& spec, const Eigen::Matrix3d& H);

// Plane {x : w . x = 1} in the camera frame, fitted to triangulated matches; label by label.
std::vector<Eigen::Vector3d> planes_from_start(const Start& start, const Matches& matches, int planes);

// Where a projector stands whose matches lie on at least two known planes: linear resection (Hartley & Zisserman
// 2004, 7.1), made a camera with square pixels. Nothing where the matches do not determine it.
std::optional<Start> resect(const Matches& matches, const std::vector<Eigen::Vector3d>& planes);

// The state the bundle adjustment improves.
struct Bundle {
  struct Projector {
    double focal, cx, cy;
    Pose projector_from_camera;
  };
  std::vector<Projector> projectors;
  std::vector<Eigen::Vector3d> planes;  // w; |w[0]| = 1 is the gauge
};
struct BundleResult {
  double cost = 0;
  std::vector<double> rms_px;          // per projector
  std::vector<Eigen::Vector4d> sigma;  // focal, cx, cy, relative distance
  Eigen::MatrixXd plane_covariance;    // (3 planes, 3 planes); empty unless asked for
};
struct Adjustment {
  bool robust = true;         // Cauchy loss; off for matches known to be right
  bool hold_columns = false;  // principal columns stay where they are
  bool covariance = false;
};
// matches[q] with plane labels; those labelled -1 are left out, and a plane without matches stays where it is. Where
// matches belong to a plane that is nowhere (all zero) the cost is infinite and the bundle stays as it is.
BundleResult adjust(const std::vector<Matches>& matches, const std::vector<ProjectorSpec>& specs,
                    const Adjustment& adjustment, Bundle& bundle);

// What the fit knows: matches labelled with planes that all projectors share.
struct Problem {
  std::vector<Matches> matches;                    // per projector
  std::vector<ProjectorSpec> specs;                // per projector
  std::vector<std::vector<Eigen::Matrix3d>> maps;  // per projector, of its own planes
  std::vector<std::vector<int>> labels;            // per projector: own plane -> common label
  int planes = 0;
};

// Where all projectors may stand together, cheapest first, each adjusted on digests of the matches. Errors: kRefused
// (one plane without the priors it needs; no pose; no plane in common).
Result<std::vector<Bundle>> starts_together(const Problem& problem);

// Charts of the planes: they meet at creases and hold all decoded pixels. Points are given per plane.
struct Charts {
  Screen screen;
  std::vector<std::shared_ptr<const PlaneSurface>> planes;
};
Charts make_charts(const std::vector<Eigen::Vector3d>& planes, const std::vector<std::vector<Eigen::Vector3d>>& points);

}  // namespace countershade::solver::parts
