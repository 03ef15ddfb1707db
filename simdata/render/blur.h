// Gaussian blur, separable, on pictures and photos.
#pragma once

#include <Eigen/Dense>
#include <vector>

#include "calib/image/image.h"

namespace countershade::simdata {

// Half width of the kernel [px]; 0 for sigma = 0.
int blur_radius(double sigma_px);
// Weights -radius..radius, sum 1.
std::vector<float> blur_kernel(double sigma_px);

// Zero outside.
std::vector<Eigen::Array4f> blurred(const std::vector<Eigen::Array4f>& image, int width, int height, double sigma_px);
// Border pixels repeated outside.
Image blurred(const Image& image, double sigma_px);

}  // namespace countershade::simdata
