#include "solver/compensate/compensate.h"

#include "calib/base/check.h"

namespace countershade::solver {
namespace {

// sum_n K^n x, to 1e-7 of the largest value; the limit of terms only ends a series that does not converge (kappa >= 1).
Radiosity neumann(const Gather& K, const Radiosity& x) {
  constexpr int kMostTerms = 2000;
  Radiosity sum = x, term = x;
  for (int n = 0; n < kMostTerms && x.size() > 0; ++n) {
    term = K(term);
    sum += term;
    if (!(term.cwiseAbs().maxCoeff() > 1e-7f * sum.cwiseAbs().maxCoeff())) break;
  }
  return sum;
}

}  // namespace

Radiosity forward(const Gather& K, const Radiosity& direct) {
  return neumann(K, direct);
}

Radiosity forward(const Model& model, const Radiosity& direct) {
  return forward(Gather::patches(model), direct);
}

Radiosity direct_for(const Gather& K, const Radiosity& target) {
  return target - K(target);
}

Radiosity direct_for(const Model& model, const Radiosity& target) {
  return direct_for(Gather::patches(model), target);
}

Clipped clipped_direct_for(const Gather& K, const Radiosity& target, const Radiosity& low, const Radiosity& high,
                           float tolerance, int max_gathers) {
  CS_CHECK(low.rows() == target.rows() && high.rows() == target.rows(), "target, low and high differ in rows");
  CS_CHECK((low.array() <= high.array()).all(), "low must not exceed high");
  CS_CHECK(max_gathers >= 1, "max_gathers must be at least 1");
  Clipped result{target, target, 0};
  while (result.gathers < max_gathers) {
    const Radiosity indirect = K(result.shown);
    result.direct = (target - indirect).cwiseMax(low).cwiseMin(high);
    const Radiosity shown = result.direct + indirect;
    const float change = (shown - result.shown).cwiseAbs().maxCoeff();
    result.shown = shown;
    ++result.gathers;
    if (change <= tolerance) break;
  }
  return result;
}

Clipped clipped_direct_for(const Model& model, const Radiosity& target, const Radiosity& low, const Radiosity& high,
                           float tolerance, int max_gathers) {
  return clipped_direct_for(Gather::patches(model), target, low, high, tolerance, max_gathers);
}

Radiosity certificate(const Gather& K, const Radiosity& direct, const Radiosity& target) {
  const Radiosity residual = (target - direct - K(target)).cwiseAbs();
  return neumann(K, residual);
}

Radiosity certificate(const Model& model, const Radiosity& direct, const Radiosity& target) {
  return certificate(Gather::patches(model), direct, target);
}

}  // namespace countershade::solver
