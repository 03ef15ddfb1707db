// Quadrature rules on [0, 1].
#pragma once

#include <array>
#include <cmath>
#include <numbers>

namespace countershade::solver {

inline constexpr int kMaxGaussOrder = 24;

struct GaussRule {
  int order = 0;
  std::array<double, kMaxGaussOrder> node{}, weight{};
};

// Gauss-Legendre, order 1 to kMaxGaussOrder (a Bug otherwise); exact for polynomials of degree 2 order - 1.
const GaussRule& gauss_rule(int order);

// Double-exponential quadrature (Takahashi & Mori 1974) of f over [a, b]; f may have integrable singularities at the
// ends.
template <class F>
double tanh_sinh(double a, double b, F&& f) {
  constexpr double kStep = 0.1, kReach = 3.4;  // beyond it the weights are below 1e-20
  const double half = 0.5 * (b - a);
  double sum = 0;
  for (int i = -static_cast<int>(kReach / kStep); i <= static_cast<int>(kReach / kStep); ++i) {
    const double t = i * kStep, u = 0.5 * std::numbers::pi * std::sinh(t);
    // Distance from the nearer end, computed without cancellation.
    const double edge = 1 / (std::exp(std::abs(u)) * std::cosh(u));
    const double x = u < 0 ? a + half * edge : b - half * edge;
    sum += 0.5 * std::numbers::pi * std::cosh(t) / (std::cosh(u) * std::cosh(u)) * f(x);
  }
  return half * kStep * sum;
}

}  // namespace countershade::solver
