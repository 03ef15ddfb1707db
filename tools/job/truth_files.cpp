#include "tools/job/truth_files.h"

#include <nlohmann/json.hpp>

#include "calib/file/file.h"
#include "calib/geometry/lens.h"
#include "calib/image/image_file.h"
#include "capture/pattern/pattern.h"
#include "simdata/render/patch_truth.h"
#include "simdata/room/rooms.h"

namespace countershade::tools {

namespace {

namespace fs = std::filesystem;

Image channel(const Image& image, int c) {
  Image one(image.width(), image.height(), 1);
  for (std::size_t i = 0; i < one.data().size(); ++i)
    one.data()[i] = image.data()[i * image.channels() + std::min(c, image.channels() - 1)];
  return one;
}

Result<void> write_geometry(const simdata::Simulator& simulator, int camera, const fs::path& folder) {
  const std::string& id = simulator.rig().cameras[camera].id;
  const simdata::TrueGeometry g = simulator.geometry(camera);
  std::vector<Image> split;
  for (int c = 0; c < 3; ++c) split.push_back(channel(g.normal, c));
  for (int c = 0; c < 3; ++c) split.push_back(channel(g.albedo, c));
  CS_TRY_VOID(write_exr(folder / (id + ".exr"), {{"depth", &g.depth},
                                                 {"nx", &split[0]},
                                                 {"ny", &split[1]},
                                                 {"nz", &split[2]},
                                                 {"ar", &split[3]},
                                                 {"ag", &split[4]},
                                                 {"ab", &split[5]},
                                                 {"surface", &g.surface},
                                                 {"u", &g.u},
                                                 {"v", &g.v}}));
  for (std::size_t q = 0; q < g.projector_x.size(); ++q)
    CS_TRY_VOID(write_exr(folder / (id + "-" + simulator.rig().projectors[q].id + ".exr"),
                          {{"x", &g.projector_x[q]}, {"y", &g.projector_y[q]}}));
  return {};
}

template <class Matrix>
Array array_of(const Matrix& m) {
  Array a{{static_cast<int>(m.rows()), static_cast<int>(m.cols())}, {}};
  for (int i = 0; i < m.rows(); ++i)
    for (int j = 0; j < m.cols(); ++j) a.data.push_back(m(i, j));
  return a;
}

Result<void> write_patches(const simdata::Simulator& simulator, const fs::path& folder, const TruthOptions& options,
                           Progress& progress) {
  const simdata::PatchTruth truth =
      simulator.patch_truth(options.patches[0], options.patches[1], options.rays, progress);
  std::error_code ignored;
  fs::create_directories(folder, ignored);
  CS_TRY_VOID(write_npy(folder / "form_factor.npy", array_of(truth.form_factor), ArrayType::kFloat32));
  CS_TRY_VOID(write_npy(folder / "form_factor_sigma.npy", array_of(truth.form_factor_sigma), ArrayType::kFloat32));
  CS_TRY_VOID(write_npy(folder / "area.npy", {{static_cast<int>(truth.area.size())},
                                              {truth.area.data(), truth.area.data() + truth.area.size()}}));
  CS_TRY_VOID(write_npy(folder / "albedo.npy", array_of(truth.albedo)));
  CS_TRY_VOID(write_npy(folder / "irradiance.npy", array_of(truth.irradiance)));
  CS_TRY_VOID(write_npy(folder / "irradiance_sigma.npy", array_of(truth.irradiance_sigma)));
  Array transport{{3, static_cast<int>(truth.area.size()), static_cast<int>(truth.area.size())}, {}};
  for (const Eigen::MatrixXf& t : truth.transport) {
    const Array one = array_of(t);
    transport.data.insert(transport.data.end(), one.data.begin(), one.data.end());
  }
  return write_npy(folder / "transport.npy", transport, ArrayType::kFloat32);
}

Result<void> write_devices(const simdata::Simulator& simulator, const fs::path& folder, const TruthOptions& options) {
  const Rig& rig = simulator.rig();
  nlohmann::json j = {{"format_version", 1},
                      {"patches", {{"nu", options.patches[0]}, {"nv", options.patches[1]}, {"rays", options.rays}}},
                      {"surfaces", nlohmann::json::array()},
                      {"projectors", nlohmann::json::array()}};
  for (const SimulatedSurface& s : simulator.simulation().surfaces) j["surfaces"].push_back(s.id);
  for (std::size_t i = 0; i < rig.cameras.size(); ++i) {
    const std::string& id = rig.cameras[i].id;
    CS_TRY(const Device device, simdata::true_camera(simulator.simulation(), id));
    CS_TRY_VOID(write_cameramodel(folder / (id + ".cameramodel"), device));
    j["cameras"][id] = {{"full_scale_per_radiosity", simulator.scale(static_cast<int>(i))}};
  }
  for (const ProjectorSpec& spec : rig.projectors) {
    CS_TRY(const Device device, simdata::true_projector(simulator.simulation(), rig, spec.id));
    CS_TRY_VOID(write_cameramodel(folder / (spec.id + ".cameramodel"), device));
    j["projectors"].push_back(spec.id);
  }
  CS_TRY_VOID(write_atomically(folder / "simulation.toml", simulation_text(simulator.simulation())));
  return write_atomically(folder / "devices.json", j.dump(1) + "\n");
}

Result<void> write_light(const simdata::Simulator& simulator, const Sequence& sequence, const fs::path& folder,
                         Progress& progress) {
  for (std::size_t f = 0; f < sequence.frames.size(); ++f) {
    progress.step("true light", static_cast<double>(f), static_cast<double>(sequence.frames.size()));
    std::vector<Picture> pictures;
    for (const ProjectorSpec& spec : simulator.rig().projectors) {
      CS_TRY(pictures.emplace_back(),
             capture::render_role(sequence.frames[f].role, spec.id, spec.resolution[0], spec.resolution[1]));
    }
    for (std::size_t c = 0; c < simulator.rig().cameras.size(); ++c) {
      const fs::path own = folder / simulator.rig().cameras[c].id;
      std::error_code ignored;
      fs::create_directories(own, ignored);
      const simdata::TrueLight light = simulator.light(static_cast<int>(c), pictures);
      std::vector<Image> split;
      for (const Image* image : {&light.direct, &light.indirect})
        for (int k = 0; k < 3; ++k) split.push_back(channel(*image, k));
      CS_TRY_VOID(write_exr(own / fmt::format("{:04}.exr", sequence.frames[f].index), {{"dr", &split[0]},
                                                                                       {"dg", &split[1]},
                                                                                       {"db", &split[2]},
                                                                                       {"ir", &split[3]},
                                                                                       {"ig", &split[4]},
                                                                                       {"ib", &split[5]}}));
    }
  }
  progress.step("true light", 1, 1);
  return {};
}

}  // namespace

Result<void> check_truth(const Simulation& simulation, const TruthOptions& options) {
  const auto patches = static_cast<std::size_t>(options.patches[0]) * options.patches[1] * simulation.surfaces.size();
  if (patches > 4096)
    return error(ErrorCode::kBadValue,
                 "the truth of {} patches per surface would be a matrix of {} x {}; 4096 patches are the most: take "
                 "fewer with --truth-patches",
                 options.patches[0] * options.patches[1], patches, patches);
  return {};
}

Result<void> write_truth(const simdata::Simulator& simulator, const Sequence& sequence, const fs::path& folder,
                         const TruthOptions& options, Progress& progress) {
  CS_TRY_VOID(check_truth(simulator.simulation(), options));
  return create_folder_atomically(folder, [&](const fs::path& draft) -> Result<void> {
    for (std::size_t c = 0; c < simulator.rig().cameras.size(); ++c)
      CS_TRY_VOID(write_geometry(simulator, static_cast<int>(c), draft));
    CS_TRY_VOID(write_devices(simulator, draft, options));
    CS_TRY_VOID(write_patches(simulator, draft / "patches", options, progress));
    if (options.light) CS_TRY_VOID(write_light(simulator, sequence, draft / "light", progress));
    return {};
  });
}

}  // namespace countershade::tools
