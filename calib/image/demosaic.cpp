#include "calib/image/demosaic.h"

#include <array>
#include <cmath>
#include <string_view>

#include "calib/base/parallel.h"

namespace countershade {

Image demosaiced(const Image& mosaic, const std::string& pattern) {
  const int width = mosaic.width(), height = mosaic.height();
  std::array<int, 4> colours;
  for (int i = 0; i < 4; ++i) colours[i] = static_cast<int>(std::string_view("RGB").find(pattern.at(i)));
  const auto colour = [&](int x, int y) { return colours[(y & 1) * 2 + (x & 1)]; };
  const auto mirrored = [](int i, int size) { return i < 0 ? -i : i >= size ? 2 * size - 2 - i : i; };
  Image out(width, height, 3);
  parallel_for(height, [&](int y) {
    for (int x = 0; x < width; ++x) {
      std::array<float, 3> sum{}, count{};
      for (int dy = -1; dy <= 1; ++dy)
        for (int dx = -1; dx <= 1; ++dx) {
          const int c = colour(x + dx, y + dy);
          sum[c] += mosaic.at(mirrored(x + dx, width), mirrored(y + dy, height)), ++count[c];
        }
      const int own = colour(x, y);
      for (int c = 0; c < 3; ++c) out.at(x, y, c) = c == own ? mosaic.at(x, y) : std::floor(sum[c] / count[c] + 0.5f);
    }
  });
  return out;
}

}  // namespace countershade
