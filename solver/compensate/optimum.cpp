// The best that projectors can do within their range, and how far a given show is from it.
#include <cmath>

#include "calib/base/check.h"
#include "solver/compensate/compensate.h"

namespace countershade::solver {
namespace {

// (I - K)^-T y: the series of the transposed gather, to 1e-7.
Radiosity adjoint(const Gather& Ft, const Radiosity& k, const Radiosity& y) {
  Radiosity sum = y, term = y;
  for (int n = 0; n < 2000 && y.size() > 0; ++n) {
    term = Ft(k.cwiseProduct(term));
    sum += term;
    if (!(term.cwiseAbs().maxCoeff() > 1e-7f * sum.cwiseAbs().maxCoeff())) break;
  }
  return sum;
}

// Largest eigenvalue of (I - K)^-T (I - K)^-1 by power iteration, rounded up: the gradient's Lipschitz constant.
float curvature(const Gather& K, const Gather& Ft, const Radiosity& k) {
  Radiosity x = Radiosity::Ones(K.rows(), 3);
  float most = 1;
  for (int i = 0; i < 20; ++i) {
    x /= x.norm();
    x = adjoint(Ft, k, forward(K, x));
    most = std::max(most, x.norm());
  }
  return 1.05f * most;
}

}  // namespace

Clipped optimal_direct_for(const Model& model, const Radiosity& target, const Radiosity& low, const Radiosity& high,
                           int iterations) {
  const Gather K = Gather::patches(model);
  const Eigen::MatrixXf transposed = model.F.transpose();
  const Gather Ft(transposed, Radiosity::Ones(target.rows(), 3), row_bands(transposed, model.patches, 1));
  Clipped best = clipped_direct_for(K, target, low, high, 0, 1000);
  best.shown = forward(K, best.direct);
  const float step = 1 / curvature(K, Ft, model.k);
  Radiosity at = best.direct, last = best.direct;
  float momentum = 1, least = (best.shown - target).squaredNorm();
  for (int i = 0; i < iterations; ++i) {
    const Radiosity gradient = adjoint(Ft, model.k, forward(K, at) - target);
    const Radiosity next = (at - step * gradient).cwiseMax(low).cwiseMin(high);
    const Radiosity shown = forward(K, next);
    const float error = (shown - target).squaredNorm();
    ++best.gathers;
    const bool restart = gradient.cwiseProduct(next - last).sum() > 0;
    const float grown = restart ? 1 : .5f * (1 + std::sqrt(1 + 4 * momentum * momentum));
    at = restart ? next : Radiosity(next + (momentum - 1) / grown * (next - last));
    momentum = grown;
    const float moved = (next - last).cwiseAbs().maxCoeff();
    last = next;
    if (error < least) least = error, best.direct = next, best.shown = shown;
    if (moved < 1e-6f * static_cast<float>(model.white)) break;
  }
  return best;
}

Forecast forecast(const Model& model, std::span<const Picture> plain, std::span<const Picture> shown) {
  constexpr int kIterations = 60;  // CAVEs settle to 1e-5 of white in 30
  const Compensator compensator(model);
  const PatchTarget wanted = compensator.patch_target(plain);
  const Radiosity direct = compensator.patch_target(shown).target;
  const Gather K = Gather::patches(model);
  const auto rms = [&](const Radiosity& B) {
    return B.size() ? std::sqrt((B - wanted.target).squaredNorm() / static_cast<double>(B.size())) / model.white : 0;
  };
  Forecast result;
  result.certificate = certificate(K, direct, wanted.target).mean() / model.white;
  result.deviation = rms(forward(K, direct));
  const Radiosity exact = direct_for(K, wanted.target);
  const bool in_range = (exact.array() >= wanted.low.array()).all() && (exact.array() <= wanted.high.array()).all();
  if (!in_range)
    result.optimum = rms(optimal_direct_for(model, wanted.target, wanted.low, wanted.high, kIterations).shown);
  return result;
}

}  // namespace countershade::solver
