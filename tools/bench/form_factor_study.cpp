// form-factors: closed forms against catalogue values, and what the paper's centre-to-centre formula makes of an edge.
#include <cmath>

#include "solver/transport/form_factor.h"
#include "tools/bench/study.h"

namespace countershade::bench {

namespace {

using Corners = std::array<Eigen::Vector3d, 4>;

Corners rectangle(const Eigen::Vector3d& origin, const Eigen::Vector3d& u, const Eigen::Vector3d& v) {
  return {origin, origin + u, origin + u + v, origin + v};
}

// Catalogue form factor between sub-rectangles of perpendicular walls that share the line y: wall a lies in z = 0, x >
// 0; wall b in x = 0, z > 0; both start at distance from the edge (Howell C-14 by the algebra of differences).
double perpendicular_apart(double l, double a0, double a1, double b0, double b1) {
  const auto flow = [&](double a, double b) {
    return a > 0 && b > 0 ? a * l * solver::adjacent_rectangles(l, a, b) : 0;
  };
  return (flow(a1, b1) - flow(a0, b1) - flow(a1, b0) + flow(a0, b0)) / ((a1 - a0) * l);
}

struct Worst {
  double disjoint = 0, touching = 0, reciprocity = 0;
};

void add(Study& study, Worst& worst, const std::string& what, double found, double expected, bool touching) {
  const double relative = std::abs(found / expected - 1);
  (touching ? worst.touching : worst.disjoint) = std::max(touching ? worst.touching : worst.disjoint, relative);
  study.rows.push_back(
      {what, fmt::format("{:.12g}", found), fmt::format("{:.12g}", expected), fmt::format("{:.2e}", relative)});
}

double reciprocity_error(const Corners& a, const Corners& b, double area_a, double area_b) {
  return std::abs(area_a * solver::form_factor(a, b) / (area_b * solver::form_factor(b, a)) - 1);
}

}  // namespace

Result<Study> form_factors(const StudyContext&) {
  using V = Eigen::Vector3d;
  Study study{"Form factors against the catalogue (Howell C-11, C-14)",
              {"pair", "found", "catalogue", "relative error"},
              {},
              {},
              "",
              "",
              false};
  Worst worst;
  for (double d : {0.3, 1.0, 4.0, 40.0}) {
    const Corners a = rectangle(V(0, 0, 0), V(1.3, 0, 0), V(0, 0.7, 0)),
                  b = rectangle(V(0, 0, d), V(0, 0.7, 0), V(1.3, 0, 0));
    add(study, worst, fmt::format("opposite 1.3 x .7 at {}", d), solver::form_factor(a, b),
        solver::opposite_rectangles(1.3, 0.7, d), false);
    worst.reciprocity = std::max(worst.reciprocity, reciprocity_error(a, b, 0.91, 0.91));
  }
  for (const auto& [a0, a1, b0, b1] : std::vector<std::array<double, 4>>{
           {0, 1, 0, 1}, {0, 2, 0, 0.3}, {0, 0.05, 0, 0.05}, {0.1, 1, 0.2, 0.9}, {1, 2, 0.5, 0.6}, {0.5, 0.51, 0, 1}}) {
    const double l = 1.7;
    const Corners a = rectangle(V(a0, 0, 0), V(a1 - a0, 0, 0), V(0, l, 0)),
                  b = rectangle(V(0, 0, b0), V(0, l, 0), V(0, 0, b1 - b0));
    const bool touching = a0 == 0 && b0 == 0;
    add(study, worst, fmt::format("perpendicular [{}, {}] [{}, {}]", a0, a1, b0, b1), solver::form_factor(a, b),
        perpendicular_apart(l, a0, a1, b0, b1), touching);
    worst.reciprocity = std::max(worst.reciprocity, reciprocity_error(a, b, (a1 - a0) * l, (b1 - b0) * l));
  }
  for (int n : {4, 16, 64}) {  // centre-to-centre at the edge of two walls, at three resolutions
    const double s = 1.0 / n;
    const Corners a = rectangle(V(0, 0, 0), V(s, 0, 0), V(0, s, 0)), b = rectangle(V(0, 0, 0), V(0, s, 0), V(0, 0, s));
    const double centre = solver::centre_form_factor(a, b), exact = solver::adjacent_rectangles(s, s, s);
    study.rows.push_back({fmt::format("centre-to-centre at the edge, patches of 1/{}", n),
                          fmt::format("{:.4f}", centre), fmt::format("{:.4f}", exact),
                          fmt::format("{:+.1f} %", 100 * (centre / exact - 1))});
  }
  study.figure = fmt::format("disjoint {:.1e}, touching {:.1e}, reciprocity {:.1e}", worst.disjoint, worst.touching,
                             worst.reciprocity);
  study.bound = "<= 1e-8, 1e-6, 1e-12";
  study.ok = worst.disjoint <= 1e-8 && worst.touching <= 1e-6 && worst.reciprocity <= 1e-12;
  return study;
}

}  // namespace countershade::bench
