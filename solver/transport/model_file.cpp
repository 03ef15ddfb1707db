// A model's folder: model.json and arrays that Python reads.
#include <nlohmann/json.hpp>

#include <cmath>
#include <limits>

#include "calib/file/file.h"
#include "calib/image/image_file.h"
#include "solver/transport/model.h"

namespace countershade::solver {

namespace {

namespace fs = std::filesystem;
using nlohmann::json;

constexpr int kFormatVersion = 1;

json json_of(const Eigen::Vector3d& v) {
  return json::array({v.x(), v.y(), v.z()});
}

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
    return error(ErrorCode::kBadFile, "'{}' has shape ({}), must be ({}, {}) as model.json says; calibrate again",
                 path.string(), fmt::join(array.shape, ", "), rows, columns);
  m.resize(rows, columns);
  for (int i = 0; i < rows; ++i)
    for (int j = 0; j < columns; ++j) {
      const double value = array.data[static_cast<std::size_t>(i) * columns + j];
      if (!std::isfinite(value))
        return error(ErrorCode::kBadFile, "'{}' holds {} at ({}, {}), must be finite; calibrate again", path.string(),
                     value, i, j);
      m(i, j) = static_cast<float>(value);
    }
  return {};
}

std::string gain_name(const std::string& projector, int surface) {
  return fmt::format("gain_{}_{}.exr", projector, surface);
}

Result<void> write_gain(const fs::path& path, const Image& gain) {
  std::vector<Image> planes(3, Image(gain.width(), gain.height(), 1));
  for (std::size_t i = 0; i < gain.pixels(); ++i)
    for (int c = 0; c < 3; ++c) planes[c].data()[i] = gain.data()[3 * i + c];
  return write_exr(path, {{"R", &planes[0]}, {"G", &planes[1]}, {"B", &planes[2]}});
}

Result<Image> read_gain(const fs::path& path, int width, int height) {
  CS_TRY(const std::vector<Image> planes, read_exr(path, {"R", "G", "B"}));
  if (!planes[0].same_size(width, height))
    return error(ErrorCode::kBadFile, "'{}' has {} x {} samples, must have {} x {} as model.json says; calibrate again",
                 path.string(), planes[0].width(), planes[0].height(), width, height);
  Image gain(width, height, 3);
  for (std::size_t i = 0; i < gain.pixels(); ++i)
    for (int c = 0; c < 3; ++c) {
      const float value = planes[c].data()[i];
      if (!std::isfinite(value))
        return error(ErrorCode::kBadFile, "'{}' holds {} at sample {}, must be finite; calibrate again", path.string(),
                     value, i);
      gain.data()[3 * i + c] = value;
    }
  return gain;
}

json json_of(const ProjectorModel& p) {
  const Lens& lens = p.device.lens;
  const Pose& pose = p.device.device_from_world;
  json rotation = json::array();
  for (int row = 0; row < 3; ++row) rotation.push_back(json_of(pose.rotation.row(row)));
  return {{"id", p.id},
          {"response", p.response.curve.text()},
          {"black_level", p.response.black_level},
          {"lens_model", lens.model()},
          {"intrinsics", lens.intrinsics()},
          {"size", json::array({lens.width(), lens.height()})},
          {"rotation", rotation},
          {"translation", json_of(pose.translation)}};
}

json json_of(const Model& model) {
  json surfaces = json::array(), creases = json::array(), projectors = json::array();
  for (int s = 0; s < model.screen.size(); ++s)
    surfaces.push_back({{"origin", json_of(model.planes[s]->origin())},
                        {"along_u", json_of(model.planes[s]->along_u())},
                        {"along_v", json_of(model.planes[s]->along_v())},
                        {"patches", json::array({model.patches.nu(s), model.patches.nv(s)})}});
  for (const Crease& c : model.screen.creases)
    creases.push_back({{"surface_a", c.surface_a},
                       {"surface_b", c.surface_b},
                       {"u_a", c.u_a},
                       {"u_b", c.u_b},
                       {"angle_rad", c.angle}});
  for (const ProjectorModel& p : model.projectors) projectors.push_back(json_of(p));
  return {{"format_version", kFormatVersion},
          {"surfaces", surfaces},
          {"creases", creases},
          {"projectors", projectors},
          {"receiver_factor", model.receiver_factor},
          {"gain_factor", model.gain_factor},
          {"white", model.white}};
}

// Reads model.json; `where` is its name for messages. nlohmann's exceptions are the caller's to catch.
class Reader {
 public:
  explicit Reader(std::string where) : where_(std::move(where)) {}

