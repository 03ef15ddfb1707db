// From camera pixels to the screen: which patch a pixel sees, which projector pixel lights it, and what that makes of
// photos.
#pragma once

#include <span>
#include <vector>

#include "calib/image/image.h"
#include "solver/fit/geometry_fit.h"
#include "solver/fit/photometric_fit.h"

namespace countershade::solver {

// Per camera pixel, row-major; the camera is at the origin of the world.
struct PixelGeometry {
  int width = 0, height = 0;
  std::vector<ChartPoint> chart;                   // surface -1 = sees no surface
  std::vector<int> patch;                          // -1 likewise
  std::vector<std::vector<Eigen::Vector2f>> beam;  // per projector: its pixel, NaN where it does not light this one
};
PixelGeometry pixel_geometry(const Device& camera, const GeometryFit& geometry, const Patches& patches);

// Camera pixels per patch, (P).
Eigen::VectorXf pixels_per_patch(const PixelGeometry& pixels, int patches);

// Patch means of a photo (light 0..1 of full scale) and of each projector's light over the same pixels. lights[q] is
// the linear light of the frame on projector q, black level included. Invalid pixels are left out; a patch that loses
// more than a fifth of its pixels that way gets an infinite sigma. A one-channel photo stands for all three channels.
PatchFrame reduce_frame(const PixelGeometry& pixels, int patches, const Photo& photo, const NoiseModel& noise,
                        std::span<const Image> lights);

// What has bounced of the light that a photo shows, by the model's k and G: (height, width, channels of the photo), 0
// where no surface is seen. Patches that no pixel sees shine as their surface does on average.
Image bounced_light(const PixelGeometry& pixels, const Model& model, const Image& photo);

// Direct gain of projector q on every surface, at the cells of Model::gain_factor, from photos of it alone at full
// white and of black: (white - black) less the indirect light that k and G predict for the difference. Cells without a
// pixel take their nearest neighbours' within a patch, else 0.
// Of photos with one channel, which show the mean of the primaries: `mix` (P, 3) is the direct gain of each patch, by
// whose ratios the primaries share what is seen; empty for photos in colour.
std::vector<Image> gain_charts(const PixelGeometry& pixels, const Model& model, int q, const Photo& white,
                               const Photo& black, const PatchFrame& white_patches, const PatchFrame& black_patches,
                               const Radiosity& mix = {});

}  // namespace countershade::solver
