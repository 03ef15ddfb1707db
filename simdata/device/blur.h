// Gaussian blur, separable.
#pragma once

#include <vector>

#include "calib/image/image.h"

namespace countershade::simdata {

// Half width of the kernel [px]; 0 for sigma = 0.
int blur_radius(double sigma_px);
// Weights -radius..radius, sum 1.
std::vector<float> blur_kernel(double sigma_px);

// Border pixels repeated outside.
Image blurred(const Image& image, double sigma_px);

}  // namespace countershade::simdata
