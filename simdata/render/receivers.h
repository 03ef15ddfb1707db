// Points of a surface at which indirect light is computed, and interpolation between them.
#pragma once

#include <Eigen/Dense>
#include <array>
#include <cstdint>
#include <vector>

#include "simdata/render/scene.h"

namespace countershade::simdata {

// Where receivers stand along one side of a chart: indirect light has detail of the size of the distance d from an edge
// where surfaces meet, so the spacing grows like sqrt(d) from such an edge.
class Spacing {
 public:
  Spacing() = default;
  // first, last: whether another surface is met at 0 and at 1.
  Spacing(int count, bool first, bool last) : count_(count), first_(first), last_(last) {}
  int count() const { return count_; }
  // Place of the receiver number i, in (0, 1).
  double place(int i) const { return from_even((i + 0.5) / count_); }
  // Its inverse: number of the receiver at a place, a fraction between two.
  double number(double place) const { return to_even(place) * count_ - 0.5; }

 private:
  double from_even(double t) const;
  double to_even(double place) const;
  int count_ = 2;
  bool first_ = false, last_ = false;
};

class Receivers {
 public:
  struct Stencil {
    std::array<std::uint16_t, 4> index;
    std::array<float, 4> weight;
  };

  // About `count` receivers of a surface that has a chart, in rows along its longer side; the corners of a mesh,
  // whatever `count` says.
  Receivers(const Scene& scene, int surface, int count);

  int size() const { return static_cast<int>(points_.size()); }
  const SurfacePoint& point(int index) const { return points_[index]; }
  // Bilinear on the chart, continued linearly beyond the outermost receivers, or around a closed one; linear on a
  // triangle.
  Stencil stencil(const SurfacePoint& at) const;

 private:
  void stand_on_mesh(const MeshShape& mesh, int surface);
  Spacing u_, v_;
  bool closed_ = false;
  const MeshShape* mesh_ = nullptr;
  std::vector<SurfacePoint> points_;
};

}  // namespace countershade::simdata
