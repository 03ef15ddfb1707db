// Compensation on the CPU: the reference that the GL runtime is tested against, and the fallback without GL.
#pragma once

#include <span>
#include <vector>

#include "solver/transport/model.h"

namespace countershade::solver {

// B = D + K B for given direct light: what the screen shows. Jacobi to 1e-7 of the largest value.
Radiosity forward(const Model& model, const Radiosity& direct);

// Direct radiosity that makes the screen show `target`, all bounces included: D = (I - K) R, unclipped (PHYSICS 2).
Radiosity direct_for(const Model& model, const Radiosity& target);

// The clipped solution: B <- clip(R - K B, low, high) + K B (PHYSICS 4). Stops when no value moves by more than
// tolerance, or after max_gathers. Requires low <= high (a Bug otherwise).
struct Clipped {
  Radiosity direct, shown;
  int gathers = 0;
};
Clipped clipped_direct_for(const Model& model, const Radiosity& target, const Radiosity& low, const Radiosity& high,
                           float tolerance, int max_gathers);

// The paper's Algorithm 2 (H = 1: Algorithm 1) as baseline: D <- R - (K + .. + K^H) D from D = R, until no value moves
// by more than `tolerance` or `max_passes`. Diverges where PHYSICS 3 says so; `converged` tells.
struct PaperSolution {
  Radiosity direct;
  int passes = 0;
  bool converged = false;
};
PaperSolution paper_direct_for(const Model& model, const Radiosity& target, int H, float tolerance, int max_passes);

// Bound on |B - R| by the model itself, per patch: (I - K)^-1 |R - (D + K B)| componentwise (PHYSICS 5).
Radiosity certificate(const Model& model, const Radiosity& direct, const Radiosity& target);

// What a frame asks for, at patches, from the pictures' mean direct light.
struct PatchTarget {
  Radiosity target;  // direct light of the plain show: R = sum_q a_q p_q + e
  Radiosity low;     // all projectors black
  Radiosity high;    // all projectors white
};

enum class SolverChoice { kAuto, kCopy, kClosedForm, kClipped };

struct CompensateOptions {
  SolverChoice solver = SolverChoice::kAuto;
  int max_gathers = 40;
  bool dither = true;
  int bits = 8;
};

// How a frame was solved.
struct FrameReport {
  SolverChoice used = SolverChoice::kCopy;
  int gathers = 0;
  double largest_indirect = 0;  // max of K R / white
  double clipped_pixels = 0;    // share of projector pixels that hit black or white in some channel
  double certificate = 0;       // mean certificate / white
};

// Linear light fractions of a projector's picture: (height, width, 3), b..1 = light(encoded).
Image light_of_picture(const ProjectorResponse& response, const Picture& picture);

// Samples every patch is reduced from: kReduceSamples x kReduceSamples points per patch.
inline constexpr int kReduceSamples = 8;

PatchTarget patch_target(const Model& model, std::span<const Image> lights);

// Indirect light at the receivers that a frame must remove: (R, 3).
Radiosity receiver_indirect(const Model& model, const PatchTarget& target, const CompensateOptions& options,
                            FrameReport& report);

// The whole frame. pictures[q] belongs to model.projectors[q]; returns the pictures to show, 16-bit range, quantised to
// options.bits (dithered). Equal inputs give equal outputs.
struct Compensated {
  std::vector<Picture> pictures;
  FrameReport report;
};
Compensated compensate_frame(const Model& model, std::span<const Picture> pictures, const CompensateOptions& options);

// Blue-noise-like ordered dither in (-.5, .5) LSB, the same in GL: interleaved gradient noise (Jimenez 2014).
float dither(int x, int y, int channel);

}  // namespace countershade::solver
