// What every shader knows of the model; the layout is FrameBlock of runtime.cpp.
struct Projector {
  ivec4 size;   // picture width, height; reduced width, height
  ivec4 start;  // of the picture [16-bit values], of its light table, of its encode table, of its reduced light
  ivec4 gain;   // start of its gain charts
  vec4 light;   // black, range: light = black + range * fraction
};
struct Surface {
  ivec4 receivers;  // cells along u and v, start
  ivec4 gain;       // cells along u and v, start within a projector's charts
};
layout(std140, binding = 0) uniform Frame {
  ivec4 counts;  // projectors, surfaces, patches, receivers
  Projector projectors[MAX_PROJECTORS];
  Surface surfaces[MAX_SURFACES];
};
