// The default room, seen by a small camera and lit by small projectors: fast enough for tests.
#pragma once

#include "simdata/render/simulator.h"
#include "simdata/room/rooms.h"

namespace countershade::test {

inline simdata::RigAndRoom small_room() {
  simdata::RigAndRoom made = simdata::small_two_wall(8, {160, 100}, 256);
  made.simulation.block_px = 4;
  return made;
}

inline std::shared_ptr<simdata::Simulator> simulate(const simdata::RigAndRoom& room) {
  SilentProgress progress;
  auto made = simdata::Simulator::make(room.rig, room.simulation, progress);
  CS_CHECK(made.has_value(), made.has_value() ? "" : made.error().message);
  return *made;
}

// A picture of the small projectors; value(x, y, c) in 0..1, encoded.
template <class Value>
Picture picture(Value value, int width = 160, int height = 100) {
  Picture p(width, height, 3);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x)
      for (int c = 0; c < 3; ++c) p.at(x, y, c) = static_cast<std::uint16_t>(std::lround(65535 * value(x, y, c)));
  return p;
}
inline Picture flat(double value) {
  return picture([=](int, int, int) { return value; });
}
// Smooth and different in every index.
inline Picture waves(int q) {
  return picture([=](int x, int y, int c) {
    return .5 + .3 * std::sin(.03 * x + .02 * y + c + 2 * q) + .15 * std::cos(.05 * y - .01 * x + q);
  });
}

// Whether a pixel and its neighbours see one wall only.
inline bool inside_wall(const simdata::TrueGeometry& g, int x, int y) {
  if (x < 1 || y < 1 || x + 1 >= g.surface.width() || y + 1 >= g.surface.height()) return false;
  for (int dy = -1; dy <= 1; ++dy)
    for (int dx = -1; dx <= 1; ++dx)
      if (g.surface.at(x, y) < 0 || g.surface.at(x + dx, y + dy) != g.surface.at(x, y)) return false;
  return true;
}

}  // namespace countershade::test
