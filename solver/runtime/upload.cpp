#include "solver/runtime/upload.h"

#include <epoxy/gl.h>

#include <array>

#include "solver/runtime/matrix.h"

namespace countershade::solver {
namespace {

using Int4 = std::array<std::int32_t, 4>;
using Float4 = std::array<float, 4>;

// std140 layout of frame.glsl.
struct FrameBlock {
  Int4 counts{};
  struct Projector {
    Int4 size{}, start{}, gain{};
    Float4 light{};
  } projectors[kMostProjectors];
  struct Surface {
    Int4 receivers{}, gain{};
  } surfaces[kMostSurfaces];
};

// std140 layout of Overlaps in pixel.comp.
struct OverlapBlock {
  Int4 count{};
  struct Overlap {
    Int4 rectangle{}, other{};
  } overlaps[kMostProjectors];
};

// Everything of one length per projector, laid end to end, and where each begins.
struct Arrays {
  FrameBlock block;
  std::vector<float> tables, samples;
  std::vector<Eigen::Array4f> charts;
  std::size_t picture_values = 0, reduced_cells = 0;
  std::vector<std::size_t> picture_start;
};

void add_projector(const ProjectorPlan& plan, int q, Arrays& arrays) {
  FrameBlock::Projector& p = arrays.block.projectors[q];
  const int tables = static_cast<int>(arrays.tables.size());
  p.size = {plan.width, plan.height, plan.reduced_width(), plan.reduced_height()};
  p.start = {static_cast<int>(arrays.picture_values), tables, tables + 65536, static_cast<int>(arrays.reduced_cells)};
  p.gain = {static_cast<int>(arrays.charts.size()), 0, 0, 0};
  p.light = {plan.black, plan.range, 0, 0};
  arrays.picture_start.push_back(arrays.picture_values);
  arrays.picture_values += 3 * static_cast<std::size_t>(plan.width) * plan.height;
  arrays.reduced_cells += static_cast<std::size_t>(plan.reduced_width()) * plan.reduced_height();
  arrays.tables.insert(arrays.tables.end(), plan.fraction.begin(), plan.fraction.end());
  arrays.tables.insert(arrays.tables.end(), plan.encode.values().begin(), plan.encode.values().end());
  for (const Chart& chart : plan.gain)
    arrays.charts.insert(arrays.charts.end(), chart.cells.begin(), chart.cells.end());
  for (const LightSample& s : plan.samples)
    arrays.samples.insert(arrays.samples.end(), {s.x, s.y, s.gain[0], s.gain[1], s.gain[2]});
}

Arrays arrays_of(const Model& model, const FramePlan& plan) {
  Arrays arrays;
  arrays.block.counts = {static_cast<int>(plan.projectors.size()), model.screen.size(), model.patches.size(),
                         model.receivers()};
  int gain_cells = 0;
  for (int s = 0; s < model.screen.size(); ++s) {
    FrameBlock::Surface& surface = arrays.block.surfaces[s];
    surface.receivers = {model.receivers_u(s), model.receivers_v(s), model.receiver_offset(s), 0};
    if (plan.projectors.empty()) continue;
    const Chart& chart = plan.projectors[0].gain[s];
    surface.gain = {chart.nu, chart.nv, gain_cells, 0};
    for (const ProjectorPlan& p : plan.projectors)
      CS_CHECK(p.gain[s].nu == chart.nu && p.gain[s].nv == chart.nv, "gain charts of a surface must have one size");
    gain_cells += chart.nu * chart.nv;
  }
  for (std::size_t q = 0; q < plan.projectors.size(); ++q)
    add_projector(plan.projectors[q], static_cast<int>(q), arrays);
  return arrays;
}

Result<ProjectorUpload> upload_projector(const ProjectorModel& projector, const ProjectorPlan& plan) {
  const PixelMap& map = projector.map;
  ProjectorUpload upload;
  std::vector<float> pixels;
  pixels.reserve(3 * map.surface.size());
  for (std::size_t i = 0; i < map.surface.size(); ++i) {
    const bool modelled = map.surface[i] >= 0;
    pixels.insert(pixels.end(),
                  {modelled ? map.u[i] : 0.f, modelled ? map.v[i] : 0.f, static_cast<float>(map.surface[i])});
  }
  CS_TRY(upload.map, Buffer::of("the pixel map of projector " + projector.id, pixels));
  OverlapBlock block;
  std::vector<std::array<float, 2>> overlap_map;
  for (const Overlap& o : plan.overlaps) {
    block.overlaps[block.count[0]++] = {{o.x0, o.y0, o.width, o.height},
                                        {o.other, static_cast<int>(overlap_map.size()), 0, 0}};
    overlap_map.insert(overlap_map.end(), o.pixel.begin(), o.pixel.end());
  }
  CS_TRY(upload.overlap_map, Buffer::of("the overlaps of projector " + projector.id, overlap_map));
  CS_TRY(upload.overlaps, Buffer::make("a uniform block", sizeof(block), &block));
  CS_TRY(upload.shown, Texture::make("the picture of projector " + projector.id, plan.width, plan.height));
  return upload;
}

}  // namespace

Result<Upload> Upload::make(const Model& model, const FramePlan& plan) {
  if (plan.projectors.size() > kMostProjectors || model.screen.size() > kMostSurfaces)
    return error(ErrorCode::kUnsupported, "{} projectors and {} surfaces: GL takes at most {} and {}; use the CPU",
                 plan.projectors.size(), model.screen.size(), kMostProjectors, kMostSurfaces);
  const Arrays arrays = arrays_of(model, plan);
  Upload upload;
  upload.picture_start = arrays.picture_start;
  upload.picture_values = arrays.picture_values;
  // One word more than the pictures: a pixel is read as two whole words.
  CS_TRY(upload.pictures, Buffer::make("the pictures", 2 * arrays.picture_values + 4, nullptr));
  CS_TRY(upload.block, Buffer::make("a uniform block", sizeof(arrays.block), &arrays.block));
  CS_TRY(upload.tables, Buffer::of("the responses", arrays.tables));
  CS_TRY(upload.charts, Buffer::of("the gain charts", arrays.charts));
  CS_TRY(upload.chart_texture, BufferTexture::make("the gain charts", upload.charts, arrays.charts.size()));
  CS_TRY(upload.samples, Buffer::of("the sample points of the patches", arrays.samples));
  CS_TRY(upload.reduced, Buffer::make("the reduced pictures", 16 * arrays.reduced_cells, nullptr));
  CS_TRY(upload.ambient, Buffer::of("the ambient light", as_vec4(model.e)));
  CS_TRY(upload.low, Buffer::of("the black levels", as_vec4(plan.low)));
  CS_TRY(upload.high, Buffer::of("the white levels", as_vec4(plan.high)));
  for (std::size_t q = 0; q < plan.projectors.size(); ++q) {
    CS_TRY(ProjectorUpload projector, upload_projector(model.projectors[q], plan.projectors[q]));
    upload.projectors.push_back(std::move(projector));
  }
  return upload;
}

void Upload::send(std::span<const Picture> frame) const {
  glBindBuffer(GL_SHADER_STORAGE_BUFFER, pictures.id());
  const auto size = static_cast<GLsizeiptr>((2 * picture_values + 4 + 15) / 16 * 16);
  glBufferData(GL_SHADER_STORAGE_BUFFER, size, nullptr,
               GL_STREAM_DRAW);  // a fresh store: the former frame may be in use
  std::vector<std::uint16_t> black;
  for (std::size_t q = 0; q < frame.size(); ++q) {
    const std::size_t end = q + 1 < picture_start.size() ? picture_start[q + 1] : picture_values;
    const std::size_t count = end - picture_start[q];
    if (frame[q].empty()) black.resize(std::max(black.size(), count), 0);
    const std::uint16_t* values = frame[q].empty() ? black.data() : frame[q].data().data();
    glBufferSubData(GL_SHADER_STORAGE_BUFFER, static_cast<GLintptr>(2 * picture_start[q]),
                    static_cast<GLsizeiptr>(2 * count), values);
  }
}

}  // namespace countershade::solver
