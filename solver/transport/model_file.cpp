// A model's folder: model.json and arrays that Python reads.
#include <nlohmann/json.hpp>

#include "calib/file/file.h"
#include "calib/image/image_file.h"
#include "solver/transport/model.h"

namespace countershade::solver {

namespace {

namespace fs = std::filesystem;
using nlohmann::json;

json json_of(const Eigen::Vector3d& v) { return json::array({v.x(), v.y(), v.z()}); }
Eigen::Vector3d vector_of(const json& j) {
  return {j.at(0).get<double>(), j.at(1).get<double>(), j.at(2).get<double>()};
}

template <class Matrix>
Array array_of(const Matrix& m) {
  Array array{{static_cast<int>(m.rows()), static_cast<int>(m.cols())}, {}};
  array.data.reserve(m.size());
  for (int i = 0; i < m.rows(); ++i)
    for (int j = 0; j < m.cols(); ++j) array.data.push_back(m(i, j));
  return array;
}

template <class Matrix>
Result<void> read_matrix(const fs::path& path, int rows, int columns, Matrix& m) {
  CS_TRY(const Array array, read_npy(path));
  if (array.shape != std::vector<int>{rows, columns})
    return error(ErrorCode::kBadFile, "'{}' should hold {} x {} numbers; calibrate again", path.string(), rows, columns);
  m.resize(rows, columns);
  for (int i = 0; i < rows; ++i)
    for (int j = 0; j < columns; ++j) m(i, j) = static_cast<float>(array.data[static_cast<std::size_t>(i) * columns + j]);
  return {};
}

std::string gain_name(const std::string& projector, std::size_t surface) { return fmt::format("gain_{}_{}.exr", projector, surface); }

Result<void> write_gain(const fs::path& path, const Image& gain) {
  std::vector<Image> planes(3, Image(gain.width(), gain.height(), 1));
  for (std::size_t i = 0; i < gain.pixels(); ++i)
    for (int c = 0; c < 3; ++c) planes[c].data()[i] = gain.data()[3 * i + c];
  return write_exr(path, {{"R", &planes[0]}, {"G", &planes[1]}, {"B", &planes[2]}});
}

Result<Image> read_gain(const fs::path& path) {
  CS_TRY(const std::vector<Image> planes, read_exr(path, {"R", "G", "B"}));
  Image gain(planes[0].width(), planes[0].height(), 3);
  for (std::size_t i = 0; i < gain.pixels(); ++i)
    for (int c = 0; c < 3; ++c) gain.data()[3 * i + c] = planes[c].data()[i];
  return gain;
}

json json_of(const ProjectorModel& p) {
  const Lens& lens = p.device.lens;
  const Eigen::Matrix3d& R = p.device.device_from_world.rotation;
  return {{"id", p.id}, {"response", p.response.curve.text()}, {"black_level", p.response.black_level}, {"lens_model", lens.model()},
          {"intrinsics", lens.intrinsics()}, {"size", json::array({lens.width(), lens.height()})},
          {"rotation", json::array({json_of(R.row(0)), json_of(R.row(1)), json_of(R.row(2))})}, {"translation", json_of(p.device.device_from_world.translation)}};
}

Result<ProjectorModel> projector_of(const json& j) {
  ProjectorModel p;
  p.id = j.at("id");
  CS_TRY(p.response.curve, Response::parse(j.at("response")));
  p.response.black_level = j.at("black_level");
  CS_TRY(p.device.lens, Lens::make(j.at("lens_model"), j.at("intrinsics").get<std::vector<double>>(), j.at("size").at(0), j.at("size").at(1)));
  for (int r = 0; r < 3; ++r) p.device.device_from_world.rotation.row(r) = vector_of(j.at("rotation").at(r));
  p.device.device_from_world.translation = vector_of(j.at("translation"));
  return p;
}

Result<void> fill_screen(const json& j, Model& model) {
  std::vector<std::pair<int, int>> grid;
  for (const json& s : j.at("surfaces")) {
    model.planes.push_back(std::make_shared<PlaneSurface>(vector_of(s.at("origin")), vector_of(s.at("along_u")), vector_of(s.at("along_v"))));
    model.screen.surfaces.push_back(model.planes.back());
    grid.emplace_back(s.at("patches").at(0), s.at("patches").at(1));
  }
  for (const json& c : j.at("creases")) model.screen.creases.push_back({c.at("surface_a"), c.at("surface_b"), c.at("u_a"), c.at("u_b"), c.at("angle_rad")});
  model.patches = Patches(grid);
  return {};
}

}  // namespace

Result<void> write_model(const fs::path& folder, const Model& model) {
  json surfaces = json::array(), creases = json::array(), projectors = json::array();
  for (int s = 0; s < model.screen.size(); ++s)
    surfaces.push_back({{"origin", json_of(model.planes[s]->origin())}, {"along_u", json_of(model.planes[s]->along_u())}, {"along_v", json_of(model.planes[s]->along_v())}, {"patches", json::array({model.patches.nu(s), model.patches.nv(s)})}});
  for (const Crease& c : model.screen.creases) creases.push_back({{"surface_a", c.surface_a}, {"surface_b", c.surface_b}, {"u_a", c.u_a}, {"u_b", c.u_b}, {"angle_rad", c.angle}});
  for (const ProjectorModel& p : model.projectors) {
    projectors.push_back(json_of(p));
    for (std::size_t s = 0; s < p.gain.size(); ++s) CS_TRY_VOID(write_gain(folder / gain_name(p.id, s), p.gain[s]));
  }
  const json document = {{"format_version", 1}, {"surfaces", surfaces}, {"creases", creases}, {"projectors", projectors}, {"receiver_factor", model.receiver_factor}, {"gain_factor", model.gain_factor}, {"white", model.white}};
  CS_TRY_VOID(write_atomically(folder / "model.json", document.dump(1) + "\n"));
  CS_TRY_VOID(write_npy(folder / "F.npy", array_of(model.F), ArrayType::kFloat32));
  CS_TRY_VOID(write_npy(folder / "G.npy", array_of(model.G), ArrayType::kFloat32));
  CS_TRY_VOID(write_npy(folder / "k.npy", array_of(model.k), ArrayType::kFloat32));
  return write_npy(folder / "e.npy", array_of(model.e), ArrayType::kFloat32);
}

Result<Model> read_model(const fs::path& folder) {
  CS_TRY(const std::string text, read_text(folder / "model.json"));
  Model model;
  try {
    const json j = json::parse(text);
    if (j.at("format_version").get<int>() > 1)
      return error(ErrorCode::kBadFile, "'{}' has format_version {}, this program reads up to 1; use a newer countershade", (folder / "model.json").string(), j.at("format_version").get<int>());
    CS_TRY_VOID(fill_screen(j, model));
    model.receiver_factor = j.at("receiver_factor");
    model.gain_factor = j.at("gain_factor");
    model.white = j.at("white");
    for (const json& p : j.at("projectors")) {
      CS_TRY(ProjectorModel projector, projector_of(p));
      for (int s = 0; s < model.screen.size(); ++s) {
        CS_TRY(Image gain, read_gain(folder / gain_name(projector.id, s)));
        projector.gain.push_back(std::move(gain));
      }
      projector.map = pixel_map(projector.device, model.screen);
      model.projectors.push_back(std::move(projector));
    }
  } catch (const json::exception& e) {
    return error(ErrorCode::kBadFile, "'{}' is not a model: {}; calibrate again", (folder / "model.json").string(), e.what());
  }
  const int P = model.patches.size();
  CS_TRY_VOID(read_matrix(folder / "F.npy", P, P, model.F));
  CS_TRY_VOID(read_matrix(folder / "G.npy", model.receivers(), P, model.G));
  CS_TRY_VOID(read_matrix(folder / "k.npy", P, 3, model.k));
  CS_TRY_VOID(read_matrix(folder / "e.npy", P, 3, model.e));
  return model;
}

}  // namespace countershade::solver
