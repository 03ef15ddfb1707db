// The measured target against the simulator's own direct light.
#include "tools/job/photographs.h"

#include <gtest/gtest.h>

#include <cmath>

#include "simdata/render/simulator.h"
#include "simdata/room/rooms.h"
#include "tools/job/test_pictures.h"

namespace countershade::tools {
namespace {

double mean_distance(const Image& a, const Image& b, const Mask& mask) {
  double sum = 0;
  std::size_t count = 0;
  for (std::size_t i = 0; i < mask.data().size(); ++i)
    for (int c = 0; mask.data()[i] && c < 3; ++c, ++count) sum += std::abs(a.data()[3 * i + c] - b.data()[3 * i + c]);
  return sum / count;
}

TEST(Photograph, MeasuresTheDirectLightWithoutAModel) {
  const simdata::RigAndRoom made = simdata::small_two_wall(3, {480, 300}, 256);
  SilentProgress progress;
  const auto simulator = simdata::Simulator::make(made.rig, made.simulation, progress).value();
  const capture::Devices devices = simdata::simulated_devices(simulator);
  const simdata::TrueGeometry truth = simulator->geometry(0);
  solver::PixelGeometry pixels;
  pixels.width = truth.depth.width(), pixels.height = truth.depth.height();
  Mask lit(pixels.width, pixels.height, 1);
  for (int q = 0; q < 2; ++q) {
    pixels.beam.emplace_back(lit.data().size());
    for (std::size_t i = 0; i < lit.data().size(); ++i) {
      pixels.beam[q][i] = {truth.projector_x[q].data()[i], truth.projector_y[q].data()[i]};
      lit.data()[i] |= !std::isnan(pixels.beam[q][i].x());
    }
  }
  std::vector<Picture> plain;
  for (int q = 0; q < 2; ++q) plain.push_back(test_picture("photo", q, 480, 300).value());
  const auto photos = photograph(devices, made.rig.cameras[0], pixels, plain, plain, 0, 4, progress);
  ASSERT_TRUE(photos) << photos.error().message;
  const simdata::TrueLight light = simulator->light(0, plain);
  const Image direct = simulator->optics(0, light.direct);
  const double veil = mean_distance(photos->uncompensated, direct, lit),
               left = mean_distance(photos->target, direct, lit);
  // 12-pixel stripes are coarser here than on a full-size projector, and every pixel carries the noise of nine photos
  // of four exposures each: half a percent of white. The veil is ten times that.
  EXPECT_GT(veil, 0.015);
  EXPECT_LT(left, 0.12 * veil);
  // Without bias: over blocks of 8 x 8 pixels the noise is gone, and with it most of the distance.
  double bias = 0;
  std::size_t count = 0;
  for (std::size_t i = 0; i < lit.data().size(); ++i)
    for (int c = 0; lit.data()[i] && c < 3; ++c, ++count)
      bias += photos->target.data()[3 * i + c] - direct.data()[3 * i + c];
  EXPECT_LT(std::abs(bias / count), 0.02 * veil);

  // The same through a lens with glare, once it is told so.
  simdata::RigAndRoom hazy = made;
  hazy.simulation.cameras[0].veiling_glare = 0.08;
  const capture::Devices hazy_devices =
      simdata::simulated_devices(simdata::Simulator::make(hazy.rig, hazy.simulation, progress).value());
  const auto cleared =
      photograph(hazy_devices, made.rig.cameras[0], pixels, plain, plain, 0.08 / 1.08, 4, progress).value();
  for (const auto& [a, b] :
       {std::pair(&cleared.uncompensated, &photos->uncompensated),
        std::pair(&cleared.compensated, &photos->compensated), std::pair(&cleared.target, &photos->target)}) {
    double mean = 0, difference = 0;
    for (std::size_t i = 0; i < a->data().size(); ++i) mean += b->data()[i], difference += a->data()[i] - b->data()[i];
    EXPECT_LT(std::abs(difference), 1e-3 * mean);  // of 8 %; noise averages out
  }

  // And of displays that are late: bit for bit, since a photo's noise follows from what is seen.
  simdata::RigAndRoom late = made;
  for (SimulatedProjector& p : late.simulation.projectors) p.latency_ms = 120;
  const capture::Devices late_devices =
      simdata::simulated_devices(simdata::Simulator::make(late.rig, late.simulation, progress).value());
  const auto waited = photograph(late_devices, made.rig.cameras[0], pixels, plain, plain, 0, 4, progress).value();
  EXPECT_EQ(waited.uncompensated.data(), photos->uncompensated.data());
  EXPECT_EQ(waited.compensated.data(), photos->compensated.data());
  EXPECT_EQ(waited.target.data(), photos->target.data());
}

}  // namespace
}  // namespace countershade::tools
