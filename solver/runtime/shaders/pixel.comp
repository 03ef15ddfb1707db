// Takes the indirect light S out of one projector's pixels. With C the controllable light that all projectors together
// add at the pixel's point, each keeps the share 1 - S/C of its own, so that overlaps stay consistent.
#include "frame.glsl"
#include "picture.glsl"
#include "state.glsl"
#include "taps.glsl"
layout(local_size_x = 8, local_size_y = 8) in;
layout(rgba16, binding = 0) writeonly uniform image2D shown;
layout(binding = 0) uniform samplerBuffer chart_gain;
layout(binding = 1) uniform samplerBuffer indirect;  // at the receivers
layout(std430, binding = 4) readonly buffer Map { float map[]; };         // u, v, surface (-1 = none) per pixel
layout(std430, binding = 5) readonly buffer OverlapMap { vec2 other_pixel[]; };
struct Overlap {
  ivec4 rectangle;  // x0, y0, width, height
  ivec4 other;      // projector, start in OverlapMap
};
layout(std140, binding = 1) uniform Overlaps {
  ivec4 overlap_count;
  Overlap overlaps[MAX_PROJECTORS];
};
layout(location = 0) uniform int projector;
layout(location = 1) uniform int bits;
layout(location = 2) uniform int dithered;
layout(location = 3) uniform float invisible;

vec3 gain_at(int q, int surface, vec2 uv) {
  ivec4 chart = surfaces[surface].gain;
  ivec4 i;
  vec4 w;
  taps(uv * vec2(chart.xy) - .5, chart.xy, i, w);
  i += projectors[q].gain.x + chart.z;
  return w.x * texelFetch(chart_gain, i.x).rgb + w.y * texelFetch(chart_gain, i.y).rgb + w.z * texelFetch(chart_gain, i.z).rgb + w.w * texelFetch(chart_gain, i.w).rgb;
}

vec3 indirect_at(int surface, vec2 uv) {
  ivec4 chart = surfaces[surface].receivers;
  ivec4 i;
  vec4 w;
  taps(uv * vec2(chart.xy) - .5, chart.xy, i, w);
  i += chart.z;
  return w.x * texelFetch(indirect, i.x).rgb + w.y * texelFetch(indirect, i.y).rgb + w.z * texelFetch(indirect, i.z).rgb + w.w * texelFetch(indirect, i.w).rgb;
}

vec3 others_at(ivec2 pixel, int surface, vec2 uv) {
  vec3 sum = vec3(0);
  for (int n = 0; n < overlap_count.x; ++n) {
    Overlap o = overlaps[n];
    ivec2 local = pixel - o.rectangle.xy;
    if (any(lessThan(local, ivec2(0))) || any(greaterThanEqual(local, o.rectangle.zw))) continue;
    vec2 at = other_pixel[o.other.y + local.y * o.rectangle.z + local.x];
    if (at.x < -1e6) continue;
    Projector r = projectors[o.other.x];
    ivec4 i;
    vec4 w;
    taps(at, r.size.xy, i, w);
    vec3 fraction = w.x * picture_fraction(r, i.x) + w.y * picture_fraction(r, i.y) + w.z * picture_fraction(r, i.z) +
                    w.w * picture_fraction(r, i.w);
    sum += gain_at(o.other.x, surface, uv) * r.light.y * fraction;
  }
  return sum;
}

// EncodeTable of frame_plan.h.
float encode(Projector p, float fraction) {
  const uint kFirst = (127u - 32u) << 23;
  if (!(fraction > 0)) return 0;
  int start = p.start.z;
  uint b = floatBitsToUint(min(fraction, 1.0));
  if (b < kFirst) return table[start] * (fraction * 4294967296.0);
  int i = start + int((b - kFirst) >> 15);
  float part = float((b - kFirst) & 32767u) * (1.0 / 32768.0);
  float low = table[i];
  return fraction >= 1 ? low : low + part * (table[i + 1] - low);
}

// dither() of compensate.h, in the same whole numbers.
float dither(ivec2 pixel, int channel) {
  uint inner = uint(pixel.x + 47 * channel) * 288237660u + uint(pixel.y + 17 * channel) * 25070368u;
  uint high, low;
  umulExtended(inner, 4221604526u, high, low);
  return (float((inner * 52u + high) >> 8) * (1.0 / 16777216.0) - .5) * .996;
}

uint quantise(float encoded, float lsb) {
  uint top = (1u << uint(bits)) - 1u;
  float code = floor(encoded * float(top) + (.5 + lsb));
  uint n = uint(clamp(code, 0.0, float(top)));
  return (n * 65535u + top / 2u) / top;
}

// Returns whether the pixel is clipped.
bool compensate(Projector p, ivec2 pixel, int i, int surface, inout uvec3 value) {
  vec2 uv = vec2(map[3 * i], map[3 * i + 1]);
  vec3 S = indirect_at(surface, uv);
  vec3 a = gain_at(projector, surface, uv);
  vec3 own = picture_fraction(p, i);
  vec3 C = a * p.light.y * own + others_at(pixel, surface, uv);
  bool clipped = false;
  for (int c = 0; c < 3; ++c) {
    if (!(S[c] > 0) || !(a[c] > 0)) continue;
    clipped = clipped || S[c] > C[c];
    float keep = C[c] > S[c] ? 1 - S[c] / C[c] : 0.0;
    value[c] = quantise(encode(p, own[c] * keep), dithered != 0 ? dither(pixel, c) : 0.0);
  }
  return clipped;
}

void main() {
  Projector p = projectors[projector];
  ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
  if (any(greaterThanEqual(pixel, p.size.xy))) return;
  int i = pixel.y * p.size.x + pixel.x;
  uvec3 value = picture_value(p, i);
  int surface = int(map[3 * i + 2]);
  bool copy = uintBitsToFloat(largest_indirect) < invisible;
  if (surface >= 0 && !copy && compensate(p, pixel, i, surface, value))
    atomicAdd(clipped_pixels[gl_LocalInvocationIndex], 1u);
  imageStore(shown, pixel, vec4(vec3(value) / 65535.0, 1));
}
