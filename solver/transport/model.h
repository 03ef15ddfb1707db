// The model of a calibrated rig: everything the compensation needs, and nothing else.
//
//   B = D + K B,  K = diag(k) F,  D = sum_q a_q p_q + e       (camera units: 1 = full scale of the photos)
//
// Light is known on two grids of each surface: patches (senders and unknowns) and receivers (where the indirect light
// is brought back to projector pixels: cell centres of a grid `receiver_factor` times finer than the patches).
#pragma once

#include <Eigen/Dense>
#include <filesystem>
#include <string>
#include <vector>

#include "calib/base/result.h"
#include "calib/geometry/lens.h"
#include "calib/geometry/screen.h"
#include "calib/image/image.h"
#include "calib/photometry/response.h"

namespace countershade::solver {

using Radiosity = Eigen::MatrixX3f;  // (P, 3), linear, camera units

inline constexpr int kMaxSurfaces = 127;  // what PixelMap's surface can number

// One projector pixel per entry, (height, width).
struct PixelMap {
  int width = 0, height = 0;
  std::vector<std::int8_t> surface;  // -1 = lights nothing that is modelled
  std::vector<float> u, v;
};

struct ProjectorModel {
  std::string id;
  ProjectorResponse response;
  Device device;  // world = frame of the screen
  PixelMap map;
  std::vector<Image> gain;  // a_q per surface: (nv * gain_factor, nu * gain_factor, 3) at cell centres, camera units
};

struct Model {
  Screen screen;
  Patches patches;
  std::vector<std::shared_ptr<const PlaneSurface>> planes;  // the same surfaces, as planes
  Eigen::MatrixXf F;                                        // (P, P)
  Eigen::MatrixXf G;                                        // (R, P) point form factors of the receivers
  Radiosity k;                                              // (P, 3) indirect gain
  Radiosity e;              // (P, 3) direct part of ambient light, without the projectors' black level
  int receiver_factor = 2;  // receivers per patch and axis
  int gain_factor = 4;      // gain samples per patch and axis
  std::vector<ProjectorModel> projectors;
  double white = 1;  // W of CONTRACT: 99th percentile of the direct light of the strongest projector

  int receivers() const { return patches.size() * receiver_factor * receiver_factor; }
  // Receiver grid of a surface: receivers_u x receivers_v cell centres, row-major by v, behind those of former
  // surfaces.
  int receivers_u(int surface) const { return patches.nu(surface) * receiver_factor; }
  int receivers_v(int surface) const { return patches.nv(surface) * receiver_factor; }
  int receiver_offset(int surface) const { return patches.offset(surface) * receiver_factor * receiver_factor; }
};

// Chart points of all receivers, in index order.
std::vector<ChartPoint> receiver_points(const Patches& patches, int receiver_factor);

// Surface and chart of every pixel of a projector, by intersecting its rays with the screen (of at most kMaxSurfaces).
PixelMap pixel_map(const Device& projector, const Screen& screen);

// Value of a chart image (cell-centred samples) at (u, v), bilinear, clamped: the surfaces' own texture, no neighbours.
float sample_chart(const Image& chart, double u, double v, int c);

// Indirect gain at the receivers, bilinear in each surface's patches: (R, 3).
Radiosity receiver_gain(const Model& model);

// A model's folder: model.json, F.npy, G.npy, k.npy, e.npy (float32), gain_<projector>_<surface>.exr (R, G, B). The
// folder must exist. Equal models give equal bytes; what is read is what was written, bit for bit. The pixel maps are
// recomputed on reading. Errors: kIo; kBadFile names the file and what is wrong in it (shape, range, not finite).
Result<void> write_model(const std::filesystem::path& folder, const Model& model);
Result<Model> read_model(const std::filesystem::path& folder);

}  // namespace countershade::solver
