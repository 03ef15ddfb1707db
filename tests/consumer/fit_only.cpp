// Says why nothing cannot be fitted.
#include <cstdio>

#include "solver/fit/geometry_fit.h"

int main() {
  const countershade::Image nothing(8, 8, 1, __builtin_nanf(""));
  countershade::ProjectorSpec spec;
  spec.id = "p";
  spec.resolution = {64, 48};
  countershade::SilentProgress progress;
  const auto fit = countershade::solver::fit_geometry({}, {{spec, &nothing, &nothing, &nothing}}, {}, {}, progress);
  std::puts(fit ? "a geometry" : fit.error().message.c_str());
}
