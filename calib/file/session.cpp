#include "calib/file/session.h"

#include <algorithm>
#include <map>
#include <nlohmann/json.hpp>

#include "calib/file/file.h"
#include "calib/image/image_file.h"
#include "calib/photometry/response.h"

namespace countershade {

namespace {

namespace fs = std::filesystem;

// A stored photo of one exposure; exposure 0 = the only one.
struct Stored {
  fs::path path;
  double exposure_ms = 0;
};

// Stored value from which on a pixel counts as saturated, fraction of full scale.
constexpr double kSaturated = 0.995;

// "0007.tif" -> frame 7; "0007_8.0ms.tif" -> frame 7 at 8 ms; nothing for other names.
std::optional<std::pair<int, double>> parse_name(const fs::path& path) {
  const std::string extension = path.extension().string();
  if (extension != ".png" && extension != ".tif" && extension != ".tiff" && extension != ".exr") return std::nullopt;
  const std::string stem = path.stem().string();
  const std::size_t digits = stem.find_first_not_of("0123456789");
  if (digits == 0 || stem.empty() || digits > 8) {
    if (digits != std::string::npos || stem.empty() || stem.size() > 8) return std::nullopt;
  }
  const int index = std::stoi(stem.substr(0, digits));
  if (digits == std::string::npos) return std::pair{index, 0.0};
  const std::string rest = stem.substr(digits);
  if (rest.size() < 4 || rest[0] != '_' || rest.substr(rest.size() - 2) != "ms") return std::nullopt;
  char* end = nullptr;
  const double exposure = std::strtod(rest.c_str() + 1, &end);
  if (end != rest.c_str() + rest.size() - 2 || !(exposure > 0)) return std::nullopt;
  return std::pair{index, exposure};
}

fs::path folder_of(const fs::path& session, const Rig& rig, const std::string& camera) {
  const fs::path own = session / "photos" / camera;
  return rig.cameras.size() > 1 || fs::is_directory(own) ? own : session / "photos";
}

// All exposures of each frame, shortest first.
std::map<int, std::vector<Stored>> list_photos(const fs::path& folder) {
  std::map<int, std::vector<Stored>> photos;
  std::error_code code;
  for (const auto& entry : fs::directory_iterator(folder, code))
    if (const auto parsed = parse_name(entry.path())) photos[parsed->first].push_back({entry.path(), parsed->second});
  for (auto& [index, exposures] : photos)
    std::sort(exposures.begin(), exposures.end(), [](const Stored& a, const Stored& b) { return std::pair(a.exposure_ms, a.path) < std::pair(b.exposure_ms, b.path); });
  return photos;
}

// Sum over exposures, each scaled to the reference exposure and weighted by how long it looked.
Photo merge(const std::vector<Photo>& photos, const std::vector<double>& exposures_ms, double reference_ms) {
  Photo merged = photos[0];
  merged.exposure_ms = reference_ms;
  const int channels = merged.value.channels();
  for (std::size_t i = 0; i < merged.value.pixels(); ++i) {
    double weight = 0, sum[3] = {0, 0, 0};
    for (std::size_t e = 0; e < photos.size(); ++e) {
      if (!photos[e].valid.data()[i]) continue;
      weight += exposures_ms[e];
      for (int c = 0; c < channels; ++c) sum[c] += photos[e].value.data()[i * channels + c] * reference_ms;
    }
    merged.valid.data()[i] = weight > 0;
    for (int c = 0; c < channels && weight > 0; ++c) merged.value.data()[i * channels + c] = static_cast<float>(sum[c] / weight);
  }
  return merged;
}

Result<void> copy_model(const fs::path& folder, const std::string& id, fs::path& model) {
  if (model.empty()) return {};
  CS_TRY(const std::string text, read_text(model));
  model = fs::path("models") / (id + ".cameramodel");
  return write_atomically(folder / model, text);
}

}  // namespace

Result<Session> Session::open(const fs::path& folder) {
  if (!fs::is_directory(folder)) return error(ErrorCode::kBadFile, "session '{}' is missing; check the name", folder.string());
  Session session;
  session.folder_ = folder;
  CS_TRY(session.rig_, read_rig(folder / "rig.toml"));
  CS_TRY(session.sequence_, read_sequence(folder / "sequence.json"));
  for (const auto& [id, resolution] : session.sequence_.projectors) {
    const ProjectorSpec* spec = session.rig_.projector(id);
    if (!spec) return error(ErrorCode::kBadFile, "session '{}': its sequence lights projector '{}', which its rig.toml does not name", folder.string(), id);
    if (spec->resolution != resolution)
      return error(ErrorCode::kBadFile, "session '{}': projector '{}' has {} x {} pixels in rig.toml and {} x {} in sequence.json; correct the wrong one", folder.string(), id,
                   spec->resolution[0], spec->resolution[1], resolution[0], resolution[1]);
  }
  for (const CameraSpec& camera : session.rig_.cameras) {
    const auto photos = list_photos(folder_of(folder, session.rig_, camera.id));
    int missing = 0, first = -1;
    for (const Frame& frame : session.sequence_.frames)
      if (!photos.count(frame.index) && ++missing == 1) first = frame.index;
    if (missing)
      return error(ErrorCode::kBadFile, "session '{}': camera '{}' lacks {} of {} photos, the first is {:04}; capture again (it resumes) or add them", folder.string(), camera.id, missing,
                   session.sequence_.frames.size(), first);
  }
  return session;
}

fs::path Session::photo_path(const std::string& camera, int index) const {
  const auto photos = list_photos(folder_of(folder_, rig_, camera));
  const auto found = photos.find(index);
  return found == photos.end() ? fs::path() : found->second.front().path;
}

Result<Photo> Session::photo(const std::string& camera, int index) const {
  const CameraSpec* spec = rig_.camera(camera);
  CS_CHECK(spec, "camera of another rig");
  const auto listed = list_photos(folder_of(folder_, rig_, camera));
  const auto found = listed.find(index);
  if (found == listed.end()) return error(ErrorCode::kBadFile, "session '{}': photo {:04} of camera '{}' is missing", folder_.string(), index, camera);
  std::vector<Photo> photos;
  std::vector<double> exposures;
  for (const Stored& stored : found->second) {
    CS_TRY(Photo photo, read_photo(stored.path, *spec));
    if (!photos.empty() && !photo.value.same_size(photos[0].value.width(), photos[0].value.height()))
      return error(ErrorCode::kBadFile, "'{}' and '{}' differ in size", stored.path.string(), found->second[0].path.string());
    photos.push_back(std::move(photo));
    exposures.push_back(stored.exposure_ms);
  }
  if (photos.size() == 1) {
    photos[0].exposure_ms = exposures[0];
    return std::move(photos[0]);
  }
  return merge(photos, exposures, spec->exposures_ms.empty() ? exposures[0] : spec->exposures_ms[0]);
}

Result<Photo> read_photo(const fs::path& path, const CameraSpec& camera) {
  CS_TRY(StoredImage stored, read_image(path));
  CS_TRY(const Response response, Response::parse(camera.response));
  const double full = camera.full_scale.value_or(stored.full_scale), span = full - camera.pedestal;
  if (!(span > 0)) return error(ErrorCode::kBadValue, "camera '{}': pedestal {} is not below full scale {}", camera.id, camera.pedestal, full);
  const bool linear = camera.response == "linear";
  Photo photo{std::move(stored.values), {}, 0};
  const int channels = photo.value.channels();
  photo.valid = Mask(photo.value.width(), photo.value.height(), 1, 1);
  for (std::size_t i = 0; i < photo.value.data().size(); ++i) {
    float& v = photo.value.data()[i];
    if (!std::isfinite(v) || v >= kSaturated * full) photo.valid.data()[i / channels] = 0;
    const double fraction = (v - camera.pedestal) / span;
    v = static_cast<float>(linear ? fraction : response.decode(fraction));
  }
  return photo;
}

Result<void> write_session_header(const fs::path& folder, const Rig& rig, const std::string& simulation_toml, const Sequence& sequence) {
  std::error_code code;
  for (const char* name : {"photos", "models"}) {
    fs::create_directories(folder / name, code);
    if (code) return error(ErrorCode::kIo, "cannot create '{}': {}", (folder / name).string(), code.message());
  }
  Rig own = rig;
  for (CameraSpec& camera : own.cameras) CS_TRY_VOID(copy_model(folder, camera.id, camera.model));
  for (ProjectorSpec& projector : own.projectors) CS_TRY_VOID(copy_model(folder, projector.id, projector.model));
  CS_TRY_VOID(write_atomically(folder / "rig.toml", canonical_rig_text(own)));
  if (!simulation_toml.empty()) CS_TRY_VOID(write_atomically(folder / "simulation.toml", simulation_toml));
  CS_TRY_VOID(write_atomically(folder / "sequence.json", sequence_text(sequence)));
  return write_atomically(folder / "session.json", "{\"format_version\": 1}\n");
}

}  // namespace countershade
