// The albedo of the walls.
#pragma once

#include <Eigen/Dense>
#include <cmath>
#include <vector>

#include "calib/file/rig.h"

namespace countershade::simdata {

// albedo = base[surface] (per channel) times texture(surface, u, v) (a slow variation, the same for all channels).
struct Paint {
  std::vector<Eigen::Array4f> base;
  double amplitude = 0;

  explicit Paint(const Simulation& s) : amplitude(s.texture) {
    for (const auto& albedo : {s.left_albedo, s.right_albedo})
      base.emplace_back(static_cast<float>(albedo[0]), static_cast<float>(albedo[1]), static_cast<float>(albedo[2]),
                        0.0f);
  }
  // 1 - amplitude .. 1 + amplitude; different on every surface, symmetric in nothing.
  double texture(int surface, double u, double v) const {
    if (amplitude == 0) return 1;
    return 1 +
           amplitude * std::sin(2.9 * u + 1.7 * v + 0.8 + 1.9 * surface) * std::cos(4.3 * v - 1.1 * u + 0.3 * surface);
  }
};

}  // namespace countershade::simdata
