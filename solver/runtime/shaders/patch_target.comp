// What the frame asks for at a patch: R = e + mean over its 64 sample points of sum_q a_q l_q. One workgroup per patch.
#include "frame.glsl"
#include "taps.glsl"
layout(local_size_x = 64) in;
layout(std430, binding = 0) readonly buffer Samples { float samples[]; };  // [projector][patch][64][x, y, a rgb]
layout(std430, binding = 1) readonly buffer Reduced { vec4 reduced[]; };
layout(std430, binding = 2) readonly buffer Ambient { vec4 ambient[]; };
layout(std430, binding = 3) writeonly buffer Target { vec4 target[]; };
shared vec3 partial[64];

void main() {
  int patch_index = int(gl_WorkGroupID.x), lane = int(gl_LocalInvocationID.x);
  vec3 sum = vec3(0);
  for (int q = 0; q < counts.x; ++q) {
    Projector p = projectors[q];
    int at = 5 * ((q * counts.z + patch_index) * 64 + lane);
    vec3 gain = vec3(samples[at + 2], samples[at + 3], samples[at + 4]);
    ivec4 index;
    vec4 weight;
    taps(vec2(samples[at], samples[at + 1]), p.size.zw, index, weight);
    index += p.start.w;
    vec3 light = weight.x * reduced[index.x].rgb + weight.y * reduced[index.y].rgb + weight.z * reduced[index.z].rgb +
                 weight.w * reduced[index.w].rgb;
    sum += gain * (p.light.x + p.light.y * light);
  }
  partial[lane] = sum;
  barrier();
  if (lane < 8) {
    for (int n = lane + 8; n < 64; n += 8) sum += partial[n];
    partial[lane] = sum;
  }
  barrier();
  if (lane == 0) {
    for (int n = 1; n < 8; ++n) sum += partial[n];
    target[patch_index] = ambient[patch_index] + vec4(sum / 64, 0);
  }
}
