// Free surfaces from files.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "simdata/room/shape.h"

namespace countershade::simdata {

// Triangles of an OBJ or PLY file (read by Assimp), scaled, then moved by `origin`; larger faces are split into
// triangles, those into quarters until the light on them can be interpolated between corners. Corners are kept apart
// where faces meet at more than 30 degrees.
//
// Errors: kBadFile for a file that is no mesh or names corners that it does not have; kBadValue for a mesh without
// area, with more than 20,000 triangles, with neighbouring faces that look to opposite sides, or with faces that pass
// through each other or lie in each other.
Result<MeshShape::Triangles> read_mesh(const std::filesystem::path& path, double scale, const Eigen::Vector3d& origin);

// The same work on triangles that are there already.
Result<MeshShape::Triangles> prepared_mesh(const std::vector<Eigen::Vector3d>& corners,
                                           const std::vector<Eigen::Vector3i>& faces, const std::string& name);

// A place where a face of `a` passes through one of `b`, or lies in it, by more than .2 % of their sizes: faces may
// touch at their edges and corners, and an edge may stand on a face. Both may be the same mesh.
std::optional<Eigen::Vector3d> crossing(const std::vector<Eigen::Vector3d>& a_corners,
                                        const std::vector<Eigen::Vector3i>& a_faces,
                                        const std::vector<Eigen::Vector3d>& b_corners,
                                        const std::vector<Eigen::Vector3i>& b_faces);

}  // namespace countershade::simdata
