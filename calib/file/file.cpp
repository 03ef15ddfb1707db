#include "calib/file/file.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <charconv>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstring>
#include <ctime>
#include <fstream>
#include <nlohmann/json.hpp>
#include <numeric>
#include <optional>
#include <sstream>

#include "calib/base/random.h"

namespace countershade {

namespace {

namespace fs = std::filesystem;

// What went wrong with a path that we write, and what to do about it, by the system's error number.
Error write_error(const fs::path& path, const std::string& doing, int number) {
  const char* remedy = "check the disk and its permissions";
  if (number == ENOSPC || number == EDQUOT) remedy = "free space on that disk or choose a folder on another one";
  if (number == EACCES || number == EPERM || number == EROFS) remedy = "choose a folder that can be written";
  if (number == ENOENT) remedy = "create the folder first or correct the name";
  return error(ErrorCode::kIo, "cannot {} '{}': {}; {}", doing, path.string(), std::strerror(number), remedy);
}

// Hidden name in the same folder, so that the rename stays on one file system; it keeps the extension.
fs::path temporary_name(const fs::path& path) {
  return path.parent_path() / (".writing-" + std::to_string(getpid()) + "-" + path.filename().string());
}

fs::path folder_of(const fs::path& path) {
  return path.has_parent_path() ? path.parent_path() : fs::path(".");
}

// Removes what writers of `path` left behind that were killed.
void remove_orphans(const fs::path& path) {
  const std::string begin = ".writing-", end = "-" + path.filename().string();
  std::error_code ignored;
  std::vector<fs::path> orphans;
  for (const auto& entry : fs::directory_iterator(folder_of(path), ignored)) {
    const std::string name = entry.path().filename().string();
    if (!name.starts_with(begin) || !name.ends_with(end) || name.size() <= begin.size() + end.size()) continue;
    const std::string writer = name.substr(begin.size(), name.size() - begin.size() - end.size());
    pid_t pid = 0;
    const auto [rest, bad] = std::from_chars(writer.data(), writer.data() + writer.size(), pid);
    const bool is_number = bad == std::errc() && rest == writer.data() + writer.size() && pid > 0;
    if (is_number && ::kill(pid, 0) != 0 && errno == ESRCH) orphans.push_back(entry.path());
  }
  for (const fs::path& orphan : orphans) fs::remove_all(orphan, ignored);
}

// Removes what stands under a name when it goes out of scope, also by an exception, unless it was renamed.
class Temporary {
 public:
  explicit Temporary(fs::path path) : path_(std::move(path)) {}
  ~Temporary() {
    std::error_code ignored;
    if (!path_.empty()) fs::remove_all(path_, ignored);
  }
  Temporary(const Temporary&) = delete;
  Temporary& operator=(const Temporary&) = delete;
  const fs::path& path() const { return path_; }
  Result<void> rename_to(const fs::path& target) {
    if (::rename(path_.c_str(), target.c_str()) != 0)
      return write_error(target, "put the finished result under", errno);
    path_.clear();
    return {};
  }

