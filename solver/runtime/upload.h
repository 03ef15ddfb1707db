// A model in GL buffers: what runtime.cpp binds and the shaders read.
#pragma once

#include <span>
#include <vector>

#include "solver/compensate/frame_plan.h"
#include "solver/runtime/gl_objects.h"

namespace countershade::solver {

inline constexpr int kMostProjectors = 16;
inline constexpr int kMostSurfaces = 32;

struct ProjectorUpload {
  Buffer map;          // u, v, surface per pixel
  Buffer overlaps;     // uniform block Overlaps of pixel.comp
  Buffer overlap_map;  // the other projectors' pixels, rectangle after rectangle
  Texture shown;       // the picture to show
};

struct Upload {
  Buffer block;     // uniform block Frame of frame.glsl
  Buffer pictures;  // 16-bit values, projector after projector
  Buffer tables;    // light and encode tables, projector after projector
  Buffer charts;    // gain charts, projector after projector
  BufferTexture chart_texture;
  Buffer samples;  // sample points of the patches
  Buffer reduced;  // reduced light
  Buffer ambient, low, high;
  std::vector<ProjectorUpload> projectors;
  std::vector<std::size_t> picture_start;  // in 16-bit values
  std::size_t picture_values = 0;

  // Errors: kUnsupported for more projectors or surfaces than the shaders' blocks hold, kDevice for the driver's
  // limits.
  static Result<Upload> make(const Model& model, const FramePlan& plan);
  // Sends the pictures of a frame (empty = black) without waiting for the former one.
  void send(std::span<const Picture> frame) const;
};

}  // namespace countershade::solver
