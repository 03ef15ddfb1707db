#include "capture/pattern/read/reject.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <vector>

#include "calib/base/check.h"
#include "calib/base/parallel.h"

namespace countershade::capture {

namespace {

constexpr int kReach = 3;          // camera px: rejected pixels between surfaces are no wider on either side
constexpr float kLeastJump = 2;    // projector px
constexpr double kLeastOff = 1.5;  // projector px
constexpr double kScatters = 6, kSigmas = 5;
constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();

bool accepted(const Correspondence& c, int u, int v) {
  return u >= 0 && v >= 0 && u < c.reason.width() && v < c.reason.height() &&
         c.reason.at(u, v) == static_cast<std::uint8_t>(Reason::kAccepted);
}

// What the pixels on one side say of a pixel: the nearest two that are accepted, continued.
struct Continued {
  int distance = 0;
  float value[2], slope[2];  // per axis, at the pixel; per camera pixel away from it
};
std::optional<Continued> continued(const Correspondence& c, int u, int v, int du, int dv) {
  for (int k = 1; k <= kReach; ++k) {
    const int nu = u + k * du, nv = v + k * dv;
    if (!accepted(c, nu, nv)) continue;
    if (!accepted(c, nu + du, nv + dv)) return std::nullopt;
    Continued side{k, {}, {}};
    for (int a = 0; a < 2; ++a) {
      const Image& q = a ? c.y : c.x;
      side.slope[a] = q.at(nu + du, nv + dv) - q.at(nu, nv);
      side.value[a] = q.at(nu, nv) - static_cast<float>(k) * side.slope[a];
    }
    return side;
  }
  return std::nullopt;
}

// Two surfaces that meet at a crease, somewhere between the two, would be that far apart when continued.
bool apart(const Continued& one, const Continued& other) {
  for (int a = 0; a < 2; ++a) {
    const float crease =
        static_cast<float>(std::max(one.distance, other.distance)) * std::abs(one.slope[a] + other.slope[a]);
    if (std::abs(one.value[a] - other.value[a]) > kLeastJump + crease) return true;  // false for NaN
  }
  return false;
}

bool between_surfaces(const Correspondence& c, int u, int v) {
  static constexpr int kLines[4][2] = {{1, 0}, {0, 1}, {1, 1}, {1, -1}};
  for (const auto& [du, dv] : kLines) {
    const auto one = continued(c, u, v, du, dv), other = continued(c, u, v, -du, -dv);
    if (one && other && apart(*one, *other)) return true;
  }
  return false;
}

bool may_be_mixed(std::uint8_t reason) {
  switch (static_cast<Reason>(reason)) {
    case Reason::kUncertainBit:
    case Reason::kInconsistent:
    case Reason::kIsolated:
    case Reason::kPhase:
      return true;
    default:
      return false;
  }
}

}  // namespace

void name_mixed(Correspondence& c) {
  Mask named = c.reason;
  parallel_for(c.reason.height(), [&](int v) {
    for (int u = 0; u < c.reason.width(); ++u)
      if (may_be_mixed(c.reason.at(u, v)) && between_surfaces(c, u, v))
        named.at(u, v) = static_cast<std::uint8_t>(Reason::kMixed);
  });
  c.reason = std::move(named);
}

std::size_t reject_off_epipolar(const Device& camera, const Device& projector, Correspondence& c) {
  const int width = c.reason.width(), height = c.reason.height();
  CS_CHECK(camera.lens.width() == width && camera.lens.height() == height, "the camera's lens is of the maps' size");
  const Pose projector_from_camera = projector.device_from_world * camera.device_from_world.inverse();
  const Eigen::Vector3d baseline = projector_from_camera.translation;
  Image off(width, height, 1, kNaN);  // from the line [px]
  parallel_for(height, [&](int v) {
    for (int u = 0; u < width; ++u) {
      if (!accepted(c, u, v)) continue;
      const Eigen::Vector2d q(c.x.at(u, v), c.y.at(u, v));
      const Eigen::Vector3d line = baseline.cross(
          projector_from_camera.rotation * camera.lens.unproject({static_cast<double>(u), static_cast<double>(v)}));
      const Eigen::Vector3d ray = projector.lens.unproject(q);
      // The nearest direction of the plane that the line is of; its pixel is where the code should be.
      const double length = line.norm();
      const Eigen::Vector3d nearest = ray - line * (ray.dot(line) / (length * length));
      if (length > 0) off.at(u, v) = static_cast<float>((projector.lens.project(nearest) - q).norm());
    }
  });
  std::vector<float> known;
  for (const float d : off.data())
    if (std::isfinite(d)) known.push_back(d);
  if (known.empty()) return 0;
  const auto middle = known.begin() + static_cast<std::ptrdiff_t>(known.size() / 2);
  std::nth_element(known.begin(), middle, known.end());
  const double allowed = std::max(kLeastOff, kScatters * 1.4826 * *middle);
  std::size_t rejected = 0;
  for (std::size_t i = 0; i < off.data().size(); ++i) {
    if (!(off.data()[i] > std::max(allowed, kSigmas * c.sigma.data()[i]))) continue;
    c.reason.data()[i] = static_cast<std::uint8_t>(Reason::kEpipolar);
    c.x.data()[i] = c.y.data()[i] = c.sigma.data()[i] = kNaN;
    ++rejected;
  }
  c.accepted -= rejected;
  return rejected;
}

}  // namespace countershade::capture
