#include "capture/pattern/identity.h"

#include <algorithm>
#include <cmath>

#include "calib/file/nearest.h"
#include "capture/board/tags.h"

namespace countershade::capture {

namespace {

// A tag, and a black margin, so that white pictures leave an edge to find.
constexpr int kModules = k41h12Modules + 2;
constexpr int kLeastModulePx = 2, kModulePx = 4;  // possible; what a camera of as many pixels reads
const std::vector<std::string> kCorners = {"top-left", "top-right", "bottom-left", "bottom-right"};

// Each picture has its own: frames one after the other, projectors in turns.
int tag_of(const Sequence& sequence, int q, int position) {
  return position * static_cast<int>(sequence.projectors.size()) + q;
}

// The projective map of the unit square's corners (0,0), (1,0), (1,1), (0,1) (Heckbert 1989).
Eigen::Matrix3d from_unit_square(const std::array<Eigen::Vector2d, 4>& q) {
  const Eigen::Vector2d sum = q[0] - q[1] + q[2] - q[3];
  Eigen::Matrix2d sides;
  sides << q[1] - q[2], q[3] - q[2];
  const Eigen::Vector2d g = sides.inverse() * sum;
  Eigen::Matrix3d H;
  H.col(0) << q[1] - q[0] + g[0] * q[1], g[0];
  H.col(1) << q[3] - q[0] + g[1] * q[3], g[1];
  H.col(2) << q[0], 1;
  return H;
}

Eigen::Vector2d at_module(const SeenMark& mark, double x, double y) {
  return (mark.to_photo * Eigen::Vector3d(x, y, 1)).hnormalized();
}

// Light at a module's middle, all channels together.
double light_at(const Image& photo, const Eigen::Vector2d& q) {
  const double x = std::clamp(q.x(), 0.0, photo.width() - 1.001), y = std::clamp(q.y(), 0.0, photo.height() - 1.001);
  const int i = static_cast<int>(x), j = static_cast<int>(y);
  double light = 0;
  for (int c = 0; c < photo.channels(); ++c)
    light += std::lerp(
        std::lerp(photo.at(i, j, c), photo.at(std::min(i + 1, photo.width() - 1), j, c), x - i),
        std::lerp(photo.at(i, std::min(j + 1, photo.height() - 1), c),
                  photo.at(std::min(i + 1, photo.width() - 1), std::min(j + 1, photo.height() - 1), c), x - i),
        y - j);
  return light;
}

}  // namespace

Result<std::vector<IdentityMark>> identity_marks(const Sequence& sequence, const MarkLayout& layout) {
  if (sequence.frames.size() * sequence.projectors.size() > k41h12Ids)
    return error(
        ErrorCode::kBadValue,
        "{} frames of {} projectors are more pictures than there are marks of identity, {}: write those of fewer "
        "projectors",
        sequence.frames.size(), sequence.projectors.size(), k41h12Ids);
  if (!(layout.inset >= 0 && layout.inset <= 0.4))
    return error(ErrorCode::kBadValue, "identity: inset = {} must be 0 to 0.4 of the picture", layout.inset);
  std::vector<IdentityMark> marks;
  for (const auto& [id, size] : sequence.projectors)
    for (const std::string& corner : layout.corners) {
      if (std::find(kCorners.begin(), kCorners.end(), corner) == kCorners.end())
        return error(ErrorCode::kBadValue, "identity: there is no corner '{}'; the nearest is '{}'", corner,
                     nearest(corner, kCorners));
      const int side = layout.side_px != 0 ? layout.side_px : kModules * std::max(kModulePx, size[1] / 12 / kModules);
      const int least = kModules * kLeastModulePx, most = std::min(size[0], size[1]) / 2;
      if (side < least || side > most)
        return error(ErrorCode::kBadValue, "identity: marks of {} px on projector '{}' must have {} to {} px", side, id,
                     least, most);
      const auto place = [&](int length, bool far) {
        const int from_edge = std::min(static_cast<int>(std::lround(layout.inset * length)), (length - side) / 2);
        return far ? length - side - from_edge : from_edge;
      };
      const IdentityMark mark{id, place(size[0], corner.ends_with("right")),
                              place(size[1], corner.starts_with("bottom")), side};
      if (std::find(marks.begin(), marks.end(), mark) == marks.end()) marks.push_back(mark);
    }
  return marks;
}

void draw_identity(const Sequence& sequence, int q, int position, Picture& picture) {
  const Mask modules = modules_41h12(tag_of(sequence, q, position));
  for (const IdentityMark& mark : sequence.identity) {
    if (mark.projector != sequence.projectors[q].first) continue;
    const int edge = mark.side_px / kModules, inset = (mark.side_px - edge * k41h12Modules) / 2;
    for (int y = 0; y < mark.side_px; ++y)
      for (int x = 0; x < mark.side_px; ++x) {
        const int i = static_cast<int>(std::floor(static_cast<double>(x - inset) / edge)),
                  j = static_cast<int>(std::floor(static_cast<double>(y - inset) / edge));
        const bool white = std::min(i, j) >= 0 && std::max(i, j) < k41h12Modules && modules.at(i, j) != 0;
        for (int c = 0; c < 3; ++c) picture.at(mark.x + x, mark.y + y, c) = white ? 65535 : 0;
      }
  }
}

std::vector<SeenMark> find_marks(const Image& photo, const Sequence& sequence) {
  const int projectors = static_cast<int>(sequence.projectors.size()),
            frames = static_cast<int>(sequence.frames.size());
  std::vector<SeenMark> marks;
  for (const Tag& tag : find_tags(grey8(photo), TagFamily::kStandard41h12)) {
    if (tag.id >= projectors * frames) continue;
    SeenMark mark;
    mark.position = tag.id / projectors, mark.projector = tag.id % projectors;
    constexpr double kWidth = k41h12Modules - 2 * k41h12Border, kFrom = -k41h12Border / kWidth;
    Eigen::Matrix3d to_border = Eigen::Vector3d(1 / kWidth, 1 / kWidth, 1).asDiagonal();
    to_border.col(2) = Eigen::Vector3d(kFrom, kFrom, 1);
    mark.to_photo = from_unit_square(tag.corners) * to_border;
    if (!mark.to_photo.allFinite()) continue;
    const double low = -(kModules - k41h12Modules) / 2.0, high = k41h12Modules - low;
    mark.centre = at_module(mark, k41h12Modules / 2.0, k41h12Modules / 2.0);
    mark.outline = {at_module(mark, low, low), at_module(mark, high, low), at_module(mark, high, high),
                    at_module(mark, low, high)};
    marks.push_back(mark);
  }
  return marks;
}

namespace {

// What a module holds besides its own light: blur spreads that of its neighbours.
double neighbours(const Mask& modules, int x, int y) {
  const auto at = [&](int i, int j) {
    return std::min(i, j) < 0 || std::max(i, j) >= k41h12Modules ? 0 : static_cast<int>(modules.at(i, j));
  };
  return (at(x - 1, y) + at(x + 1, y) + at(x, y - 1) + at(x, y + 1)) / 4.0;
}

}  // namespace

double share_of(int other, const SeenMark& mark, const Image& photo, const Sequence& sequence) {
  if (other == mark.position) return 0;
  const Mask own = modules_41h12(tag_of(sequence, mark.projector, mark.position)),
             others = modules_41h12(tag_of(sequence, mark.projector, other));
  Eigen::Matrix4d normal = Eigen::Matrix4d::Zero();
  Eigen::Vector4d right = Eigen::Vector4d::Zero();
  for (int y = 0; y < k41h12Modules; ++y)
    for (int x = 0; x < k41h12Modules; ++x) {
      const Eigen::Vector4d by(1, neighbours(own, x, y), own.at(x, y), others.at(x, y));
      normal += by * by.transpose();
      right += light_at(photo, at_module(mark, x + 0.5, y + 0.5)) * by;
    }
  const Eigen::Vector4d fit = normal.ldlt().solve(right);
  const double sum = fit[2] + fit[3];
  return sum > 0 ? std::max(0.0, fit[3] / sum) : 0;
}

}  // namespace countershade::capture
