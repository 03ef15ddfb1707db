// Pictures as they are stored: 16-bit values, three per pixel, two to a word; and the tables that turn them into light.
layout(std430, binding = 0) readonly buffer Pictures { uint words[]; };
layout(std430, binding = 1) readonly buffer Tables { float table[]; };

uvec3 picture_value(Projector p, int pixel) {
  int first = p.start.x + 3 * pixel;
  uint a = words[first >> 1], b = words[(first >> 1) + 1];
  return (first & 1) == 0 ? uvec3(a & 0xffffu, a >> 16, b & 0xffffu) : uvec3(a >> 16, b & 0xffffu, b >> 16);
}

// Fraction of controllable light.
vec3 picture_fraction(Projector p, int pixel) {
  uvec3 v = picture_value(p, pixel) + uint(p.start.y);
  return vec3(table[v.x], table[v.y], table[v.z]);
}
