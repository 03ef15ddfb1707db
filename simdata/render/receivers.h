// Points of the walls at which indirect light is computed, and interpolation between them.
#pragma once

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "calib/geometry/screen.h"

namespace countershade::simdata {

// nu x nv receivers per surface, index = iv nu + iu. Indirect light has detail of the size of the distance d from the
// crease, so the columns stand at spacings that grow like sqrt(d): u = t^2 from the crease with t at cell centres.
class ReceiverGrid {
 public:
  ReceiverGrid() = default;
  // crease_u[s] = 0 or 1: the side of surface s on which the crease lies.
  ReceiverGrid(int nu, int nv, std::vector<double> crease_u) : nu_(nu), nv_(nv), crease_u_(std::move(crease_u)) {}
  int per_surface() const { return nu_ * nv_; }
  ChartPoint point(int surface, int index) const {
    const double t = (index % nu_ + 0.5) / nu_, d = t * t;
    return {surface, crease_u_[surface] > 0.5 ? 1 - d : d, (index / nu_ + 0.5) / nv_};
  }

  struct Stencil {
    std::array<int, 4> index;
    std::array<float, 4> weight;
  };
  // Bilinear in (t, v) on one surface only; continued linearly beyond the outermost receivers.
  Stencil stencil(int surface, double u, double v) const {
    const double d = std::max(0.0, crease_u_[surface] > 0.5 ? 1 - u : u);
    const double x = std::sqrt(d) * nu_ - 0.5, y = v * nv_ - 0.5;
    const int ix = std::clamp(static_cast<int>(std::floor(x)), 0, nu_ - 2);
    const int iy = std::clamp(static_cast<int>(std::floor(y)), 0, nv_ - 2);
    const float fx = static_cast<float>(x - ix), fy = static_cast<float>(y - iy);
    const int i = iy * nu_ + ix;
    return {{i, i + 1, i + nu_, i + nu_ + 1}, {(1 - fx) * (1 - fy), fx * (1 - fy), (1 - fx) * fy, fx * fy}};
  }

 private:
  int nu_ = 2, nv_ = 2;
  std::vector<double> crease_u_;
};

}  // namespace countershade::simdata
