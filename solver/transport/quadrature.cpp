#include "solver/transport/quadrature.h"

#include <vector>

#include "calib/base/check.h"

namespace countershade::solver {

namespace {

// Nodes are the roots of the Legendre polynomial, by Newton from Tricomi's estimate.
GaussRule make_rule(int order) {
  GaussRule rule;
  rule.order = order;
  for (int i = 0; i < order; ++i) {
    double x = std::cos(std::numbers::pi * (i + 0.75) / (order + 0.5)), slope = 1;
    for (int iteration = 0; iteration < 100; ++iteration) {
      double p = 1, before = 0;
      for (int n = 0; n < order; ++n) {
        const double next = ((2 * n + 1) * x * p - n * before) / (n + 1);
        before = p, p = next;
      }
      slope = order * (x * p - before) / (x * x - 1);
      const double step = p / slope;
      x -= step;
      if (std::abs(step) < 1e-15) break;
    }
    rule.node[i] = 0.5 - 0.5 * x;
    rule.weight[i] = 1 / ((1 - x * x) * slope * slope);
  }
  return rule;
}

}  // namespace

const GaussRule& gauss_rule(int order) {
  static const std::vector<GaussRule> kRules = [] {
    std::vector<GaussRule> rules(1);
    for (int n = 1; n <= kMaxGaussOrder; ++n) rules.push_back(make_rule(n));
    return rules;
  }();
  CS_CHECK(order >= 1 && order <= kMaxGaussOrder, "no Gauss rule of that order");
  return kRules[order];
}

}  // namespace countershade::solver
