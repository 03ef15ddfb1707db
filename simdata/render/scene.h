// The walls as light sees them: nearest hit and visibility (Embree inside).
#pragma once

#include <memory>

#include "calib/base/result.h"
#include "calib/geometry/screen.h"

namespace countershade::simdata {

// What a ray meets first.
struct SceneHit {
  ChartPoint at;       // surface = -1: the ray escapes
  bool front = false;  // the lit side; the back of a wall is black
};

class Scene {
 public:
  // Surfaces must be planes (kUnsupported otherwise).
  static Result<std::shared_ptr<const Scene>> make(const Screen& screen);
  ~Scene();

  const Screen& screen() const { return screen_; }
  const PlaneSurface& plane(int surface) const { return static_cast<const PlaneSurface&>(*screen_.surfaces[surface]); }
  // `from` lies on the lit side of surface `own`, whose normal keeps the ray from meeting it again.
  SceneHit hit(int own, const Eigen::Vector3d& from, const Eigen::Vector3d& direction) const;
  // Whether nothing stands between a point of surface `own` and a point in the room, or on surface `other`.
  bool visible(int own, const Eigen::Vector3d& from, const Eigen::Vector3d& to, int other = -1) const;

 private:
  struct Embree;
  Scene(Screen screen, std::unique_ptr<Embree> embree);
  Screen screen_;
  std::unique_ptr<Embree> embree_;
  std::vector<std::vector<char>> before_;  // [a][b]: all of wall a lies before the plane of wall b
};

// Direction of the cosine-weighted hemisphere about `normal` for (a, b) in the unit square, tangent along `tangent`.
// The map of square to disc keeps neighbours together (Shirley & Chiu 1997), so that strata stay compact.
Eigen::Vector3d cosine_direction(const Eigen::Vector3d& normal, const Eigen::Vector3d& tangent, double a, double b);

}  // namespace countershade::simdata
