#include "capture/pattern/read/half_lit.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>
#include <vector>

#include "calib/base/parallel.h"

namespace countershade::capture {

namespace {

constexpr int kRadius = 4;
constexpr int kDarkReach = 4;       // camera px
constexpr double kMostBlur = 3;     // camera px: what falls more slowly is shading
constexpr int kFewest = 10;         // neighbours that make a plane
constexpr float kPulled = 0.1f;     // camera px: of less, sigma hardly knows
constexpr double kReach = 1.5;      // projector px: a neighbour farther off is on another surface
constexpr double kLikely = 2.5;     // sigma
constexpr double kCurvature = 0.1;  // projector px: how far surfaces bend away from the plane, at its end

struct Neighbour {
  Eigen::Vector3d at;  // 1, dx, dy
  double q = 0, weight = 0;
};

struct Prediction {
  double q = 0, variance = 0;
  double inward = 0;  // change of q toward the neighbours' middle
};

// Plane through the neighbours, at the pixel; those that are far from it are left out once. Nothing where they do not
// span a plane.
std::optional<Prediction> predict(std::vector<Neighbour>& neighbours) {
  for (int pass = 0; pass < 2; ++pass) {
    if (static_cast<int>(neighbours.size()) < kFewest) return std::nullopt;
    Eigen::Matrix3d A = Eigen::Matrix3d::Zero();
    Eigen::Vector3d b = Eigen::Vector3d::Zero();
    for (const Neighbour& n : neighbours) {
      A += n.weight * n.at * n.at.transpose();
      b += n.weight * n.q * n.at;
    }
    Eigen::Matrix3d inverse;
    bool spans = false;
    A.computeInverseWithCheck(inverse, spans, 1e-9 * std::pow(A(0, 0), 3));
    if (!spans) return std::nullopt;
    const Eigen::Vector3d plane = inverse * b;
    Eigen::Vector3d middle = Eigen::Vector3d::Zero();
    for (const Neighbour& n : neighbours) middle += n.at;
    double chi2 = 0;
    for (const Neighbour& n : neighbours) chi2 += n.weight * std::pow(n.q - plane.dot(n.at), 2);
    const double scatter = chi2 / static_cast<double>(neighbours.size() - 3);
    const auto far = [&](const Neighbour& n) { return std::abs(n.q - plane.dot(n.at)) > kReach; };
    const auto left = std::remove_if(neighbours.begin(), neighbours.end(), far);
    if (left == neighbours.end())
      return Prediction{plane[0], inverse(0, 0) * std::max(1.0, scatter) + kCurvature * kCurvature,
                        plane.tail<2>().dot(middle.tail<2>())};
    neighbours.erase(left, neighbours.end());
  }
  return std::nullopt;
}

float brightest_around(const Image& contrast, int x, int y, int reach) {
  float brightest = 0;
  for (int ny = std::max(0, y - reach); ny <= std::min(contrast.height() - 1, y + reach); ++ny)
    for (int nx = std::max(0, x - reach); nx <= std::min(contrast.width() - 1, x + reach); ++nx)
      brightest = std::max(brightest, contrast.row(ny)[nx]);
  return brightest;
}

// z of Phi(z) = share, by bisection: good to 1e-3, asked at borders only.
double normal_quantile(double share) {
  double low = -4, high = 4;
  for (int i = 0; i < 13; ++i) {
    const double middle = 0.5 * (low + high);
    (0.5 * std::erfc(-middle / std::numbers::sqrt2) < share ? low : high) = middle;
  }
  return 0.5 * (low + high);
}

}  // namespace

float pull_of_surroundings(const Image& contrast, int x, int y) {
  return 0.8f * std::max(0.0f, 1 - 1.1f * contrast.at(x, y) / brightest_around(contrast, x, y, 2));
}

// Whether a pixel may be lit in part only. (Between two lit surfaces it is not, and the brighter one would speak for
// the other.)
Mask beside_darkness(const Mask& reason) {
  const int width = reason.width(), height = reason.height();
  Mask along(width, height, 1), beside(width, height, 1);
  parallel_for(height, [&](int y) {
    for (int x = 0; x < width; ++x) {
      const auto why = static_cast<Reason>(reason.at(x, y));
      if (why != Reason::kDark && why != Reason::kIndirect) continue;
      for (int u = std::max(0, x - kDarkReach); u <= std::min(width - 1, x + kDarkReach); ++u) along.at(u, y) = 1;
    }
  });
  parallel_for(height, [&](int y) {
    for (int v = std::max(0, y - kDarkReach); v <= std::min(height - 1, y + kDarkReach); ++v)
      for (int x = 0; x < width; ++x) beside.at(x, y) |= along.at(x, v);
  });
  return beside;
}

float pull_beside_darkness(const Image& contrast, int x, int y) {
  const float least = pull_of_surroundings(contrast, x, y), brightest = brightest_around(contrast, x, y, kRadius);
  const double share = std::clamp<double>(contrast.at(x, y) / brightest, 0.02, 0.98), z = normal_quantile(share);
  const auto fall = [&](int dx, int dy) {
    const int x0 = std::max(0, x - dx), x1 = std::min(contrast.width() - 1, x + dx);
    const int y0 = std::max(0, y - dy), y1 = std::min(contrast.height() - 1, y + dy);
    return (contrast.at(x1, y1) - contrast.at(x0, y0)) / (brightest * static_cast<float>(x1 - x0 + y1 - y0));
  };
  const double density = std::exp(-0.5 * z * z) / std::sqrt(2 * std::numbers::pi);
  const double blur = density / std::hypot(fall(1, 0), fall(0, 1));
  if (!(blur < kMostBlur)) return least;
  return std::max(least, static_cast<float>(blur * density / share));
}

void join_half_lit(AxisReading& reading) {
  const int width = reading.q.width(), height = reading.q.height();
  const Mask dark = beside_darkness(reading.reason);
  Image pull(width, height, 1);
  parallel_for(height, [&](int y) {
    for (int x = 0; x < width; ++x)
      if (!reading.reason.at(x, y))
        pull.at(x, y) =
            dark.at(x, y) ? pull_beside_darkness(reading.contrast, x, y) : pull_of_surroundings(reading.contrast, x, y);
  });
  const Image q = reading.q, sigma = reading.sigma;
  parallel_for(height, [&](int y) {
    std::vector<Neighbour> neighbours;
    for (int x = 0; x < width; ++x) {
      if (reading.reason.at(x, y) || pull.at(x, y) < kPulled || !dark.at(x, y)) continue;
      neighbours.clear();
      for (int v = std::max(0, y - kRadius); v <= std::min(height - 1, y + kRadius); ++v)
        for (int u = std::max(0, x - kRadius); u <= std::min(width - 1, x + kRadius); ++u) {
          if (reading.reason.at(u, v) || pull.at(u, v) >= kPulled) continue;
          const double s = sigma.at(u, v);
          neighbours.push_back({{1, static_cast<double>(u - x), static_cast<double>(v - y)}, q.at(u, v), 1 / (s * s)});
        }
      const auto plane = predict(neighbours);
      // Light comes from the picture only.
      if (!plane || plane->q < -0.5 || plane->q > reading.length_px - 0.5) continue;
      // Light from one side of the pixel has pulled it inward. A plane that says otherwise is another surface's, whose
      // seam lies between.
      const double own = std::pow(sigma.at(x, y), 2), off = plane->q - q.at(x, y);
      const bool outward = off * plane->inward <= 0 || std::abs(off) < 2 * std::sqrt(plane->variance);
      if (!outward || std::abs(off) > kLikely * std::sqrt(own + plane->variance)) continue;
      reading.q.at(x, y) += static_cast<float>(off * own / (own + plane->variance));
      reading.sigma.at(x, y) = static_cast<float>(std::sqrt(own * plane->variance / (own + plane->variance)));
    }
  });
}

}  // namespace countershade::capture
