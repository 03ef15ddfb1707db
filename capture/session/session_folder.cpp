#include "capture/session/session_folder.h"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <nlohmann/json.hpp>

#include "calib/file/file.h"

namespace countershade::capture {

namespace fs = std::filesystem;

namespace {

constexpr const char* kLock = ".lock";
constexpr const char* kDraft = ".header";
constexpr const char* kUnhealthy = "unhealthy.json";

Error io_error(const fs::path& path, const std::error_code& reason) {
  return error(ErrorCode::kIo, "'{}' cannot be written: {}; check the disk and its permissions", path.string(),
               reason.message());
}

// Files of the draft that do not stand in the folder yet. kExists names one that stands there and differs.
Result<std::vector<fs::path>> missing_files(const fs::path& draft, const fs::path& folder) {
  std::vector<fs::path> missing;
  for (const auto& entry : fs::recursive_directory_iterator(draft)) {
    if (!entry.is_regular_file()) continue;
    const fs::path relative = fs::relative(entry.path(), draft);
    if (!fs::exists(folder / relative)) {
      missing.push_back(relative);
      continue;
    }
    CS_TRY(const std::string wanted, read_text(entry.path()));
    CS_TRY(const std::string found, read_text(folder / relative));
    if (wanted != found)
      return error(ErrorCode::kExists,
                   "session '{}' was begun with another rig or sequence ({} differs): choose another output folder, or "
                   "remove that session",
                   folder.string(), relative.string());
  }
  return missing;
}

}  // namespace

std::string exposure_text(double exposure_ms) {
  std::string text = fmt::format("{}", exposure_ms);
  if (text.find('.') == std::string::npos) text += ".0";
  return text + "ms";
}

std::string photo_name(int index, const std::string& exposure, const std::string& extension) {
  return fmt::format("{:04}{}{}{}", index, exposure.empty() ? "" : "_", exposure, extension);
}

Result<FolderLock> FolderLock::take(const fs::path& folder) {
  const fs::path path = folder / kLock;
  const int file = ::open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0644);
  if (file < 0) return io_error(path, std::error_code(errno, std::generic_category()));
  FolderLock lock(file);
  if (::flock(file, LOCK_EX | LOCK_NB) == 0) return lock;
  if (errno != EWOULDBLOCK) return io_error(path, std::error_code(errno, std::generic_category()));
  return error(ErrorCode::kRefused,
               "session '{}' is being captured by another process: wait until it has finished or stop it, then start "
               "again; the session resumes where it stands",
               folder.string());
}

FolderLock::FolderLock(FolderLock&& other) noexcept : file_(std::exchange(other.file_, -1)) {}

FolderLock::~FolderLock() {
  if (file_ >= 0) ::close(file_);
}

Result<void> claim_folder(const fs::path& folder) {
  std::error_code reason;
  if (fs::exists(folder, reason) && !fs::is_directory(folder, reason))
    return error(ErrorCode::kExists, "'{}' is a file: choose another name for the session", folder.string());
  fs::create_directories(folder, reason);
  if (reason) return io_error(folder, reason);
  const bool ours = fs::exists(folder / kLock) || fs::exists(folder / "sequence.json");
  if (!ours && !fs::is_empty(folder, reason))
    return error(ErrorCode::kExists,
                 "'{}' holds files that are not a session: choose another output folder, or empty this one",
                 folder.string());
  return {};
}