  Result<Model> model(const json& j) const {
    Model model;
    const int version = j.at("format_version");
    if (version < 1 || version > kFormatVersion)
      return error(ErrorCode::kBadFile, "'{}' has format_version {}, this program reads 1 to {}; use {}", where_,
                   version, kFormatVersion, version < 1 ? "an undamaged calibration" : "a newer countershade");
    model.receiver_factor = j.at("receiver_factor");
    model.gain_factor = j.at("gain_factor");
    model.white = j.at("white");
    CS_TRY_VOID(check("receiver_factor", model.receiver_factor, 1, 16));
    CS_TRY_VOID(check("gain_factor", model.gain_factor, 1, 64));
    CS_TRY_VOID(check("white", model.white, std::numeric_limits<double>::min(), 1e6));
    CS_TRY_VOID(surfaces(j.at("surfaces"), model));
    CS_TRY_VOID(creases(j.at("creases"), model.screen));
    for (const json& p : j.at("projectors")) {
      CS_TRY(ProjectorModel projector, this->projector(p));
      model.projectors.push_back(std::move(projector));
    }
    return model;
  }

 private:
  // NaN fails too.
  Result<void> check(std::string_view name, double value, double low, double high) const {
    if (value >= low && value <= high) return {};
    return error(ErrorCode::kBadFile, "'{}': {} is {}, must be in [{}, {}]; calibrate again", where_, name, value, low,
                 high);
  }

  Result<void> surfaces(const json& list, Model& model) const {
    CS_TRY_VOID(check("the number of surfaces", list.size(), 1, kMaxSurfaces));
    std::vector<std::pair<int, int>> grid;
    for (const json& s : list) {
      const Eigen::Vector3d u = vector_of(s.at("along_u")), v = vector_of(s.at("along_v"));
      CS_TRY_VOID(check("the area of a surface", u.cross(v).norm(), std::numeric_limits<double>::min(), 1e12));
      model.planes.push_back(std::make_shared<PlaneSurface>(vector_of(s.at("origin")), u, v));
      model.screen.surfaces.push_back(model.planes.back());
      grid.emplace_back(s.at("patches").at(0), s.at("patches").at(1));
      CS_TRY_VOID(check("patches[0] of a surface", grid.back().first, 1, 4096));
      CS_TRY_VOID(check("patches[1] of a surface", grid.back().second, 1, 4096));
    }
    double receivers = 0;
    for (const auto& [nu, nv] : grid) receivers += 1.0 * nu * nv * model.receiver_factor * model.receiver_factor;
    CS_TRY_VOID(check("the number of receivers", receivers, 1, 1e8));
    model.patches = Patches(grid);
    return {};
  }

  Result<void> creases(const json& list, Screen& screen) const {
    for (const json& c : list) {
      const Crease crease{c.at("surface_a"), c.at("surface_b"), c.at("u_a"), c.at("u_b"), c.at("angle_rad")};
      CS_TRY_VOID(check("surface_a of a crease", crease.surface_a, 0, screen.size() - 1));
      CS_TRY_VOID(check("surface_b of a crease", crease.surface_b, 0, screen.size() - 1));
      screen.creases.push_back(crease);
    }
    return {};
  }

