#include "capture/pattern/half_lit.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

#include "calib/base/parallel.h"

namespace countershade::capture {

namespace {

constexpr int kRadius = 4;
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

// Whether a pixel within two is not lit: the pixel may be lit in part only. (Between two lit surfaces it is not, and
// the brighter one would speak for the other.)
bool beside_darkness(const Mask& reason, int x, int y) {
  for (int v = std::max(0, y - 2); v <= std::min(reason.height() - 1, y + 2); ++v)
    for (int u = std::max(0, x - 2); u <= std::min(reason.width() - 1, x + 2); ++u) {
      const auto why = static_cast<Reason>(reason.at(u, v));
      if (why == Reason::kDark || why == Reason::kIndirect) return true;
    }
  return false;
}

}  // namespace

float pull_of_surroundings(const Image& contrast, int x, int y) {
  float brightest = 0;
  for (int ny = std::max(0, y - 2); ny <= std::min(contrast.height() - 1, y + 2); ++ny)
    for (int nx = std::max(0, x - 2); nx <= std::min(contrast.width() - 1, x + 2); ++nx)
      brightest = std::max(brightest, contrast.row(ny)[nx]);
  return 0.8f * std::max(0.0f, 1 - 1.1f * contrast.at(x, y) / brightest);
}

void join_half_lit(AxisReading& reading) {
  const int width = reading.q.width(), height = reading.q.height();
  Image pull(width, height, 1);
  parallel_for(height, [&](int y) {
    for (int x = 0; x < width; ++x)
      if (!reading.reason.at(x, y)) pull.at(x, y) = pull_of_surroundings(reading.contrast, x, y);
  });
  const Image q = reading.q, sigma = reading.sigma;
  parallel_for(height, [&](int y) {
    std::vector<Neighbour> neighbours;
    for (int x = 0; x < width; ++x) {
      if (reading.reason.at(x, y) || pull.at(x, y) < kPulled || !beside_darkness(reading.reason, x, y)) continue;
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
