// One bounce, y = diag(k) F x, for a band of rows; and what a solver does with it. Columns come in pairs, the rows of a
// pair side by side, so that neighbouring threads read neighbouring words. HALF: two half floats in a word, scaled by a
// power of two because form factors of small patches would be denormal.
#include "state.glsl"
layout(local_size_x = 32, local_size_y = 8) in;
#ifdef HALF
layout(std430, binding = 0) readonly buffer Matrix { uint pairs_of[]; };
vec2 columns_at(int i) { return unpackHalf2x16(pairs_of[i]); }
#else
layout(std430, binding = 0) readonly buffer Matrix { vec2 pairs_of[]; };
vec2 columns_at(int i) { return pairs_of[i]; }
#endif
layout(std430, binding = 1) readonly buffer Input { vec4 x[]; };
layout(std430, binding = 2) writeonly buffer Output { vec4 result[]; };
layout(std430, binding = 3) readonly buffer Base { vec4 base[]; };
layout(std430, binding = 4) readonly buffer Low { vec4 low[]; };
layout(std430, binding = 5) readonly buffer High { vec4 high[]; };
layout(std430, binding = 6) readonly buffer Gain { vec4 gain[]; };

layout(location = 0) uniform int first_row;
layout(location = 1) uniform int rows;
layout(location = 2) uniform int stride;   // rows, rounded up to whole workgroups
layout(location = 3) uniform int pairs;
layout(location = 4) uniform int skip;     // columns [skip, skip + skipped) are not stored
layout(location = 5) uniform int skipped;
layout(location = 6) uniform int columns;  // of x
layout(location = 7) uniform float unscale;
// 0: K x.  1: base + K x.  2: base - K x.  3: a step of the clipped solution, clip(base - K x, low, high) + K x.
layout(location = 8) uniform int mode;
layout(location = 9) uniform int iteration;     // of mode 3
layout(location = 10) uniform float tolerance;  // the former step moved no further: done, x is the solution
layout(location = 11) uniform float invisible;  // indirect light below this needs no solution

const int kRows = 4;  // of every thread, so that x is fetched once for all of them
shared vec3 partial[8][32 * kRows];

int stored_column(int n) { return min(n < skip ? n : n + skipped, columns - 1); }

bool done() {
  return mode == 3 && iteration > 0 &&
         (uintBitsToFloat(change[iteration - 1]) <= tolerance || uintBitsToFloat(largest_indirect) < invisible);
}

vec3 clipped_step(int row, vec3 indirect) {
  vec3 wanted = base[row].rgb - indirect;
  vec3 shown = clamp(wanted, low[row].rgb, high[row].rgb) + indirect;
  vec3 move = abs(shown - x[row].rgb);
  atomicMax(change[iteration], floatBitsToUint(max(move.r, max(move.g, move.b))));
  if (iteration == 0) {
    atomicMax(largest_indirect, floatBitsToUint(max(0.0, max(indirect.r, max(indirect.g, indirect.b)))));
    if (any(lessThan(wanted, low[row].rgb))) atomicOr(clips, 1u);
  }
  return shown;
}

void finish(int row, vec3 sum) {
  vec3 indirect = sum * unscale * gain[row].rgb;
  if (mode == 0) result[row] = vec4(indirect, 0);
  if (mode == 1) result[row] = base[row] + vec4(indirect, 0);
  if (mode == 2) result[row] = base[row] - vec4(indirect, 0);
  if (mode == 3) result[row] = vec4(clipped_step(row, indirect), 0);
}

void main() {
  int lane = int(gl_LocalInvocationID.x), slice = int(gl_LocalInvocationID.y);
  int local = int(gl_WorkGroupID.x) * 32 * kRows + lane;
  // The rows of a workgroup are shared among its slices again when the sums are finished.
  int own = int(gl_WorkGroupID.x) * 32 * kRows + slice * 32 + lane;
  if (done()) {
    if (slice < kRows && own < rows) result[first_row + own] = x[first_row + own];
    return;
  }
  vec3 sum[kRows];
  for (int r = 0; r < kRows; ++r) sum[r] = vec3(0);
  for (int pair = slice; pair < pairs; pair += 8) {
    vec3 a = x[stored_column(2 * pair)].rgb, b = x[stored_column(2 * pair + 1)].rgb;
    for (int r = 0; r < kRows; ++r) {
      vec2 f = columns_at(pair * stride + local + 32 * r);
      sum[r] += f.x * a + f.y * b;
    }
  }
  for (int r = 0; r < kRows; ++r) partial[slice][32 * r + lane] = sum[r];
  barrier();
  if (slice >= kRows || own >= rows) return;
  vec3 total = vec3(0);
  for (int n = 0; n < 8; ++n) total += partial[n][32 * slice + lane];
  finish(first_row + own, total);
}