  Result<ProjectorModel> projector(const json& j) const {
    ProjectorModel p;
    p.id = j.at("id");
    const auto named = [&](const Error& e) {
      return error(ErrorCode::kBadFile, "'{}', projector '{}': {}", where_, p.id, e.message);
    };
    auto curve = Response::parse(j.at("response"));
    if (!curve) return named(curve.error());
    p.response.curve = *curve;
    p.response.black_level = j.at("black_level");
    CS_TRY_VOID(check("black_level of a projector", p.response.black_level, 0, 0.999));
    auto lens = Lens::make(j.at("lens_model"), j.at("intrinsics").get<std::vector<double>>(), j.at("size").at(0),
                           j.at("size").at(1));
    if (!lens) return named(lens.error());
    p.device.lens = *lens;
    Pose& pose = p.device.device_from_world;
    for (int row = 0; row < 3; ++row) pose.rotation.row(row) = vector_of(j.at("rotation").at(row));
    pose.translation = vector_of(j.at("translation"));
    const double skew = (pose.rotation * pose.rotation.transpose() - Eigen::Matrix3d::Identity()).norm();
    CS_TRY_VOID(check("the rotation's distance from a rotation", skew, 0, 1e-6));
    return p;
  }

  std::string where_;
};

// F, G, k, e, gains, and what follows from them.
Result<void> read_arrays(const fs::path& folder, Model& model) {
  const int P = model.patches.size();
  CS_TRY_VOID(read_matrix(folder / "F.npy", P, P, model.F));
  CS_TRY_VOID(read_matrix(folder / "G.npy", model.receivers(), P, model.G));
  CS_TRY_VOID(read_matrix(folder / "k.npy", P, 3, model.k));
  CS_TRY_VOID(read_matrix(folder / "e.npy", P, 3, model.e));
  for (ProjectorModel& p : model.projectors) {
    for (int s = 0; s < model.screen.size(); ++s) {
      CS_TRY(Image gain, read_gain(folder / gain_name(p.id, s), model.patches.nu(s) * model.gain_factor,
                                   model.patches.nv(s) * model.gain_factor));
      p.gain.push_back(std::move(gain));
    }
    p.map = pixel_map(p.device, model.screen);
  }
  return {};
}

void check_complete(const Model& model) {
  const int P = model.patches.size(), surfaces = model.screen.size();
  CS_CHECK(static_cast<int>(model.planes.size()) == surfaces && model.patches.surfaces() == surfaces,
           "a model's planes, patches and screen must have the same surfaces");
  CS_CHECK(model.F.rows() == P && model.F.cols() == P && model.G.rows() == model.receivers() && model.G.cols() == P,
           "a model's F must be (P, P) and G (R, P)");
  CS_CHECK(model.k.rows() == P && model.e.rows() == P, "a model's k and e must be (P, 3)");
  for (const ProjectorModel& p : model.projectors)
    CS_CHECK(static_cast<int>(p.gain.size()) == surfaces, "a projector's gain must have one image per surface");
}

}  // namespace

Result<void> write_model(const fs::path& folder, const Model& model) {
  check_complete(model);
  for (const ProjectorModel& p : model.projectors)
    for (int s = 0; s < model.screen.size(); ++s) CS_TRY_VOID(write_gain(folder / gain_name(p.id, s), p.gain[s]));
  CS_TRY_VOID(write_npy(folder / "F.npy", array_of(model.F), ArrayType::kFloat32));
  CS_TRY_VOID(write_npy(folder / "G.npy", array_of(model.G), ArrayType::kFloat32));
  CS_TRY_VOID(write_npy(folder / "k.npy", array_of(model.k), ArrayType::kFloat32));
  CS_TRY_VOID(write_npy(folder / "e.npy", array_of(model.e), ArrayType::kFloat32));
  return write_atomically(folder / "model.json", json_of(model).dump(1) + "\n");
}

Result<Model> read_model(const fs::path& folder) {
  const fs::path path = folder / "model.json";
  CS_TRY(const std::string text, read_text(path));
  try {
    CS_TRY(Model model, Reader(path.string()).model(json::parse(text)));
    CS_TRY_VOID(read_arrays(folder, model));
    return model;
  } catch (const json::exception& e) {
    return error(ErrorCode::kBadFile, "'{}' is not a model: {}; calibrate again", path.string(), e.what());
  }
}

}  // namespace countershade::solver
