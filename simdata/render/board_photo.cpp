#include "simdata/render/board_photo.h"

#include <cmath>
#include <limits>
#include <numbers>

#include "calib/base/parallel.h"
#include "simdata/device/blur.h"

namespace countershade::simdata {

BoardCamera::BoardCamera(const Lens& lens) : lens_(lens) {
  const int columns = lens.width() + 1;
  corners_.resize(static_cast<std::size_t>(columns) * (lens.height() + 1));
  parallel_for(lens.height() + 1, [&](int y) {
    for (int x = 0; x < columns; ++x) {
      const Eigen::Vector3d ray = lens.unproject({x - 0.5, y - 0.5});
      corners_[static_cast<std::size_t>(y) * columns + x] = ray / ray.z();
    }
  });
}

Image BoardCamera::photo(const BoardPattern& pattern, const Pose& camera_from_board, const BoardPhotoOptions& options,
                         Random& random) const {
  const Pose board_from_camera = camera_from_board.inverse();
  const Rectangle print = pattern.extent();
  const Eigen::Vector2d margin = Eigen::Vector2d::Constant(options.margin * pattern.board().square);
  const Eigen::Vector2d low = print.low - margin, high = print.high + margin;
  const int columns = lens_.width() + 1, n = options.samples;
  const std::uint64_t photo_seed = random.bits();
  Image light(lens_.width(), lens_.height(), 1);
  const auto brightness = [&](const Eigen::Vector3d& ray) {
    const Eigen::Vector3d direction = board_from_camera.rotation * ray;
    const double depth = -board_from_camera.translation.z() / direction.z();
    const Eigen::Vector2d x = (board_from_camera.translation + depth * direction).head<2>();
    if (!(depth > 0) || (x - low).minCoeff() < 0 || (high - x).minCoeff() < 0) return options.surround;
    return pattern.dark(x) ? options.black : options.white;
  };
  parallel_for(lens_.height(), [&](int y) {
    for (int x = 0; x < lens_.width(); ++x) {
      const Eigen::Vector3d* top = &corners_[static_cast<std::size_t>(y) * columns + x];
      const Eigen::Vector3d* bottom = top + columns;
      const auto at = [&](double u, double v) {
        return brightness((1 - v) * ((1 - u) * top[0] + u * top[1]) + v * ((1 - u) * bottom[0] + u * bottom[1]));
      };
      const double first = at(0, 0);
      bool plain = true;  // nothing of at least half a pixel begins or ends here
      for (int k = 1; k < 9 && plain; ++k) plain = at(k % 3 / 2.0, static_cast<double>(k / 3) / 2) == first;
      double sum = first * n * n;
      if (!plain) {
        Random jitter(mix(photo_seed ^ (static_cast<std::uint64_t>(y) << 32 | static_cast<std::uint64_t>(x))));
        sum = 0;
        for (int k = 0; k < n * n; ++k)
          sum +=
              at((k % n + jitter.uniform()) / n, (k / n + jitter.uniform()) / n);  // NOLINT(bugprone-integer-division)
      }
      light.at(x, y) = static_cast<float>(sum / (n * n));
    }
  });
  if (options.blur_sigma_px > 0) light = blurred(light, options.blur_sigma_px);
  for (float& v : light.data()) v += static_cast<float>(options.noise * random.normal());
  return light;
}

Pose board_pose(const Board& board, const Lens& lens, double fill, double most_tilt, Random& random) {
  const Eigen::Vector3d last = board.point(board.points() - 1), centre = last / 2;
  const double side = std::min(lens.width(), lens.height()), focal = lens.intrinsics()[0];
  for (int attempt = 0;; ++attempt) {
    CS_CHECK(attempt < 100000, "the lens cannot see the whole board");
    const double tilt = random.uniform(0.3, 1) * most_tilt, direction = random.uniform(0, 2 * std::numbers::pi);
    Pose pose;
    pose.rotation = rotation_from_vector({0, 0, random.uniform(-0.5, 0.5)}) *
                    rotation_from_vector({tilt * std::cos(direction), tilt * std::sin(direction), 0});
    const double distance = focal * last.norm() / (fill * side) * random.uniform(0.8, 1.25);
    const Eigen::Vector3d ray =
        lens.unproject({random.uniform(0, lens.width() - 1), random.uniform(0, lens.height() - 1)});
    pose.translation = distance * ray / ray.z() - pose.rotation * centre;
    bool whole = true;
    // The squares around the outermost points too: a detector needs them.
    for (int j = -1; j <= board.grid_rows() && whole; ++j)
      for (int i = -1; i <= board.grid_columns() && whole; ++i)
        whole = lens.contains(lens.project(pose * Eigen::Vector3d(i * board.square, j * board.square, 0)));
    if (whole) return pose;
  }
}

std::vector<Eigen::Vector2d> seen_points(const Board& board, const Lens& lens, const Pose& camera_from_board,
                                         double sigma_px, Random& random) {
  std::vector<Eigen::Vector2d> q;
  for (int i = 0; i < board.points(); ++i) {
    const Eigen::Vector2d exact = lens.project(camera_from_board * board.point(i));
    const double nan = std::numeric_limits<double>::quiet_NaN();
    const Eigen::Vector2d noise(sigma_px * random.normal(), sigma_px * random.normal());
    q.push_back(lens.contains(exact) ? Eigen::Vector2d(exact + noise) : Eigen::Vector2d(nan, nan));
  }
  return q;
}

}  // namespace countershade::simdata
