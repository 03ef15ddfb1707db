// How the solution of this frame went. Floats are not negative, so their bits sort like them.
layout(std430, binding = 7) buffer State {
  uint largest_indirect;  // bits of max K R
  uint clips;             // whether any patch would clip
  uint clipped_pixels[64];  // one counter per place in a workgroup, so that few wait for each other
  uint change[];          // bits of the largest move of each gather
};
