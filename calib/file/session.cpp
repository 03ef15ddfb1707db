#include "calib/file/session.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <opencv2/imgproc.hpp>

#include "calib/file/file.h"
#include "calib/file/photo_probe.h"
#include "calib/image/image_file.h"
#include "calib/photometry/response.h"

namespace countershade {

namespace fs = std::filesystem;

namespace {

// A stored photo of one exposure; exposure 0 = its name does not say.
struct Stored {
  fs::path path;
  double exposure_ms = 0;
};
using Photos = std::map<int, std::vector<Stored>>;  // by frame, shortest exposure first

// Stored value from which on a pixel counts as saturated, fraction of full scale.
constexpr double kSaturated = 0.995;

// "0007.tif" -> frame 7; "0007_8.0ms.tif" -> frame 7 at 8 ms; nothing for other names.
std::optional<std::pair<int, double>> parse_name(const fs::path& path) {
  std::string type = path.extension().string();
  std::transform(type.begin(), type.end(), type.begin(), [](unsigned char c) { return std::tolower(c); });
  if (type != ".png" && type != ".tif" && type != ".tiff" && type != ".exr") return std::nullopt;
  const std::string stem = path.stem().string();
  const char* const end = stem.data() + stem.size();
  if (stem.empty() || !std::isdigit(static_cast<unsigned char>(stem[0]))) return std::nullopt;
  int index = 0;
  const auto number = std::from_chars(stem.data(), end, index);
  if (number.ec != std::errc()) return std::nullopt;
  if (number.ptr == end) return std::pair(index, 0.0);
  double exposure = 0;
  if (*number.ptr != '_') return std::nullopt;
  const auto rest = std::from_chars(number.ptr + 1, end, exposure);
  if (rest.ec != std::errc() || std::string_view(rest.ptr, end - rest.ptr) != "ms" || !(exposure > 0))
    return std::nullopt;
  return std::pair(index, exposure);
}

fs::path folder_of(const fs::path& session, const Rig& rig, const std::string& camera) {
  const fs::path own = session / "photos" / camera;
  std::error_code reason;
  return rig.cameras.size() > 1 || fs::is_directory(own, reason) ? own : session / "photos";
}

Photos list_photos(const fs::path& folder) {
  Photos photos;
  std::error_code reason;  // a folder that is not there holds no photos
  for (const auto& entry : fs::directory_iterator(folder, reason))
    if (const auto parsed = parse_name(entry.path())) photos[parsed->first].push_back({entry.path(), parsed->second});
  for (auto& [index, exposures] : photos)
    std::sort(exposures.begin(), exposures.end(), [](const Stored& a, const Stored& b) {
      return std::pair(a.exposure_ms, a.path) < std::pair(b.exposure_ms, b.path);
    });
  return photos;
}

// ---- opening ----

Error bad_session(const fs::path& folder, const std::string& what) {
  return error(ErrorCode::kBadFile, "session '{}': {}", folder.string(), what);
}

Result<void> check_version(const fs::path& folder) {
  const fs::path path = folder / "session.json";
  std::error_code reason;
  if (!fs::exists(path, reason)) return {};  // put together by hand
  CS_TRY(const std::string text, read_text(path));
  const auto j = nlohmann::json::parse(text, nullptr, false);
  const bool readable = j.is_object() && j.contains("format_version") && j.at("format_version").is_number_integer();
  if (!readable) return error(ErrorCode::kBadFile, "'{}' has no format_version; restore the file", path.string());
  if (const long version = j.at("format_version").get<long>(); version > 1)
    return error(
        ErrorCode::kBadFile,
        "'{}' has format_version {}, newer than 1, the newest that this program reads; use a newer countershade",
        path.string(), version);
  return {};
}

Result<void> check_projectors(const fs::path& folder, const Rig& rig, const Sequence& sequence) {
  for (const auto& [id, size] : sequence.projectors) {
    const ProjectorSpec* spec = rig.projector(id);
    if (spec == nullptr)
      return bad_session(folder, fmt::format("sequence.json lights projector '{}', which rig.toml does not name", id));
    if (spec->resolution != size)
      return bad_session(folder,
                         fmt::format("projector '{}' has {} x {} pixels in rig.toml but {} x {} in sequence.json; "
                                     "correct the wrong one",
                                     id, spec->resolution[0], spec->resolution[1], size[0], size[1]));
  }
  return {};
}

// Each frame has the same exposures, each of them once.
Result<void> check_complete(const fs::path& folder, const CameraSpec& camera, const Sequence& sequence,
                            const Photos& photos, const fs::path& where) {
  std::vector<double> wanted;  // those of the frame that has most
  for (const Frame& frame : sequence.frames)
    if (const auto found = photos.find(frame.index); found != photos.end() && found->second.size() > wanted.size()) {
      wanted.clear();
      for (const Stored& s : found->second) wanted.push_back(s.exposure_ms);
    }
  std::size_t missing = 0;
  std::string first;
  for (const Frame& frame : sequence.frames) {
    const auto found = photos.find(frame.index);
    std::vector<double> here;
    if (found != photos.end())
      for (const Stored& s : found->second) here.push_back(s.exposure_ms);
    if (const auto twice = std::adjacent_find(here.begin(), here.end()); twice != here.end())
      return bad_session(folder, fmt::format("'{}' and '{}' are photos of the same frame and exposure; remove one",
                                             found->second[twice - here.begin()].path.string(),
                                             found->second[twice - here.begin() + 1].path.string()));
    if (!here.empty() && here == wanted) continue;
    if (missing++ > 0) continue;
    first = fmt::format("{:04} ({}){}", frame.index, frame.role.name(),
                        here.empty() ? "" : ", of which other exposures are there");
  }
  if (missing == 0) return {};
  return bad_session(folder,
                     fmt::format("camera '{}' lacks photos of {} of {} frames in '{}', the first is {}; capture again "
                                 "(it resumes) or add them",
                                 camera.id, missing, sequence.frames.size(), where.string(), first));
}

Result<void> check_photos(const fs::path& folder, const Rig& rig, const CameraSpec& camera, const Sequence& sequence) {
  const fs::path where = folder_of(folder, rig, camera.id);
  const Photos photos = list_photos(where);
  CS_TRY_VOID(check_complete(folder, camera, sequence, photos, where));
  std::optional<PhotoShape> wanted;
  fs::path first;
  for (const Frame& frame : sequence.frames)
    for (const Stored& stored : photos.at(frame.index)) {
      CS_TRY(const auto shape, probe_photo(stored.path));
      if (!shape) continue;
      if (!wanted) wanted = shape, first = stored.path;
      if (*shape != *wanted)
        return bad_session(
            folder, fmt::format("'{}' has {} x {} pixels of {} channels but '{}' {} x {} of {}; all photos of a camera "
                                "have one size: take the odd one again",
                                stored.path.string(), shape->width, shape->height, shape->channels, first.string(),
                                wanted->width, wanted->height, wanted->channels));
    }
  return {};
}

// ---- what photos show besides the frames ----

Result<UnusedParts> read_unused(const fs::path& folder, const Rig& rig) {
  const fs::path path = folder / "unused.json";
  std::error_code reason;
  if (!fs::exists(path, reason)) return UnusedParts();
  CS_TRY(const std::string text, read_text(path));
  UnusedParts unused;
  try {
    const nlohmann::json document = nlohmann::json::parse(text);
    for (const auto& [camera, polygons] : document.at("cameras").items()) {
      if (rig.camera(camera) == nullptr)
        return error(ErrorCode::kBadFile, "'{}': rig.toml has no camera '{}'; correct the name", path.string(), camera);
      for (const auto& polygon : polygons) {
        auto& corners = unused[camera].emplace_back();
        for (const auto& corner : polygon) corners.emplace_back(corner.at(0).get<double>(), corner.at(1).get<double>());
        const bool sane = corners.size() >= 3 && std::all_of(corners.begin(), corners.end(), [](const auto& q) {
                            return q.allFinite() && q.cwiseAbs().maxCoeff() < 1e6;
                          });
        if (!sane)
          return error(ErrorCode::kBadFile, "'{}': a polygon of camera '{}' has {} corners or one beyond every photo",
                       path.string(), camera, corners.size());
      }
    }
  } catch (const nlohmann::json::exception& e) {
    return error(ErrorCode::kBadFile, "'{}' is not {{\"cameras\": {{id: [[[x, y], ...], ...]}}}}: {}", path.string(),
                 e.what());
  }
  return unused;
}

void invalidate(Mask& valid, const std::vector<std::vector<Eigen::Vector2d>>& polygons) {
  cv::Mat view(valid.height(), valid.width(), CV_8U, valid.data().data());
  for (const auto& polygon : polygons) {
    std::vector<cv::Point> corners;
    for (const Eigen::Vector2d& q : polygon)
      corners.emplace_back(static_cast<int>(std::lround(q.x())), static_cast<int>(std::lround(q.y())));
    cv::fillPoly(view, std::vector{corners}, cv::Scalar(0));
  }
}

// ---- reading ----

// Sum of what the exposures collected over the time they collected it, in units of full scale at the reference
// exposure. A pixel that no exposure holds unsaturated keeps the value of the shortest one, invalid.
Photo merge(const std::vector<Photo>& photos, double reference_ms) {
  Photo merged = photos[0];
  merged.exposure_ms = reference_ms;
  const int channels = merged.value.channels();
  for (std::size_t i = 0; i < merged.value.pixels(); ++i) {
    double time = 0, light[3] = {0, 0, 0};
    const auto add = [&](const Photo& photo) {
      time += photo.exposure_ms;
      for (int c = 0; c < channels; ++c) light[c] += photo.value.data()[i * channels + c];
    };
    for (const Photo& photo : photos)
      if (photo.valid.data()[i]) add(photo);
    merged.valid.data()[i] = time > 0;
    if (time == 0) add(photos[0]);
    for (int c = 0; c < channels; ++c)
      merged.value.data()[i * channels + c] = static_cast<float>(light[c] * reference_ms / time);
  }
  return merged;
}

// Stored value from which on nothing is known of the light. A float file has no largest value of its own; one that goes
// beyond 1 was not clipped there.
double saturation(const StoredImage& stored, const CameraSpec& camera) {
  if (camera.full_scale) return kSaturated * *camera.full_scale;
  const auto& values = stored.values.data();
  const bool unbounded = stored.bits == 32 && std::any_of(values.begin(), values.end(), [](float v) { return v > 1; });
  return unbounded ? std::numeric_limits<double>::infinity() : kSaturated * stored.full_scale;
}

// Light of each possible stored value of a file of whole numbers.
std::vector<float> light_table(const Response& response, double pedestal, double span, double largest) {
  std::vector<float> table(static_cast<std::size_t>(largest) + 1);
  for (std::size_t v = 0; v < table.size(); ++v) table[v] = static_cast<float>(response.decode((v - pedestal) / span));
  return table;
}

Result<void> copy_model(const fs::path& folder, const std::string& device, const std::string& name, fs::path& model) {
  if (model.empty()) return {};
  const auto text = read_text(model);
  if (!text) return error(text.error().code, "model of {}: {}", device, text.error().message);
  const fs::path copy = fs::path("models") / (name + ".cameramodel");
  std::error_code reason;
  fs::create_directories(folder / "models", reason);
  if (reason)
    return error(ErrorCode::kIo, "cannot create '{}': {}; check the disk and its permissions",
                 (folder / "models").string(), reason.message());
  model = copy;
  return write_atomically(folder / copy, *text);
}

}  // namespace

Result<Session> Session::open(const fs::path& folder) {
  CS_TRY(Session session, open_unfinished(folder));
  for (const CameraSpec& camera : session.rig_.cameras)
    CS_TRY_VOID(check_photos(folder, session.rig_, camera, session.sequence_));
  return session;
}

Result<Session> Session::open_unfinished(const fs::path& folder) {
  std::error_code reason;
  if (!fs::is_directory(folder, reason))
    return error(ErrorCode::kBadFile, "session '{}' is missing or no folder; check the name", folder.string());
  Session session;
  session.folder_ = folder;
  CS_TRY_VOID(check_version(folder));
  CS_TRY(session.rig_, read_rig(folder / "rig.toml"));
  CS_TRY(session.sequence_, read_sequence(folder / "sequence.json"));
  CS_TRY_VOID(check_projectors(folder, session.rig_, session.sequence_));
  CS_TRY(session.unused_, read_unused(folder, session.rig_));
  return session;
}

fs::path Session::photo_path(const std::string& camera, int index) const {
  const Photos photos = list_photos(folder_of(folder_, rig_, camera));
  const auto found = photos.find(index);
  return found == photos.end() ? fs::path() : found->second.front().path;
}

Result<Photo> Session::photo(const std::string& camera, int index) const {
  const CameraSpec* spec = rig_.camera(camera);
  CS_CHECK(spec != nullptr, "the session has no camera '" + camera + "'");
  const Photos listed = list_photos(folder_of(folder_, rig_, camera));
  const auto found = listed.find(index);
  if (found == listed.end())
    return bad_session(folder_, fmt::format("photo {:04} of camera '{}' is missing; restore it", index, camera));
  std::vector<Photo> photos;
  for (const Stored& stored : found->second) {
    CS_TRY(Photo photo, read_photo(stored.path, *spec));
    const Image& first = photos.empty() ? photo.value : photos[0].value;
    if (!photo.value.same_size(first.width(), first.height()) || photo.value.channels() != first.channels())
      return bad_session(
          folder_, fmt::format("'{}' and '{}' differ in size", stored.path.string(), found->second[0].path.string()));
    if (stored.exposure_ms > 0) photo.exposure_ms = stored.exposure_ms;
    if (found->second.size() > 1 && !(photo.exposure_ms > 0))
      return bad_session(folder_,
                         fmt::format("'{}' does not say its exposure, as in 0007_8.0ms.png", stored.path.string()));
    photos.push_back(std::move(photo));
  }
  Photo merged = photos.size() == 1
                     ? std::move(photos[0])
                     : merge(photos, spec->exposures_ms.empty() ? photos[0].exposure_ms : spec->exposures_ms[0]);
  if (const auto unused = unused_.find(camera); unused != unused_.end()) invalidate(merged.valid, unused->second);
  return merged;
}

Result<Photo> read_photo(const fs::path& path, const CameraSpec& camera) {
  CS_TRY(StoredImage stored, read_image(path));
  CS_TRY(const Response response, Response::parse(camera.response));
  const double full = camera.full_scale.value_or(stored.full_scale), span = full - camera.pedestal;
  if (!(span > 0))
    return error(ErrorCode::kBadValue, "camera '{}': pedestal = {} must be less than full scale, {} in '{}'", camera.id,
                 camera.pedestal, full, path.string());
  const bool linear = camera.response == "linear";
  const double saturated = saturation(stored, camera);
  std::vector<float> table;
  if (!linear && stored.bits <= 16) table = light_table(response, camera.pedestal, span, stored.full_scale);
  Photo photo;
  photo.exposure_ms = camera.exposures_ms.size() == 1 ? camera.exposures_ms[0] : 0;
  photo.value = std::move(stored.values);
  photo.valid = Mask(photo.value.width(), photo.value.height(), 1, 1);
  const int channels = photo.value.channels();
  for (std::size_t i = 0; i < photo.value.data().size(); ++i) {
    float& v = photo.value.data()[i];
    if (!std::isfinite(v)) v = 0, photo.valid.data()[i / channels] = 0;
    if (v >= saturated) photo.valid.data()[i / channels] = 0;
    if (linear)
      v = static_cast<float>((v - camera.pedestal) / span);
    else
      v = table.empty() ? static_cast<float>(response.decode((v - camera.pedestal) / span))
                        : table[static_cast<int>(v)];
  }
  return photo;
}

Result<void> write_session_header(const fs::path& folder, const Rig& rig, const std::string& simulation_toml,
                                  const Sequence& sequence) {
  std::error_code reason;
  fs::create_directories(folder / "photos", reason);
  if (reason)
    return error(ErrorCode::kIo, "cannot create '{}': {}; check the disk and its permissions",
                 (folder / "photos").string(), reason.message());
  Rig own = rig;
  for (CameraSpec& camera : own.cameras)
    CS_TRY_VOID(copy_model(folder, fmt::format("camera '{}'", camera.id), camera.id, camera.model));
  for (ProjectorSpec& projector : own.projectors) {
    const bool taken = rig.camera(projector.id) != nullptr;
    CS_TRY_VOID(copy_model(folder, fmt::format("projector '{}'", projector.id),
                           projector.id + (taken ? ".projector" : ""), projector.model));
  }
  CS_TRY_VOID(write_atomically(folder / "rig.toml", canonical_rig_text(own)));
  if (!simulation_toml.empty()) CS_TRY_VOID(write_atomically(folder / "simulation.toml", simulation_toml));
  CS_TRY_VOID(write_atomically(folder / "sequence.json", sequence_text(sequence)));
  return write_atomically(folder / "session.json", "{\"format_version\": 1}\n");
}

Result<void> write_unused(const fs::path& folder, const UnusedParts& unused) {
  nlohmann::ordered_json cameras = nlohmann::ordered_json::object();
  for (const auto& [camera, polygons] : unused)
    for (const auto& polygon : polygons) {
      auto corners = nlohmann::ordered_json::array();
      for (const Eigen::Vector2d& q : polygon) corners.push_back({q.x(), q.y()});
      cameras[camera].push_back(corners);
    }
  return write_atomically(folder / "unused.json", nlohmann::ordered_json{{"cameras", cameras}}.dump() + "\n");
}

}  // namespace countershade
