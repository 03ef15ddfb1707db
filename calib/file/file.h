// Files that are whole or not there, arrays that Python reads, and the record of where a result came from.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "calib/base/result.h"

namespace countershade {

Result<std::string> read_text(const std::filesystem::path& path);

// Writes to a temporary name in the same folder, syncs, renames. Nothing partial ever stands under `path`; what a
// killed writer of the same `path` left under its temporary name is removed. Errors: kIo with the system's reason (disk
// full, read-only folder) and the remedy.
Result<void> write_atomically(const std::filesystem::path& path, std::string_view bytes);
// The same for writers that need a path (image libraries): `write` gets the temporary path, which keeps the extension.
Result<void> write_atomically_with(const std::filesystem::path& path,
                                   const std::function<Result<void>(const std::filesystem::path&)>& write);

// Fills an output folder while it is hidden.
using FillFolder = std::function<Result<void>(const std::filesystem::path& hidden)>;
// An output folder that appears whole: build() fills a hidden sibling, then `record`, where there is one, adds what the
// caller keeps beside the output (provenance); it is renamed to `path` on success and removed on failure. kExists when
// `path` exists already.
Result<void> create_folder_atomically(const std::filesystem::path& path, const FillFolder& build,
                                      const FillFolder& record = {});

// NumPy .npy, version 1.0, little-endian, C order. shape's product must equal data.size() (a Bug otherwise).
struct Array {
  std::vector<int> shape;
  std::vector<double> data;
};
enum class ArrayType { kFloat32, kFloat64, kInt32 };
Result<void> write_npy(const std::filesystem::path& path, const Array& array, ArrayType type = ArrayType::kFloat64);
// Any of the three types (kBadFile otherwise), widened to double.
Result<Array> read_npy(const std::filesystem::path& path);

// FNV-1a of a file's bytes as 16 hex digits.
Result<std::string> hash_file(const std::filesystem::path& path);
std::string hash_text(std::string_view text);

// Who made an output, from what, with which options; written beside it as provenance.json, outside byte comparisons.
struct Provenance {
  std::string version, command_line;
  std::vector<std::pair<std::string, std::string>> options;       // name, value
  std::vector<std::pair<std::string, std::string>> input_hashes;  // path, hash
  double seconds = 0;
};
Result<void> write_provenance(const std::filesystem::path& folder, const Provenance& provenance);

}  // namespace countershade