 private:
  fs::path path_;
};

// `temporary` holds what shall stand under `path`.
Result<void> sync_file(const fs::path& temporary, const fs::path& path) {
  const int file = ::open(temporary.c_str(), O_RDONLY | O_CLOEXEC);
  if (file < 0) return write_error(path, "write", errno);
  const int number = ::fsync(file) == 0 ? 0 : errno;
  ::close(file);
  if (number != 0) return write_error(path, "store", number);
  return {};
}

// Makes a rename last. Some file systems cannot sync a folder; that is no failure of the write.
void sync_folder(const fs::path& folder) {
  const int file = ::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (file < 0) return;
  ::fsync(file);
  ::close(file);
}

// Writes bytes to `temporary`; messages speak of `path`.
Result<void> put(const fs::path& temporary, const fs::path& path, std::string_view bytes) {
  const int file = ::open(temporary.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644);
  if (file < 0) return write_error(path, "write", errno);
  const std::string doing = fmt::format("write {} bytes to", bytes.size());
  int number = 0;
  while (!bytes.empty() && number == 0) {
    const ssize_t count = ::write(file, bytes.data(), bytes.size());
    if (count >= 0)
      bytes.remove_prefix(static_cast<std::size_t>(count));
    else if (errno != EINTR)
      number = errno;
  }
  if (::close(file) != 0 && number == 0) number = errno;
  if (number != 0) return write_error(path, doing, number);
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

const char* type_name(ArrayType type) {
  return type == ArrayType::kFloat32 ? "<f4" : type == ArrayType::kFloat64 ? "<f8" : "<i4";
}

std::size_t product(const std::vector<int>& shape) {
  return std::accumulate(shape.begin(), shape.end(), std::size_t{1}, std::multiplies<>());
}

// The text of a value in the header of a .npy file: of "'descr': '<f8'," the part from the quote to the comma.
std::string header_value(const std::string& header, const std::string& key) {
  const std::size_t at = header.find("'" + key + "':");
  if (at == std::string::npos) return "";
  const std::size_t begin = header.find_first_not_of(' ', at + key.size() + 3);
  if (begin == std::string::npos) return "";
  const std::size_t end = header.find(header[begin] == '(' ? ')' : ',', begin);
  return end == std::string::npos ? "" : header.substr(begin, end - begin);
}

// "(3, 4" -> {3, 4}; nothing where a size is no number, or the whole is larger than any file.
std::optional<std::vector<int>> shape_of(const std::string& text) {
  if (text.empty() || text[0] != '(') return std::nullopt;
  std::vector<int> shape;
  double total = 1;
  std::stringstream parts(text.substr(1));
  for (std::string part; std::getline(parts, part, ',');) {
    const std::size_t begin = part.find_first_not_of(' ');
    if (begin == std::string::npos) continue;
    int n = -1;
    std::from_chars(part.data() + begin, part.data() + part.size(), n);
    if (n < 0) return std::nullopt;
    shape.push_back(n);
    total *= n;
  }
  if (total > 1e12) return std::nullopt;
  return shape;
}

}  // namespace

Result<std::string> read_text(const fs::path& path) {
  std::error_code reason;
  if (!fs::exists(path, reason))
    return error(ErrorCode::kBadFile, "'{}' is missing; check the name or restore the file", path.string());
  if (fs::is_directory(path, reason))
    return error(ErrorCode::kBadFile, "'{}' is a folder where a file is expected; check the name", path.string());
  std::ifstream stream(path, std::ios::binary);
  std::string text;
  if (stream) text.assign(std::istreambuf_iterator<char>(stream), {});
  if (!stream)
    return error(ErrorCode::kIo, "cannot read '{}': {}; check the disk and the file's permissions", path.string(),
                 std::strerror(errno));
  return text;
}

Result<void> write_atomically_with(const fs::path& path, const std::function<Result<void>(const fs::path&)>& write) {
  remove_orphans(path);
  Temporary temporary(temporary_name(path));
  CS_TRY_VOID(write(temporary.path()));
  CS_TRY_VOID(sync_file(temporary.path(), path));
  CS_TRY_VOID(temporary.rename_to(path));
  sync_folder(folder_of(path));
  return {};
}

Result<void> write_atomically(const fs::path& path, std::string_view bytes) {
  return write_atomically_with(path, [&](const fs::path& temporary) { return put(temporary, path, bytes); });
}

Result<void> create_folder_atomically(const fs::path& path, const FillFolder& build, const FillFolder& record) {
  fs::path target = path.lexically_normal();
  if (!target.has_filename()) target = target.parent_path();  // a trailing slash
  std::error_code reason;
  if (fs::exists(fs::symlink_status(target, reason)))
    return error(ErrorCode::kExists, "'{}' exists already; choose another name or remove it", target.string());
  remove_orphans(target);
  Temporary hidden(temporary_name(target));
  fs::remove_all(hidden.path(), reason);
  fs::create_directories(hidden.path(), reason);
  if (reason) return write_error(target, "create", reason.value());
  CS_TRY_VOID(build(hidden.path()));
  if (record) CS_TRY_VOID(record(hidden.path()));
  CS_TRY_VOID(hidden.rename_to(target));
  sync_folder(folder_of(target));
  return {};
}

Result<void> write_npy(const fs::path& path, const Array& array, ArrayType type) {
  CS_CHECK(product(array.shape) == array.data.size(), "shape and data differ in size");
  if (type == ArrayType::kInt32)
    for (const double v : array.data)
      CS_CHECK(std::nearbyint(v) == v && std::abs(v) < 2147483648.0, "an array of whole numbers holds others");
  std::string shape;
  for (int n : array.shape) shape += std::to_string(n) + ", ";
  if (array.shape.size() > 1) shape.resize(shape.size() - 2);
  std::string header =
      fmt::format("{{'descr': '{}', 'fortran_order': False, 'shape': ({}), }}", type_name(type), shape);
  header.append(63 - (header.size() + 10) % 64, ' ').append("\n");  // the data begin at a multiple of 64 bytes
  std::string bytes("\x93NUMPY\x01\x00", 8);
  bytes += static_cast<char>(header.size() & 0xff);
  bytes += static_cast<char>(header.size() >> 8);
  bytes += header;
  if (type == ArrayType::kFloat32)
    append<float>(bytes, array.data);
  else if (type == ArrayType::kFloat64)
    append<double>(bytes, array.data);
  else
    append<std::int32_t>(bytes, array.data);
  return write_atomically(path, bytes);
}

Result<Array> read_npy(const fs::path& path) {
  CS_TRY(const std::string bytes, read_text(path));
  const auto bad = [&](const std::string& why) {
    return error(ErrorCode::kBadFile, "'{}' is no array that this program reads: {}; restore it or write it again",
                 path.string(), why);
  };
  if (bytes.size() < 10 || bytes.compare(0, 6, "\x93NUMPY") != 0) return bad("it does not begin as a .npy file");
  if (bytes[6] != 1) return bad(fmt::format(".npy version {}, expected 1", static_cast<int>(bytes[6])));
  const std::size_t at = 10 + static_cast<unsigned char>(bytes[8]) + 256u * static_cast<unsigned char>(bytes[9]);
  if (bytes.size() < at) return bad("it is truncated within its header");
  const std::string header = bytes.substr(10, at - 10), type = header_value(header, "descr");
  if (type != "'<f4'" && type != "'<f8'" && type != "'<i4'")
    return bad(fmt::format("its type is {}, expected '<f4', '<f8' or '<i4'", type));
  if (header_value(header, "fortran_order") != "False") return bad("its order is Fortran's, expected C's");
  const auto shape = shape_of(header_value(header, "shape"));
  if (!shape) return bad("its shape cannot be read");
  const std::size_t count = product(*shape), expected = at + count * (type == "'<f8'" ? 8 : 4);
  if (bytes.size() != expected)
    return bad(fmt::format("it has {} bytes, its shape asks for {}", bytes.size(), expected));
  Array array{*shape, std::vector<double>(count)};
  if (type == "'<f4'")
    extract<float>(bytes, at, array.data);
  else if (type == "'<f8'")
    extract<double>(bytes, at, array.data);
  else
    extract<std::int32_t>(bytes, at, array.data);
  return array;
}

std::string hash_text(std::string_view text) {
  return fmt::format("{:016x}", hash_name(text));
}

Result<std::string> hash_file(const fs::path& path) {
  CS_TRY(const std::string text, read_text(path));
  return hash_text(text);
}

Result<void> write_provenance(const fs::path& folder, const Provenance& provenance) {
  using nlohmann::ordered_json;
  // An option that was given several times becomes a list.
  ordered_json options = ordered_json::object(), inputs = ordered_json::object();
  for (const auto& [name, value] : provenance.options) {
    if (!options.contains(name))
      options[name] = value;
    else if (options[name].is_array())
      options[name].push_back(value);
    else
      options[name] = ordered_json::array({options[name], value});
  }
  for (const auto& [name, hash] : provenance.input_hashes) inputs[name] = hash;
  const auto now = std::chrono::system_clock::to_time_t(std::chrono::system_clock::now());
  std::tm utc{};
  gmtime_r(&now, &utc);
  char finished[32];
  std::strftime(finished, sizeof finished, "%Y-%m-%dT%H:%M:%SZ", &utc);
  const ordered_json document = {{"format_version", 1},
                                 {"program", "countershade"},
                                 {"version", provenance.version},
                                 {"command_line", provenance.command_line},
                                 {"options", options},
                                 {"inputs", inputs},
                                 {"finished", finished},
                                 {"seconds", provenance.seconds}};
  // A path need not be UTF-8: what is not is replaced rather than refused.
  const std::string text = document.dump(1, ' ', false, ordered_json::error_handler_t::replace);
  return write_atomically(folder / "provenance.json", text + "\n");
}

}  // namespace countershade
