// The algorithms of Bimber et al. 2006, kept as the baseline that the closed form is measured against.
#include <cmath>

#include "calib/base/check.h"
#include "solver/compensate/compensate.h"

namespace countershade::solver {

PaperSolution paper_direct_for(const Gather& K, const Radiosity& target, int H, float tolerance, int max_passes) {
  CS_CHECK(H >= 1, "H must be at least 1");
  constexpr float kDiverged = 1e6f;  // times the target: further passes only overflow
  const float limit = kDiverged * std::max(1e-6f, target.cwiseAbs().maxCoeff());
  PaperSolution result{target, 0, false};
  while (result.passes < max_passes && !result.converged) {
    Radiosity sum = result.direct;  // D + K D + .. + K^(H-1) D, by Horner
    for (int level = 1; level < H; ++level) sum = result.direct + K(sum);
    const Radiosity next = target - K(sum);
    const float change = (next - result.direct).cwiseAbs().maxCoeff();
    result.direct = next;
    ++result.passes;
    result.converged = change <= tolerance;
    if (!(change < limit)) break;
  }
  return result;
}

PaperSolution paper_direct_for(const Model& model, const Radiosity& target, int H, float tolerance, int max_passes) {
  return paper_direct_for(Gather::patches(model), target, H, tolerance, max_passes);
}

}  // namespace countershade::solver
