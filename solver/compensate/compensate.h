// Compensation on the CPU: the reference that the GL runtime is tested against, and the fallback without GL.
#pragma once

#include <memory>
#include <span>
#include <vector>

#include "solver/compensate/gather.h"
#include "solver/transport/model.h"

namespace countershade::solver {

struct FramePlan;

// The patch-level solutions take K either as a Gather, packed once for many calls, or as a Model, packed per call.

// B = D + K B for given direct light: what the screen shows. Neumann series to 1e-7 of the largest value.
Radiosity forward(const Gather& K, const Radiosity& direct);
Radiosity forward(const Model& model, const Radiosity& direct);

// Direct radiosity that makes the screen show `target`, all bounces included: D = (I - K) R, unclipped (PHYSICS 2).
Radiosity direct_for(const Gather& K, const Radiosity& target);
Radiosity direct_for(const Model& model, const Radiosity& target);

// The clipped solution: B <- clip(R - K B, low, high) + K B from B = R (PHYSICS 4). Stops when no value moves by more
// than tolerance, or after max_gathers >= 1. Requires low <= high (a Bug otherwise).
struct Clipped {
  Radiosity direct, shown;
  int gathers = 0;
};
Clipped clipped_direct_for(const Gather& K, const Radiosity& target, const Radiosity& low, const Radiosity& high,
                           float tolerance, int max_gathers);
Clipped clipped_direct_for(const Model& model, const Radiosity& target, const Radiosity& low, const Radiosity& high,
                           float tolerance, int max_gathers);

// Least squares within the box: the direct light in [low, high] whose radiosity comes nearest to `target` (sum of
// squares over patches, per channel), by projected gradients with momentum and restart (Beck & Teboulle 2009;
// O'Donoghue & Candes 2015) from the clipped solution. It darkens senders to help receivers. A yardstick for offline
// use: hundreds of gathers. Requires low <= high (a Bug otherwise).
Clipped optimal_direct_for(const Model& model, const Radiosity& target, const Radiosity& low, const Radiosity& high,
                           int iterations);

// The paper's Algorithm 2 (H = 1: Algorithm 1) as baseline: D <- R - (K + .. + K^H) D from D = R, until no value moves
// by more than `tolerance` or `max_passes`. Diverges where PHYSICS 3 says so; `converged` tells.
struct PaperSolution {
  Radiosity direct;
  int passes = 0;
  bool converged = false;
};
PaperSolution paper_direct_for(const Gather& K, const Radiosity& target, int H, float tolerance, int max_passes);
PaperSolution paper_direct_for(const Model& model, const Radiosity& target, int H, float tolerance, int max_passes);

// Bound on |B - R| by the model itself, per patch, for direct light D: (I - K)^-1 |R - (D + K R)| componentwise;
// without the absolute value it would be R - B exactly (PHYSICS 5).
Radiosity certificate(const Gather& K, const Radiosity& direct, const Radiosity& target);
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
  double clipped_pixels = 0;    // share of modelled pixels that would need less than black in some channel
};

// Linear light fractions of a projector's picture: (height, width, 3), b..1 = light(encoded).
Image light_of_picture(const ProjectorResponse& response, const Picture& picture);

// The pictures to show, 16-bit range, quantised to options.bits. Equal inputs give equal outputs.
struct Compensated {
  std::vector<Picture> pictures;
  FrameReport report;
};

// Frames of one model; made once, since it works out which projector pixels meet where (about a second), then cheap.
// Keeps a reference to the model. pictures[q] belongs to model.projectors[q] and has its size (a Bug otherwise); an
// empty one is black.
class Compensator {
 public:
  explicit Compensator(const Model& model);
  ~Compensator();
  Compensator(Compensator&&) noexcept;
  Compensator& operator=(Compensator&&) noexcept;

  Compensated frame(std::span<const Picture> pictures, const CompensateOptions& options) const;

  // The steps of a frame. What it asks for at the patches:
  PatchTarget patch_target(std::span<const Picture> pictures) const;
  // Indirect light at the receivers that it must remove: (R, 3), camera units; zero for a copy.
  Radiosity receiver_indirect(const PatchTarget& target, const CompensateOptions& options, FrameReport& report) const;
  // The pictures that remove it; sets report.clipped_pixels.
  std::vector<Picture> remove(std::span<const Picture> pictures, const Radiosity& indirect,
                              const CompensateOptions& options, FrameReport& report) const;

  const FramePlan& plan() const;

 private:
  struct Parts;
  std::unique_ptr<Parts> parts_;
};

// What a show does by the model, whoever computed it: mean over patches and channels, as shares of white.
struct Forecast {
  double certificate = 0;  // bound on |B - R|
  double deviation = 0;    // root mean square of B - R
  double optimum = 0;      // the same of the best that the projectors' range allows
};
Forecast forecast(const Model& model, std::span<const Picture> plain, std::span<const Picture> shown);

// One frame: Compensator(model).frame(pictures, options).
Compensated compensate_frame(const Model& model, std::span<const Picture> pictures, const CompensateOptions& options);

// Ordered dither in (-.5, .5) LSB: interleaved gradient noise (Jimenez 2014) in whole numbers, the same bits in GL.
float dither(int x, int y, int channel);

}  // namespace countershade::solver
