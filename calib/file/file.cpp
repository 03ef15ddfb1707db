#include "calib/file/file.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <fstream>
#include <nlohmann/json.hpp>
#include <numeric>
#include <sstream>

#include "calib/base/random.h"

namespace countershade {

namespace {

namespace fs = std::filesystem;

std::string reason() { return std::strerror(errno); }

Error io_error(const fs::path& path, const std::string& what, const std::string& why) {
  return error(ErrorCode::kIo, "cannot {} '{}': {}; free some space or choose a folder that can be written", what, path.string(), why);
}

// Hidden name in the same folder, so that the rename stays on one file system; it keeps the extension.
fs::path temporary_name(const fs::path& path) {
  return path.parent_path() / (".writing-" + std::to_string(getpid()) + "-" + path.filename().string());
}

Result<void> sync_path(const fs::path& path, int flags) {
  const int fd = ::open(path.c_str(), flags);
  if (fd < 0) return io_error(path, "open", reason());
  const int status = ::fsync(fd);
  const std::string why = reason();
  ::close(fd);
  // Some file systems cannot sync a folder; that is not a failure of the write.
  if (status != 0 && !(flags & O_DIRECTORY)) return io_error(path, "sync", why);
  return {};
}

fs::path folder_of(const fs::path& path) { return path.has_parent_path() ? path.parent_path() : fs::path("."); }

Result<void> put(const fs::path& path, std::string_view bytes) {
  const int fd = ::open(path.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644);
  if (fd < 0) return io_error(path, "create", reason());
  while (!bytes.empty()) {
    const ssize_t count = ::write(fd, bytes.data(), bytes.size());
    if (count < 0 && errno == EINTR) continue;
    if (count < 0) {
      const std::string why = reason();
      ::close(fd);
      return io_error(path, fmt::format("write {} bytes to", bytes.size()), why);
    }
    bytes.remove_prefix(static_cast<std::size_t>(count));
  }
  if (::close(fd) != 0) return io_error(path, "close", reason());
  return {};
}

template <class T>
void append(std::string& bytes, const std::vector<double>& data) {
  for (double v : data) {
    const T t = static_cast<T>(v);
    bytes.append(reinterpret_cast<const char*>(&t), sizeof t);
  }
}

template <class T>
void extract(const std::string& bytes, std::size_t at, std::vector<double>& data) {
  for (double& v : data) {
    T t;
    std::memcpy(&t, bytes.data() + at, sizeof t);
    at += sizeof t;
    v = static_cast<double>(t);
  }
}

const char* type_name(ArrayType type) { return type == ArrayType::kFloat32 ? "<f4" : type == ArrayType::kFloat64 ? "<f8" : "<i4"; }

std::size_t product(const std::vector<int>& shape) { return std::accumulate(shape.begin(), shape.end(), std::size_t{1}, std::multiplies<>()); }

}  // namespace

Result<std::string> read_text(const fs::path& path) {
  if (!fs::is_regular_file(path)) return error(ErrorCode::kBadFile, "'{}' is missing; check the name", path.string());
  std::ifstream stream(path, std::ios::binary);
  std::stringstream text;
  text << stream.rdbuf();
  if (!stream) return error(ErrorCode::kIo, "cannot read '{}': {}", path.string(), reason());
  return text.str();
}

Result<void> write_atomically_with(const fs::path& path, const std::function<Result<void>(const fs::path&)>& write) {
  const fs::path temporary = temporary_name(path);
  Result<void> result = write(temporary);
  if (result) result = sync_path(temporary, O_RDONLY);
  if (result && ::rename(temporary.c_str(), path.c_str()) != 0) result = io_error(path, "rename to", reason());
  if (!result) {
    std::error_code ignored;
    fs::remove(temporary, ignored);
    return result;
  }
  return sync_path(folder_of(path), O_RDONLY | O_DIRECTORY);
}

Result<void> write_atomically(const fs::path& path, std::string_view bytes) {
  return write_atomically_with(path, [&](const fs::path& temporary) { return put(temporary, bytes); });
}

Result<void> create_folder_atomically(const fs::path& path, const std::function<Result<void>(const fs::path&)>& build) {
  fs::path target = path.lexically_normal();
  if (!target.has_filename()) target = target.parent_path();  // a trailing slash
  if (fs::exists(target)) return error(ErrorCode::kExists, "'{}' exists already; choose another name with -o or remove it", target.string());
  const fs::path hidden = temporary_name(target);
  std::error_code code;
  fs::remove_all(hidden, code);
  fs::create_directories(hidden, code);
  if (code) return io_error(hidden, "create", code.message());
  Result<void> result = build(hidden);
  if (result && ::rename(hidden.c_str(), target.c_str()) != 0) result = io_error(target, "rename to", reason());
  if (!result) {
    fs::remove_all(hidden, code);
    return result;
  }
  return sync_path(folder_of(target), O_RDONLY | O_DIRECTORY);
}

Result<void> write_npy(const fs::path& path, const Array& array, ArrayType type) {
  CS_CHECK(product(array.shape) == array.data.size(), "shape and data differ in size");
  std::string shape;
  for (int n : array.shape) shape += std::to_string(n) + ", ";
  if (array.shape.size() > 1) shape.resize(shape.size() - 2);
  std::string header = fmt::format("{{'descr': '{}', 'fortran_order': False, 'shape': ({}), }}", type_name(type), shape);
  header.append(63 - (header.size() + 10) % 64, ' ').append("\n");  // the data begin at a multiple of 64 bytes
  std::string bytes("\x93NUMPY\x01\x00", 8);
  bytes += static_cast<char>(header.size() & 0xff);
  bytes += static_cast<char>(header.size() >> 8);
  bytes += header;
  if (type == ArrayType::kFloat32) append<float>(bytes, array.data);
  else if (type == ArrayType::kFloat64) append<double>(bytes, array.data);
  else append<std::int32_t>(bytes, array.data);
  return write_atomically(path, bytes);
}

Result<Array> read_npy(const fs::path& path) {
  CS_TRY(const std::string bytes, read_text(path));
  const auto bad = [&](const char* why) { return error(ErrorCode::kBadFile, "'{}' is no .npy file this program reads: {}", path.string(), why); };
  if (bytes.size() < 10 || bytes.compare(0, 6, "\x93NUMPY") != 0) return bad("wrong magic bytes");
  const std::size_t length = static_cast<unsigned char>(bytes[8]) + 256u * static_cast<unsigned char>(bytes[9]);
  if (bytes.size() < 10 + length) return bad("truncated header");
  const std::string header = bytes.substr(10, length);
  const std::size_t open = header.find("'shape': ("), close = header.find(')', open);
  if (open == std::string::npos || close == std::string::npos || header.find("'fortran_order': False") == std::string::npos) return bad("unexpected header");
  Array array;
  std::stringstream shape(header.substr(open + 10, close - open - 10));
  for (std::string part; std::getline(shape, part, ',');)
    if (part.find_first_of("0123456789") != std::string::npos) array.shape.push_back(std::stoi(part));
  array.data.resize(product(array.shape));
  const std::size_t size = header.find("<f8") != std::string::npos ? 8 : 4, at = 10 + length;
  if (bytes.size() != at + size * array.data.size()) return bad("the data's size does not fit the shape");
  if (header.find("<f4") != std::string::npos) extract<float>(bytes, at, array.data);
  else if (size == 8) extract<double>(bytes, at, array.data);
  else if (header.find("<i4") != std::string::npos) extract<std::int32_t>(bytes, at, array.data);
  else return bad("type is not <f4, <f8 or <i4");
  return array;
}

std::string hash_text(std::string_view text) { return fmt::format("{:016x}", hash_name(text)); }

Result<std::string> hash_file(const fs::path& path) {
  CS_TRY(const std::string text, read_text(path));
  return hash_text(text);
}

Result<void> write_provenance(const fs::path& folder, const Provenance& provenance) {
  nlohmann::json options = nlohmann::json::object(), inputs = nlohmann::json::object();
  for (const auto& [name, value] : provenance.options) options[name] = value;
  for (const auto& [name, hash] : provenance.input_hashes) inputs[name] = hash;
  const nlohmann::json document = {{"format_version", 1}, {"version", provenance.version}, {"command_line", provenance.command_line},
                                   {"options", options}, {"inputs", inputs}, {"seconds", provenance.seconds}};
  return write_atomically(folder / "provenance.json", document.dump(1) + "\n");
}

}  // namespace countershade
