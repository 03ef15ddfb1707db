// Free surfaces from files.
#pragma once

#include <filesystem>

#include "simdata/room/shape.h"

namespace countershade::simdata {

// Triangles of an OBJ or PLY file (read by Assimp), scaled, then moved by `origin`; larger faces are split into
// triangles, those into quarters until the light on them can be interpolated between corners. Corners are kept apart
// where faces meet at more than 30 degrees.
//
// Errors: kBadFile for a file that is no mesh or names corners that it does not have; kBadValue for a mesh without
// area, with more than 20,000 triangles, or with neighbouring faces that look to opposite sides.
Result<MeshShape::Triangles> read_mesh(const std::filesystem::path& path, double scale, const Eigen::Vector3d& origin);

// The same work on triangles that are there already.
Result<MeshShape::Triangles> prepared_mesh(const std::vector<Eigen::Vector3d>& corners,
                                           const std::vector<Eigen::Vector3i>& faces, const std::string& name);

}  // namespace countershade::simdata
