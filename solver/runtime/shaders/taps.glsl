// The four cells around a point of a grid, and their bilinear weights. cell: in cells, the first one's centre is (0, 0);
// clamped, so that a chart never mixes with its neighbour.
void taps(vec2 cell, ivec2 size, out ivec4 index, out vec4 weight) {
  cell = clamp(cell, vec2(0), vec2(size - 1));
  ivec2 low = ivec2(cell);
  ivec2 high = min(low + 1, size - 1);
  vec2 f = cell - vec2(low);
  index = ivec4(low.y * size.x + low.x, low.y * size.x + high.x, high.y * size.x + low.x, high.y * size.x + high.x);
  weight = vec4((1 - f.x) * (1 - f.y), f.x * (1 - f.y), (1 - f.x) * f.y, f.x * f.y);
}