Result<void> write_or_compare_header(const fs::path& folder, const Rig& rig, const std::string& simulation_toml,
                                     const Sequence& sequence, bool extend) {
  const fs::path draft = folder / kDraft;
  std::error_code reason;
  fs::remove_all(draft, reason);
  fs::create_directories(draft, reason);
  if (reason) return io_error(draft, reason);
  auto written = write_session_header(draft, rig, simulation_toml, sequence);
  if (written && extend && fs::exists(folder / "sequence.json")) {
    const auto stored = read_sequence(folder / "sequence.json");
    if (stored && stored->frames.size() < sequence.frames.size() && begins_with(sequence, *stored))
      written = write_atomically(folder / "sequence.json", sequence_text(sequence));
  }
  auto missing = written ? missing_files(draft, folder) : Result<std::vector<fs::path>>(written.error());
  if (missing)
    for (const fs::path& file : *missing) {
      fs::create_directories((folder / file).parent_path(), reason);
      if (!reason) fs::rename(draft / file, folder / file, reason);
      if (reason) return io_error(folder / file, reason);
    }
  fs::remove_all(draft, reason);
  if (!missing) return missing.error();
  return {};
}

bool begins_with(const Sequence& whole, const Sequence& part) {
  return whole.projectors == part.projectors && part.frames.size() <= whole.frames.size() &&
         std::equal(part.frames.begin(), part.frames.end(), whole.frames.begin(),
                    [](const Frame& a, const Frame& b) { return a.index == b.index && a.role == b.role; });
}

Result<void> remove_unfinished(const fs::path& folder) {
  std::error_code reason;
  std::vector<fs::path> unfinished;
  for (const auto& entry : fs::directory_iterator(folder, reason))
    if (entry.path().filename().string().starts_with(".")) unfinished.push_back(entry.path());
  for (const fs::path& path : unfinished) fs::remove(path, reason);
  if (reason) return io_error(folder, reason);
  return {};
}

void mark_unhealthy(const fs::path& folder, const Devices& devices) {
  nlohmann::ordered_json cameras = nlohmann::ordered_json::object();
  bool asked = false;
  for (const auto& camera : devices.cameras) {
    const Health health = camera->health();
    asked |= health.photos > 0;
    if (const std::string why = health.unhealthy(); !why.empty())
      cameras[camera->id()] = {{"why", why}, {"photos", health.photos}, {"taken_again", health.again}};
  }
  std::error_code ignored;
  const fs::path path = folder / kUnhealthy;
  if (cameras.empty() && asked) fs::remove(path, ignored);
  if (!cameras.empty())
    static_cast<void>(write_atomically(path, nlohmann::ordered_json{{"cameras", cameras}}.dump(
                                                 1, ' ', false, nlohmann::ordered_json::error_handler_t::replace) +
                                                 "\n"));
}

std::vector<std::string> unhealthy_cameras(const fs::path& folder) {
  std::vector<std::string> lines;
  std::error_code reason;
  if (!fs::exists(folder / kUnhealthy, reason)) return lines;
  const auto text = read_text(folder / kUnhealthy);
  const auto document = nlohmann::json::parse(text ? *text : "", nullptr, false);
  const auto cameras = document.is_object() ? document.find("cameras") : document.end();
  if (cameras == document.end() || !cameras->is_object()) return lines;
  for (const auto& [id, entry] : cameras->items())
    if (entry.is_object() && entry.contains("why") && entry["why"].is_string())
      lines.push_back(fmt::format("camera '{}' was unhealthy: {}", id, entry["why"].get<std::string>()));
  return lines;
}

Result<void> check_sequence(const Rig& rig, const Sequence& sequence) {
  if (sequence.frames.empty())
    return error(ErrorCode::kBadValue, "the sequence has no frames: give a sequence.json with at least one");
  for (const auto& [id, size] : sequence.projectors) {
    const ProjectorSpec* spec = rig.projector(id);
    if (spec == nullptr)
      return error(ErrorCode::kBadValue,
                   "the sequence lights projector '{}', which the rig does not have: correct its id", id);
    if (spec->resolution != size)
      return error(ErrorCode::kBadValue,
                   "projector '{}' has {}x{} pixels in the rig but {}x{} in the sequence: make them equal", id,
                   spec->resolution[0], spec->resolution[1], size[0], size[1]);
  }
  return {};
}

}  // namespace countershade::capture
