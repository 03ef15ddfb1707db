#include "solver/fit/lens/model_file.h"

#include <cstring>
#include <string_view>

#include "calib/file/file.h"
#include "solver/fit/lens/lens_parts.h"

namespace countershade::solver {

namespace {

template <class T>
void append(std::string& bytes, T value) {  // little-endian, as every machine that we build for
  char raw[sizeof(T)];
  std::memcpy(raw, &value, sizeof(T));
  bytes.append(raw, sizeof(T));
}

// NumPy's .npy 1.0 of any type.
std::string npy(std::string_view type, const std::string& shape, const std::string& data) {
  std::string header = fmt::format("{{'descr': '{}', 'fortran_order': False, 'shape': ({}), }}", type, shape);
  header.append(63 - (header.size() + 10) % 64, ' ');
  header += '\n';
  std::string bytes("\x93NUMPY\x01\x00", 8);
  append(bytes, static_cast<std::uint16_t>(header.size()));
  return bytes + header + data;
}

std::string npy_text(std::string_view text) {  // UTF-32; an empty one stands for Python's None
  std::string data;
  for (char c : text) append(data, static_cast<std::uint32_t>(static_cast<unsigned char>(c)));
  if (text.empty()) append(data, std::uint32_t{0});
  return npy(fmt::format("<U{}", std::max<std::size_t>(1, text.size())), "", data);
}

std::string npy_flag(bool value) {
  return npy("|b1", "", std::string(1, value ? '\1' : '\0'));
}

std::string npy_doubles(const std::string& shape, const std::vector<double>& values) {
  std::string data;
  for (double v : values) append(data, v);
  return npy("<f8", shape, data);
}

std::string npy_ints(const std::string& shape, const std::vector<std::int32_t>& values) {
  std::string data;
  for (std::int32_t v : values) append(data, v);
  return npy("<i4", shape, data);
}

std::uint32_t crc32(std::string_view bytes) {
  std::uint32_t crc = 0xffffffff;
  for (unsigned char c : bytes) {
    crc ^= c;
    for (int k = 0; k < 8; ++k) crc = crc >> 1 ^ (crc & 1 ? 0xedb88320 : 0);
  }
  return ~crc;
}

// An uncompressed .zip, which is what an .npz is.
std::string zip(const std::vector<std::pair<std::string, std::string>>& files) {
  std::string body, directory;
  for (const auto& [name, bytes] : files) {
    std::string entry;                                                   // what both headers say
    for (std::uint16_t field : {20, 0, 0, 0, 33}) append(entry, field);  // version, flags, stored, midnight, 1980-01-01
    append(entry, crc32(bytes));
    append(entry, static_cast<std::uint32_t>(bytes.size()));
    append(entry, static_cast<std::uint32_t>(bytes.size()));
    append(entry, static_cast<std::uint16_t>(name.size()));
    append(entry, std::uint16_t{0});
    directory += std::string("PK\1\2", 4);
    append(directory, std::uint16_t{20});
    directory += entry;
    directory.append(10, '\0');  // no comment, disk 0, no attributes
    append(directory, static_cast<std::uint32_t>(body.size()));
    directory += name;
    body += std::string("PK\3\4", 4) + entry + name + bytes;
  }
  std::string end("PK\5\6\0\0\0\0", 8);
  append(end, static_cast<std::uint16_t>(files.size()));
  append(end, static_cast<std::uint16_t>(files.size()));
  append(end, static_cast<std::uint32_t>(directory.size()));
  append(end, static_cast<std::uint32_t>(body.size()));
  append(end, std::uint16_t{0});
  return body + directory + end;
}

// Python's base64.b85encode: four bytes as five digits of RFC 1924, the end padded with zeros and cut.
std::string base85(std::string bytes) {
  constexpr char kDigits[] = "0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz!#$%&()*+-;<=>?@^_`{|}~";
  const std::size_t padding = (4 - bytes.size() % 4) % 4;
  bytes.append(padding, '\0');
  std::string text;
  for (std::size_t i = 0; i < bytes.size(); i += 4) {
    std::uint32_t word = 0;
    for (std::size_t k = 0; k < 4; ++k) word = word << 8 | static_cast<unsigned char>(bytes[i + k]);
    char digits[5];
    for (int k = 4; k >= 0; --k, word /= 85) digits[k] = kDigits[word % 85];
    text.append(digits, 5);
  }
  text.resize(text.size() - padding);
  return text;
}

std::string inputs_of(const lens_parts::Problem& p) {
  std::vector<double> poses, observations;
  std::vector<std::int32_t> indices;
  for (int v = 0; v < p.views(); ++v) {
    poses.insert(poses.end(), p.poses[v].begin(), p.poses[v].end());
    for (int index : {v, 0, -1}) indices.push_back(index);
  }
  for (const auto& o : p.observations) observations.insert(observations.end(), o.begin(), o.end());
  const std::string none = npy_text("");
  std::vector<std::pair<std::string, std::string>> arrays = {
      {"intrinsics", npy_doubles(fmt::format("1, {}", p.intrinsics.size()), p.intrinsics)},
      {"extrinsics_rt_fromref", npy_doubles("0, 6", {})},
      {"frames_rt_toref", npy_doubles(fmt::format("{}, 6", p.views()), poses)},
      {"points", none},
      {"observations_board", npy_doubles(fmt::format("{}, {}, {}, 3", p.views(), p.rows, p.columns), observations)},
      {"indices_frame_camintrinsics_camextrinsics", npy_ints(fmt::format("{}, 3", p.views()), indices)},
      {"observations_point", none},
      {"indices_point_camintrinsics_camextrinsics", none},
      {"lensmodel", npy_text(p.model)},
      {"imagersizes", npy_ints("1, 2", {p.width, p.height})},
      {"calobject_warp", none},
      {"do_optimize_intrinsics_core", npy_flag(p.core_moves)},
      {"do_optimize_intrinsics_distortions", npy_flag(p.intrinsics.size() > 4)},
      {"do_optimize_extrinsics", npy_flag(true)},  // there are none; mrcal wants to be asked
      {"do_optimize_frames", npy_flag(true)},
      {"do_optimize_calobject_warp", npy_flag(false)},
      {"calibration_object_spacing", npy_doubles("", {p.spacing})},
      {"do_apply_regularization", npy_flag(p.regularised)},
      {"do_apply_outlier_rejection", npy_flag(false)},
      {"verbose", npy_flag(false)}};
  for (auto& [name, bytes] : arrays) name += ".npy";
  return base85(zip(arrays));
}

}  // namespace

Result<void> write_fitted_cameramodel(const std::filesystem::path& path, const BoardViews& data, const LensFit& fit) {
  return write_atomically(path, fmt::format("{{\n"
                                            "    'lensmodel':  '{}',\n"
                                            "    # fx, fy, cx, cy, distortion\n"
                                            "    'intrinsics': [ {} ],\n"
                                            "    # rt_cam_ref: Rodrigues vector, translation\n"
                                            "    'extrinsics': [ 0, 0, 0, 0, 0, 0 ],\n"
                                            "    'imagersize': [ {}, {} ],\n"
                                            "    'icam_intrinsics': 0,\n"
                                            "    # All observations and poses, as mrcal's own tools store them.\n"
                                            "    'optimization_inputs': b'{}'\n"
                                            "}}\n",
                                            fit.lens.model(), fmt::join(fit.lens.intrinsics(), ", "), fit.lens.width(),
                                            fit.lens.height(), inputs_of(lens_parts::problem_of(data, fit))));
}

}  // namespace countershade::solver
