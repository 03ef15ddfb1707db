#include "simdata/room/mesh.h"

#include <assimp/scene.h>
#include <algorithm>
#include <array>
#include <assimp/Importer.hpp>
#include <cmath>
#include <fstream>
#include <map>
#include <sstream>
#include <string>
#include <tuple>

namespace countershade::simdata {

namespace {

constexpr int kMostTriangles = 20000;
constexpr std::uintmax_t kMostBytes = 64u << 20;  // ten times what that many triangles take
constexpr int kFewestTriangles = 1500;            // smaller meshes are refined

using Faces = std::vector<Eigen::Vector3i>;
using Corners = std::vector<Eigen::Vector3d>;

// One corner per place: files repeat them per face.
void weld(Corners& corners, Faces& faces, double tolerance) {
  std::map<std::tuple<long, long, long>, int> seen;
  std::vector<int> to(corners.size());
  Corners kept;
  for (std::size_t i = 0; i < corners.size(); ++i) {
    const Eigen::Vector3d x = corners[i] / tolerance;
    const auto [at, is_new] =
        seen.emplace(std::tuple(std::lround(x.x()), std::lround(x.y()), std::lround(x.z())), kept.size());
    if (is_new) kept.push_back(corners[i]);
    to[i] = at->second;
  }
  for (Eigen::Vector3i& f : faces)
    for (int k = 0; k < 3; ++k) f[k] = to[f[k]];
  corners = std::move(kept);
}

Eigen::Vector3d doubled_area(const Corners& corners, const Eigen::Vector3i& f) {
  return (corners[f[1]] - corners[f[0]]).cross(corners[f[2]] - corners[f[0]]);
}

// Every triangle into four, until edges are short against the whole.
void refine(Corners& corners, Faces& faces) {
  while (static_cast<int>(faces.size()) < kFewestTriangles) {
    std::map<std::pair<int, int>, int> middles;
    const auto middle = [&](int a, int b) {
      const auto [at, is_new] = middles.emplace(std::minmax(a, b), corners.size());
      if (is_new) corners.push_back((corners[a] + corners[b]) / 2);
      return at->second;
    };
    Faces finer;
    for (const Eigen::Vector3i& f : faces) {
      const int ab = middle(f[0], f[1]), bc = middle(f[1], f[2]), ca = middle(f[2], f[0]);
      for (const Eigen::Vector3i& part : {Eigen::Vector3i(f[0], ab, ca), Eigen::Vector3i(ab, f[1], bc),
                                          Eigen::Vector3i(ca, bc, f[2]), Eigen::Vector3i(ab, bc, ca)})
        finer.push_back(part);
    }
    faces = std::move(finer);
  }
}

// An edge that two faces run along in the same direction: they look to opposite sides.
int flipped_edges(const Faces& faces) {
  std::map<std::pair<int, int>, int> runs;
  int flipped = 0;
  for (const Eigen::Vector3i& f : faces)
    for (int k = 0; k < 3; ++k) flipped += ++runs[{f[k], f[(k + 1) % 3]}] == 2;
  return flipped;
}

// Corners once per direction: faces about a corner are joined while they differ by less than 30 degrees.
MeshShape::Triangles split_at_edges(const Corners& corners, const Faces& faces) {
  constexpr double kSharp = 0.866;
  std::vector<std::vector<std::pair<int, int>>> about(corners.size());  // (face, which of its corners)
  MeshShape::Triangles out;
  out.faces = faces;
  std::vector<Eigen::Vector3d> normals;
  for (int f = 0; f < static_cast<int>(faces.size()); ++f) {
    normals.push_back(doubled_area(corners, faces[f]));
    for (int k = 0; k < 3; ++k) about[faces[f][k]].emplace_back(f, k);
  }
  for (std::size_t i = 0; i < corners.size(); ++i) {
    std::vector<char> taken(about[i].size(), 0);
    for (std::size_t a = 0; a < about[i].size(); ++a) {
      if (taken[a]) continue;
      Eigen::Vector3d sum = Eigen::Vector3d::Zero();
      const Eigen::Vector3d first = normals[about[i][a].first].normalized();
      for (std::size_t b = a; b < about[i].size(); ++b)
        if (!taken[b] && normals[about[i][b].first].normalized().dot(first) > kSharp) {
          taken[b] = 1;
          sum += normals[about[i][b].first];
          out.faces[about[i][b].first][about[i][b].second] = static_cast<int>(out.corners.size());
        }
      out.corners.push_back(corners[i]);
      out.normals.push_back(sum.normalized());
    }
  }
  return out;
}

// A face with its box, for the search for faces that cross.
struct Face {
  std::array<Eigen::Vector3d, 3> at;
  Eigen::AlignedBox3d box;
};

std::vector<Face> sorted_faces(const Corners& corners, const Faces& faces) {
  std::vector<Face> out;
  for (const Eigen::Vector3i& f : faces) {
    Face face{{corners[f[0]], corners[f[1]], corners[f[2]]}, {}};
    for (const Eigen::Vector3d& x : face.at) face.box.extend(x);
    out.push_back(std::move(face));
  }
  std::sort(out.begin(), out.end(), [](const Face& a, const Face& b) { return a.box.min().x() < b.box.min().x(); });
  return out;
}

constexpr double kRim = 2e-3;  // of a line, and of a face: they may touch there

// The least of the weights of a face's corners at x, a point of its plane: positive inside.
double least_weight(const Face& face, const Eigen::Vector3d& x) {
  const auto& [a, b, c] = face.at;
  const Eigen::Vector3d normal = (b - a).cross(c - a);
  const double whole = normal.squaredNorm();
  const double at_b = (x - a).cross(c - a).dot(normal) / whole, at_c = (b - a).cross(x - a).dot(normal) / whole;
  return std::min({1 - at_b - at_c, at_b, at_c});
}

// Whether two faces of one plane overlap: there is no line along a side of either that keeps them apart.
bool overlap(const Face& a, const Face& b, const Eigen::Vector3d& normal) {
  for (const Face* face : {&a, &b})
    for (int k = 0; k < 3; ++k) {
      const Eigen::Vector3d across = normal.cross(face->at[(k + 1) % 3] - face->at[k]);
      std::array<double, 2> low{HUGE_VAL, HUGE_VAL}, high{-HUGE_VAL, -HUGE_VAL};
      for (int i = 0; i < 3; ++i)
        for (int f = 0; f < 2; ++f) {
          const double at = across.dot((f == 0 ? a : b).at[i]);
          low[f] = std::min(low[f], at), high[f] = std::max(high[f], at);
        }
      const double slack = kRim * std::min(high[0] - low[0], high[1] - low[1]);
      if (!(std::min(high[0], high[1]) - std::max(low[0], low[1]) > slack)) return false;
    }
  return true;
}

// Where lines of `a`, its sides and three others, pass through `b`; or the middle of `a` where both lie in one plane
// and overlap.
std::optional<Eigen::Vector3d> passes_through(const Face& a, const Face& b) {
  const Eigen::Vector3d normal = (b.at[1] - b.at[0]).cross(b.at[2] - b.at[0]).normalized();
  const auto height = [&](const Eigen::Vector3d& x) { return normal.dot(x - b.at[0]); };
  double farthest = 0;
  for (const Eigen::Vector3d& x : a.at) farthest = std::max(farthest, std::abs(height(x)));
  if (farthest < 1e-6 * a.box.sizes().norm()) {
    if (overlap(a, b, normal)) return (a.at[0] + a.at[1] + a.at[2]) / 3;
    return std::nullopt;
  }
  for (int k = 0; k < 3; ++k) {
    const Eigen::Vector3d &from = a.at[k], &next = a.at[(k + 1) % 3], &last = a.at[(k + 2) % 3];
    // Odd places: faces like to meet in the middle of each other.
    for (const Eigen::Vector3d& to : {next, Eigen::Vector3d(0.6181 * next + 0.3819 * last)}) {
      const double start = height(from), end = height(to), t = start / (start - end);
      if (start * end < 0 && t > kRim && t < 1 - kRim && least_weight(b, from + t * (to - from)) > kRim)
        return from + t * (to - from);
    }
  }
  return std::nullopt;
}

// Numbers of corners and faces that a PLY header announces, so that nobody reserves memory for 10^12 of them.
Result<void> check_header(const std::filesystem::path& path) {
  std::ifstream in(path, std::ios::binary);
  std::string line;
  for (int i = 0; i < 200 && std::getline(in, line) && line.rfind("end_header", 0) != 0; ++i) {
    std::istringstream words(line);
    std::string element, what;
    double count = 0;
    if (!(words >> element >> what >> count) || element != "element") continue;
    const double most = what == "face" ? kMostTriangles : 3.0 * kMostTriangles;
    if (!(count >= 0 && count <= most))
      return error(ErrorCode::kBadValue,
                   "mesh '{}' announces {} elements '{}'; at most {} can be simulated: simplify it", path.string(),
                   count, what, most);
  }
  return {};
}

std::string extension_of(const std::filesystem::path& path) {
  std::string extension = path.extension().string();
  for (char& c : extension) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return extension;
}

}  // namespace

std::optional<Eigen::Vector3d> crossing(const Corners& a_corners, const Faces& a_faces, const Corners& b_corners,
                                        const Faces& b_faces) {
  const std::vector<Face> a = sorted_faces(a_corners, a_faces), b = sorted_faces(b_corners, b_faces);
  double widest = 0;
  for (const Face& face : b) widest = std::max(widest, face.box.sizes().x());
  const bool same = &a_faces == &b_faces;
  for (std::size_t i = 0; i < a.size(); ++i) {
    const auto first = std::lower_bound(b.begin(), b.end(), a[i].box.min().x() - widest,
                                        [](const Face& face, double x) { return face.box.min().x() < x; });
    for (auto other = first; other != b.end() && other->box.min().x() <= a[i].box.max().x(); ++other) {
      if ((same && other - b.begin() <= static_cast<std::ptrdiff_t>(i)) || !a[i].box.intersects(other->box)) continue;
      if (auto at = passes_through(a[i], *other)) return at;
      if (auto at = passes_through(*other, a[i])) return at;
    }
  }
  return std::nullopt;
}

Result<MeshShape::Triangles> prepared_mesh(const Corners& given, const Faces& given_faces, const std::string& name) {
  Corners corners = given;
  Faces faces = given_faces;
  Eigen::AlignedBox3d box;
  for (const Eigen::Vector3d& x : corners) {
    if (!x.allFinite())
      return error(ErrorCode::kBadValue, "mesh '{}' has a corner that is not finite; repair it", name);
    box.extend(x);
  }
  if (faces.empty()) return error(ErrorCode::kBadValue, "mesh '{}' has no faces; export it with its triangles", name);
  if (static_cast<int>(faces.size()) > kMostTriangles)
    return error(ErrorCode::kBadValue, "mesh '{}' has {} triangles; at most {} can be simulated: simplify it", name,
                 faces.size(), kMostTriangles);
  const double size = box.sizes().norm();
  if (!(size > 1e-3 && size < 1e4))
    return error(ErrorCode::kBadValue,
                 "mesh '{}' is {} m across; 1 mm to 10 km are possible: set mesh_scale to its unit in metres", name,
                 size);
  weld(corners, faces, 1e-7 * size);
  std::erase_if(faces,
                [&](const Eigen::Vector3i& f) { return !(doubled_area(corners, f).norm() > 1e-12 * size * size); });
  if (faces.empty()) return error(ErrorCode::kBadValue, "mesh '{}' has no area", name);
  if (const int flipped = flipped_edges(faces); flipped > 0)
    return error(ErrorCode::kBadValue,
                 "mesh '{}': along {} edges the two faces look to opposite sides; make its normals consistent (all "
                 "faces anticlockwise as seen from the lit side)",
                 name, flipped);
  if (const auto at = crossing(corners, faces, corners, faces))
    return error(ErrorCode::kBadValue,
                 "mesh '{}': faces pass through each other or lie in each other at ({:.3f}, {:.3f}, {:.3f}); they may "
                 "touch at their edges only: cut them there, and remove what is hidden or there twice",
                 name, at->x(), at->y(), at->z());
  refine(corners, faces);
  return split_at_edges(corners, faces);
}

Result<MeshShape::Triangles> read_mesh(const std::filesystem::path& path, double scale, const Eigen::Vector3d& origin) {
  std::error_code code;
  const std::uintmax_t bytes = std::filesystem::file_size(path, code);
  if (code) return error(ErrorCode::kBadFile, "mesh '{}' cannot be read: {}", path.string(), code.message());
  if (bytes > kMostBytes)
    return error(ErrorCode::kBadValue, "mesh '{}' has {} MB; at most {} triangles can be simulated: simplify it",
                 path.string(), bytes >> 20, kMostTriangles);
  const std::string extension = extension_of(path);
  if (extension != ".obj" && extension != ".ply")
    return error(ErrorCode::kBadFile, "mesh '{}' is neither .obj nor .ply; export it as one of them", path.string());
  CS_TRY_VOID(check_header(path));
  Assimp::Importer importer;
  // As it stands in the file: its indices are checked before anything follows them.
  const aiScene* scene = importer.ReadFile(path.string(), 0);
  if (!scene || scene->mNumMeshes == 0)
    return error(ErrorCode::kBadFile, "mesh '{}' has no faces that can be read ({}); export it again", path.string(),
                 *importer.GetErrorString() ? importer.GetErrorString() : "no mesh in it");
  Corners corners;
  Faces faces;
  for (unsigned m = 0; m < scene->mNumMeshes; ++m) {
    const aiMesh& mesh = *scene->mMeshes[m];
    const int first = static_cast<int>(corners.size());
    for (unsigned i = 0; i < mesh.mNumVertices; ++i)
      corners.push_back(origin +
                        scale * Eigen::Vector3d(mesh.mVertices[i].x, mesh.mVertices[i].y, mesh.mVertices[i].z));
    for (unsigned i = 0; i < mesh.mNumFaces; ++i) {
      const aiFace& f = mesh.mFaces[i];
      for (unsigned k = 0; k < f.mNumIndices; ++k)
        if (f.mIndices[k] >= mesh.mNumVertices)
          return error(ErrorCode::kBadFile,
                       "mesh '{}': face {} names corner {}, but there are only {}; export it again", path.string(),
                       i + 1, static_cast<int>(f.mIndices[k]), mesh.mNumVertices);
      for (unsigned k = 2; k < f.mNumIndices; ++k)  // a convex polygon as a fan; points and lines are none
        faces.emplace_back(first + f.mIndices[0], first + f.mIndices[k - 1], first + f.mIndices[k]);
    }
  }
  return prepared_mesh(corners, faces, path.string());
}

}  // namespace countershade::simdata
