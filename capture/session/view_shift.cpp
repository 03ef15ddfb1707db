#include "capture/session/view_shift.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include <Eigen/Dense>
#include <opencv2/imgproc.hpp>

namespace countershade::capture {

namespace {

constexpr int kTilesX = 6, kTilesY = 4;
// Standard deviation: along a direction that is less sure, light that the fit does not model passes for a shift.
constexpr double kSurePx = 0.06;
constexpr double kBlurPx = 1.5;  // edges become as wide as the shifts that are looked for
// Of the blurred noise so many neighbours are alike that a fit counts each value about this often.
constexpr double kAlike = 4 * std::numbers::pi * kBlurPx * kBlurPx;

struct Pair {
  cv::Mat mean, difference;  // of the blurred photos
  cv::Mat usable;            // no saturated value has been blurred into it
};

cv::Mat blurred(const Image& light) {
  const cv::Mat view(light.height(), light.width(), CV_32F, const_cast<float*>(light.data().data()));
  cv::Mat result;
  cv::GaussianBlur(view, result, {}, kBlurPx);
  return result;
}

Pair pair_of(const Bins& a, const Bins& b) {
  const cv::Mat first = blurred(a.light), second = blurred(b.light);
  cv::Mat usable(first.size(), CV_8U);
  for (std::size_t i = 0; i < a.valid.pixels(); ++i) usable.data[i] = a.valid.data()[i] && b.valid.data()[i];
  cv::erode(usable, usable, cv::Mat::ones(11, 11, CV_8U));
  return {(first + second) / 2, second - first, usable};
}

// Shift of one tile along the direction in which it is most surely more than noise, less four sigma, where its detail
// tells that direction well (a straight edge tells one alone). Fitted with it: a gain, and light that was added, with a
// slope.
double tile_shift(const Pair& pair, const cv::Rect& tile) {
  using Vector6 = Eigen::Vector<double, 6>;
  using Matrix6 = Eigen::Matrix<double, 6, 6>;
  Matrix6 normal = Matrix6::Zero();
  Vector6 right = Vector6::Zero();
  double squares = 0;
  int count = 0;
  for (int y = std::max(1, tile.y); y < std::min(pair.mean.rows - 1, tile.y + tile.height); ++y) {
    const float *m = pair.mean.ptr<float>(y), *up = pair.mean.ptr<float>(y - 1), *down = pair.mean.ptr<float>(y + 1);
    for (int x = std::max(1, tile.x); x < std::min(pair.mean.cols - 1, tile.x + tile.width); ++x) {
      if (!pair.usable.at<std::uint8_t>(y, x)) continue;
      const double u = static_cast<double>(x - tile.x) / tile.width, v = static_cast<double>(y - tile.y) / tile.height;
      const Vector6 by{m[x], 1, u, v, -(m[x + 1] - m[x - 1]) / 2, -(down[x] - up[x]) / 2};
      const double d = pair.difference.at<float>(y, x);
      normal += by * by.transpose(), right += d * by, squares += d * d, ++count;
    }
  }
  const Eigen::LDLT<Matrix6> solver(normal);
  if (count < 100 || solver.info() != Eigen::Success || !(solver.rcond() > 1e-14)) return 0;
  const Vector6 fit = solver.solve(right);
  const double residual = std::max(0.0, squares - fit.dot(right)) / count;
  const Matrix6 covariance = kAlike * residual * solver.solve(Matrix6::Identity());
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> axes(covariance.bottomRightCorner<2, 2>());
  double shift = 0;
  for (int i = 0; i < 2; ++i)
    if (const double sigma = std::sqrt(std::max(0.0, axes.eigenvalues()[i])); sigma < kSurePx)
      shift = std::max(shift, std::abs(fit.tail<2>().dot(axes.eigenvectors().col(i))) - 4 * sigma);
  return shift;
}

}  // namespace

double view_shift_px(const Bins& a, const Bins& b) {
  CS_CHECK(a.light.same_size(b.light.width(), b.light.height()), "photos of different sizes");
  const Pair pair = pair_of(a, b);
  const int width = (a.light.width() + kTilesX - 1) / kTilesX, height = (a.light.height() + kTilesY - 1) / kTilesY;
  double shift = 0;
  for (int y = 0; y < a.light.height(); y += height)
    for (int x = 0; x < a.light.width(); x += width) shift = std::max(shift, tile_shift(pair, {x, y, width, height}));
  return shift;
}

}  // namespace countershade::capture
