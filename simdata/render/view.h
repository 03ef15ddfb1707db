// What one camera sees of the room, sampled once: 2 x 2 rays per pixel.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "calib/file/rig.h"
#include "simdata/render/indirect.h"

namespace countershade::simdata {

class View {
 public:
  // viewer: which of those of `indirect` it is.
  View(const SimulatedCamera& spec, const Device& device, const Scene& scene, const std::vector<Emitter>& emitters,
       const Paint& paint, const IndirectLight& indirect, int viewer, double ambient);

  const SimulatedCamera& spec() const { return spec_; }
  const Device& device() const { return device_; }
  // Share of the picture's pixels that see a surface's lit side.
  double coverage() const { return coverage_; }
  // Radiosity to full scale at the reference exposure, vignetting left out.
  float scale() const { return scale_; }
  void set_scale(float scale) { scale_ = scale; }
  // Share of light that the lens keeps at a pixel.
  double transmission(double x, double y) const;

  // First hits, (height, width, channels), times scale.
  Image direct(std::span<const PictureLight> light, const IndirectLight& indirect) const;
  // The indirect light `field`, as IndirectLight::solve gives it for this camera, reflected.
  Image reflected(const std::vector<Rgb>& field) const;
  // Both together.
  Image total(std::span<const PictureLight> light, const std::vector<Rgb>& field, const IndirectLight& indirect) const;

 private:
  struct BeamSample {  // one subsample that one projector, or daylight, lights
    float x, y, level, factor;
    std::uint16_t column, surface;
  };
  struct WallSample {  // one surface seen by one pixel; surface = kNone: the surround
    Receivers::Stencil stencil;
    float factor;
    std::uint16_t column, field;  // field: the surface, or surfaces + surface for what its gloss mirrors
  };
  static constexpr std::uint16_t kNone = 0xffff;
  struct Traced {  // what the samples are taken from
    const Scene& scene;
    const std::vector<Emitter>& emitters;
    const IndirectLight& indirect;
  };
  struct Seen {  // one surface in one pixel: charts are averaged, since light is smooth on them
    SurfacePoint at;
    double factor = 0;
    int count = 0;
  };
  void sample_row(int y, const Traced& traced);
  void add_seen(std::vector<Seen>& seen, const Traced& traced, const SurfacePoint& at, double factor) const;
  void sample_beams(int y, std::uint16_t column, const Traced& traced, const SurfacePoint& at, double factor);
  void sample_wall(int y, std::uint16_t column, const Traced& traced, const Seen& seen);
  void add_direct(int y, std::span<const PictureLight> light, const IndirectLight& indirect,
                  std::vector<Light4>& row) const;
  void add_reflected(int y, const std::vector<Rgb>& field, std::vector<Light4>& row) const;
  template <class AddRow>
  Image image_of(AddRow add_row) const;
  void write_row(Image& image, int y, const std::vector<Light4>& row) const;

  SimulatedCamera spec_;
  Device device_;
  std::vector<Light4> base_;  // per field
  int surfaces_ = 0, viewer_ = 0;
  const Paint& paint_;
  float ambient_ = 0, scale_ = 1;
  double coverage_ = 0;
  std::vector<std::vector<std::vector<BeamSample>>> beams_;  // [projector, at last daylight][row]
  std::vector<std::vector<WallSample>> walls_;               // [row]
};

}  // namespace countershade::simdata
