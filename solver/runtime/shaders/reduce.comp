// Means of blocks of REDUCTION x REDUCTION pixels in linear light, the last ones of what there is.
#include "frame.glsl"
#include "picture.glsl"
layout(local_size_x = 8, local_size_y = 8) in;
layout(location = 0) uniform int projector;
layout(std430, binding = 2) writeonly buffer Reduced { vec4 reduced[]; };

void main() {
  Projector p = projectors[projector];
  ivec2 block = ivec2(gl_GlobalInvocationID.xy);
  if (any(greaterThanEqual(block, p.size.zw))) return;
  ivec2 low = block * REDUCTION;
  ivec2 high = min(low + REDUCTION, p.size.xy);
  vec3 sum = vec3(0);
  for (int y = low.y; y < high.y; ++y)
    for (int x = low.x; x < high.x; ++x) sum += picture_fraction(p, y * p.size.x + x);
  ivec2 extent = high - low;
  reduced[p.start.w + block.y * p.size.z + block.x] = vec4(sum / float(extent.x * extent.y), 0);
}
