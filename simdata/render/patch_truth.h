// Form factors and light transfer of a room at patch resolution, by ray casting alone: no blocks, no receivers, no
// formula of a form factor. What solvers are compared with; Simulator::patch_truth computes it.
#pragma once

#include <Eigen/Dense>
#include <vector>

namespace countershade::simdata {

// N = surfaces * nu * nv patches: patch (surface, iu, iv) has the number (surface nv + iv) nu + iu, as Patches counts.
// A mesh is cut by the chart of its paint (docs/rooms.md). Patches without area have zeros.
struct PatchTruth {
  int nu = 0, nv = 0;
  Eigen::VectorXd area;               // N, m^2
  Eigen::MatrixXf form_factor;        // (N, N): share of the diffuse light leaving i that arrives at j's lit side
  Eigen::MatrixXf form_factor_sigma;  // standard error of each, at least one ray's worth
  Eigen::MatrixXd albedo;             // (N, 3), mean
  Eigen::MatrixXd irradiance;         // (N, projectors): mean, of each projector's full white
  Eigen::MatrixXd irradiance_sigma;   // standard error of each
  // B = D + diag(albedo) F B solved for unit D: (N, N) per channel, what patch j's direct radiosity 1 gives patch i.
  std::vector<Eigen::MatrixXf> transport;
};

}  // namespace countershade::simdata
