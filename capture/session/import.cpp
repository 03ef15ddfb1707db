// import_session: photos that someone else took, checked, then copied into a session.
#include <algorithm>
#include <array>
#include <charconv>
#include <map>
#include <optional>
#include <set>

#include "calib/base/parallel.h"
#include "calib/file/file.h"
#include "calib/image/image_file.h"
#include "capture/diagnose/diagnose.h"
#include "capture/session/frame_check.h"
#include "capture/session/identify.h"
#include "capture/session/runner.h"
#include "capture/session/session_folder.h"

namespace countershade::capture {

namespace fs = std::filesystem;

namespace {

constexpr double kBlack = 0.01;     // brightest value of a photo, fraction of full scale, below which nothing was seen
constexpr double kSaturated = 0.5;  // share of saturated pixels of a white frame
constexpr double kNoPair = -0.5;    // correlation of a pattern and its inverse: -1 for a true pair, 0 for strangers
constexpr double kVisible = 0.15;   // contrast of a pattern in binned photos that makes the correlation a judgement

struct PhotoFile {
  std::size_t camera = 0;
  int position = 0;      // in the sequence
  std::string exposure;  // "8.0ms" or empty
  fs::path path;
  int width = 0, height = 0, channels = 0;
  Bins bins;
  std::optional<Error> failure;
};

// Index and exposure of "0007.png" or "0007_8.0ms.png"; nothing for other names.
std::optional<std::pair<int, std::string>> parse_name(const fs::path& path) {
  const std::string stem = path.stem().string();
  const char* end = stem.data() + stem.size();
  int index = 0;
  const auto number = std::from_chars(stem.data(), end, index);
  if (number.ec != std::errc() || stem[0] == '-') return std::nullopt;
  if (number.ptr == end) return std::pair(index, std::string());
  double exposure = 0;
  if (*number.ptr != '_') return std::nullopt;
  const auto rest = std::from_chars(number.ptr + 1, end, exposure);
  if (rest.ec != std::errc() || std::string(rest.ptr, end) != "ms" || exposure <= 0) return std::nullopt;
  return std::pair(index, exposure_text(exposure));
}

bool is_photo_type(const fs::path& path) {
  std::string extension = path.extension().string();
  std::transform(extension.begin(), extension.end(), extension.begin(),
                 [](unsigned char c) { return std::tolower(c); });
  return extension == ".png" || extension == ".tif" || extension == ".tiff" || extension == ".exr";
}

class Import {
 public:
  Import(const Rig& rig, const Sequence& sequence, const fs::path& photos, Progress& progress)
      : rig_(rig), sequence_(sequence), photos_(photos), progress_(progress) {}

  Result<void> find();
  Result<void> read();
  Result<void> check_content() const;
  Result<void> copy_to(const fs::path& folder) const;
  const UnusedParts& unused() const { return unused_; }

 private:
  using Found = std::map<std::pair<int, std::string>, fs::path>;  // index and exposure of each photo of a camera
  std::string frame_name(int position) const {
    return fmt::format("frame {} ({})", sequence_.frames[position].index, sequence_.frames[position].role.name());
  }
  Result<fs::path> folder_of(const CameraSpec& camera) const;
  Result<Found> scan(const fs::path& folder);
  Result<void> match(std::size_t camera, const fs::path& folder, const Found& found);
  Result<void> identify(std::size_t camera, const fs::path& folder);
  std::string hint() const;
  Error missing(const fs::path& folder, int position, const std::string& exposure, int count, std::size_t of) const;
  const PhotoFile* first(std::size_t camera, int position) const;
  Result<void> check_light(std::size_t camera) const;
  Result<void> check_white_seen() const;
  Result<void> check_order(std::size_t camera) const;
  std::string diagnosis(std::size_t camera) const;
  Result<void> check_pair(std::size_t camera, int position, const Companions& with) const;

  const Rig& rig_;
  const Sequence& sequence_;
  const fs::path& photos_;
  Progress& progress_;
  std::vector<PhotoFile> files_;
  std::set<std::string> other_types_;  // extensions seen that are no photos to us
  int other_names_ = 0;                // photos whose names are no frame's number
  UnusedParts unused_;
};

// ---- which files there are ----

Result<fs::path> Import::folder_of(const CameraSpec& camera) const {
  if (!fs::is_directory(photos_))
    return error(ErrorCode::kBadFile, "there is no folder '{}': give the folder that holds the photos",
                 photos_.string());
  if (fs::is_directory(photos_ / camera.id)) return photos_ / camera.id;
  if (rig_.cameras.size() == 1) return photos_;
  return error(ErrorCode::kBadFile,
               "there is no folder '{}' with the photos of camera '{}': with several cameras each has "
               "its own",
               (photos_ / camera.id).string(), camera.id);
}

Result<Import::Found> Import::scan(const fs::path& folder) {
  Found found;
  std::vector<fs::path> paths;
  for (const auto& entry : fs::directory_iterator(folder))
    if (entry.is_regular_file()) paths.push_back(entry.path());
  std::sort(paths.begin(), paths.end());
  for (const fs::path& path : paths) {
    const auto name = parse_name(path);
    if (!name) {
      other_names_ += is_photo_type(path);
      continue;
    }
    if (!is_photo_type(path)) {
      other_types_.insert(path.extension().string());
      continue;
    }
    const auto [place, fresh] = found.emplace(*name, path);
    if (!fresh)
      return error(ErrorCode::kBadFile, "'{}' and '{}' are both photo {}: remove one", place->second.string(),
                   path.string(), name->first);
  }
  return found;
}

std::string Import::hint() const {
  std::string text;
  for (const std::string& type : other_types_)
    text += fmt::format(" ('{}' files are not read: convert them without loss)", type);
  if (other_names_ > 0)
    text += fmt::format(
        " (the names of {} others are no frame's number, as they may be for pictures with marks of identity: name the "
        "sequence.json that lies beside them)",
        other_names_);
  return text;
}

Error Import::missing(const fs::path& folder, int position, const std::string& exposure, int count,
                      std::size_t of) const {
  return error(
      ErrorCode::kBadFile,
      "'{}' has no photo of {}: expected {}, .tif or .exr; {} of {} photos are missing{}. Photograph them, or name "
      "the sequence that these photos follow",
      folder.string(), frame_name(position), photo_name(sequence_.frames[position].index, exposure, ".png"), count, of,
      hint());
}

Result<void> Import::match(std::size_t camera, const fs::path& folder, const Found& found) {
  std::set<std::string> exposures;
  std::set<int> indices;
  for (const Frame& frame : sequence_.frames) indices.insert(frame.index);
  int unused = 0;
  for (const auto& [key, path] : found) {
    if (indices.count(key.first))
      exposures.insert(key.second);
    else
      ++unused;
  }
  if (exposures.empty()) exposures.insert("");
  int absent = 0;
  std::optional<std::pair<int, std::string>> first_absent;
  for (int position = 0; position < static_cast<int>(sequence_.frames.size()); ++position)
    for (const std::string& exposure : exposures) {
      const auto file = found.find({sequence_.frames[position].index, exposure});
      if (file != found.end()) {
        files_.push_back({camera, position, exposure, file->second, 0, 0, 0, {}, {}});
        continue;
      }
      ++absent;
      if (!first_absent) first_absent = std::pair(position, exposure);
    }
  if (first_absent)
    return missing(folder, first_absent->first, first_absent->second, absent,
                   sequence_.frames.size() * exposures.size());
  if (unused > 0)
    progress_.warn(fmt::format("'{}' holds {} photos that no frame of the sequence asks for; is it the right sequence?",
                               folder.string(), unused));
  return {};
}

// Photos of pictures that say themselves which frame they are.
Result<void> Import::identify(std::size_t camera, const fs::path& folder) {
  std::vector<fs::path> paths;
  for (const auto& entry : fs::directory_iterator(folder)) {
    if (!entry.is_regular_file()) continue;
    if (is_photo_type(entry.path()))
      paths.push_back(entry.path());
    else
      other_types_.insert(entry.path().extension().string());
  }
  if (paths.empty())
    return error(ErrorCode::kBadFile, "'{}' holds no photos (.png, .tif, .exr){}", folder.string(), hint());
  std::sort(paths.begin(), paths.end(), natural_less);
  CS_TRY(const Identified found, identify_photos(sequence_, paths, rig_.cameras[camera], progress_));
  const std::string counts = fmt::format(
      "camera '{}' sees {} marks of identity; of {} photos {} show two frames, and in {} no mark of some projector can "
      "be read",
      rig_.cameras[camera].id, found.marks, paths.size(), found.mixed, found.unread);
  std::vector<std::string> absent;
  for (int position = 0; position < static_cast<int>(sequence_.frames.size()); ++position) {
    if (found.photos[position].empty())
      absent.push_back(frame_name(position));
    else
      files_.push_back({camera, position, "", found.photos[position], 0, 0, 0, {}, {}});
  }
  progress_.note(counts);
  unused_[rig_.cameras[camera].id] = found.unused;
  if (absent.empty()) return {};
  constexpr std::size_t kNamed = 5;
  const std::size_t more = absent.size() - std::min(absent.size(), kNamed);
  absent.resize(absent.size() - more);
  return error(ErrorCode::kBadFile,
               "no photo in '{}' shows {}{} alone ({}). Show these pictures for longer than two exposures, photograph "
               "them, put the photos to the others, and import again",
               folder.string(), fmt::join(absent, ", "), more > 0 ? fmt::format(" and {} more", more) : "", counts);
}

Result<void> Import::find() {
  for (std::size_t c = 0; c < rig_.cameras.size(); ++c) {
    CS_TRY(const fs::path folder, folder_of(rig_.cameras[c]));
    if (!sequence_.identity.empty()) {
      CS_TRY_VOID(identify(c, folder));
      continue;
    }
    CS_TRY(const Found found, scan(folder));
    CS_TRY_VOID(match(c, folder, found));
  }
  return {};
}

// ---- what is in them ----

void read_file(PhotoFile& file, const CameraSpec& camera) {
  auto read = read_image(file.path);
  if (!read) {
    file.failure = read.error();
    return;
  }
  file.width = read->values.width(), file.height = read->values.height(), file.channels = read->values.channels();
  file.bins = bin_photo(read->values, read->full_scale, camera);
}

Result<void> Import::read() {
  constexpr std::size_t kChunk = 16;  // photos in memory at a time
  const double total = static_cast<double>(files_.size());
  for (std::size_t begin = 0; begin < files_.size(); begin += kChunk) {
    progress_.step("import", static_cast<double>(begin), total);
    const std::size_t count = std::min(kChunk, files_.size() - begin);
    parallel_for(static_cast<int>(count), [&](int i) {
      PhotoFile& file = files_[begin + i];
      read_file(file, rig_.cameras[file.camera]);
    });
  }
  std::vector<const PhotoFile*> reference(rig_.cameras.size());
  for (const PhotoFile& file : files_) {
    if (file.failure) return *file.failure;
    const PhotoFile*& one = reference[file.camera];
    if (one == nullptr) one = &file;
    if (file.width != one->width || file.height != one->height || file.channels != one->channels)
      return error(
          ErrorCode::kBadFile,
          "'{}' has {}x{} pixels and {} channels but '{}' has {}x{} and {}: all photos of a camera have one size; "
          "take it again",
          file.path.string(), file.width, file.height, file.channels, one->path.string(), one->width, one->height,
          one->channels);
  }
  progress_.step("import", total, total);
  return {};
}

// The photo of a frame that is judged: its shortest exposure.
const PhotoFile* Import::first(std::size_t camera, int position) const {
  const PhotoFile* best = nullptr;
  const auto milliseconds = [](const PhotoFile& f) { return f.exposure.empty() ? 0.0 : std::stod(f.exposure); };
  for (const PhotoFile& file : files_)
    if (file.camera == camera && file.position == position)
      if (best == nullptr || milliseconds(file) < milliseconds(*best)) best = &file;
  return best;
}

// ---- whether they can be what the sequence says ----

Result<void> Import::check_light(std::size_t camera) const {
  double brightest = 0;
  for (const PhotoFile& file : files_)
    if (file.camera == camera) brightest = std::max(brightest, file.bins.brightest);
  if (brightest < kBlack)
    return error(
        ErrorCode::kRefused,
        "all photos of camera '{}' are black: the brightest value is {:.2f} % of full scale, at least {:.0f} % is "
        "needed. Check lens cap, exposure, and full_scale and pedestal in the rig",
        rig_.cameras[camera].id, 100 * brightest, 100 * kBlack);
  for (int position = 0; position < static_cast<int>(sequence_.frames.size()); ++position) {
    const PhotoFile& file = *first(camera, position);
    if (sequence_.frames[position].role.kind == "white" && file.bins.saturated > kSaturated)
      return error(
          ErrorCode::kRefused,
          "'{}' is saturated: {:.0f} % of its pixels are at full scale, at most {:.0f} % may be. It is {}: expose "
          "shorter and photograph all frames again",
          file.path.string(), 100 * file.bins.saturated, 100 * kSaturated, frame_name(position));
  }
  return {};
}

// A white frame may be dark for a camera that does not see that projector, not for all cameras.
Result<void> Import::check_white_seen() const {
  for (int position = 0; position < static_cast<int>(sequence_.frames.size()); ++position) {
    if (sequence_.frames[position].role.kind != "white") continue;
    double brightest = 0;
    for (const PhotoFile& file : files_)
      if (file.position == position) brightest = std::max(brightest, file.bins.brightest);
    if (brightest < kBlack)
      return error(
          ErrorCode::kRefused,
          "'{}' is black: its brightest value is {:.2f} % of full scale, at least {:.0f} % is needed. It should be "
          "{}: check that the photos are in the order of the sequence and that the projector was on",
          first(0, position)->path.string(), 100 * brightest, 100 * kBlack, frame_name(position));
  }
  return {};
}

Result<void> Import::check_pair(std::size_t camera, int position, const Companions& with) const {
  const PhotoFile& one = *first(camera, position);
  const PhotoFile& other = *first(camera, with.inverse);
  const PairLaw law = pair_law(first(camera, with.white)->bins, first(camera, with.black)->bins, one.bins, other.bins);
  if (law.contrast < kVisible || law.correlation < kNoPair) return {};
  return error(
      ErrorCode::kRefused,
      "'{}' and '{}' are not a pattern and its inverse, as {} and {} should be: what is bright in one must be dark "
      "in the other (correlation {:.2f}, at most {:.1f} allowed). Check that the photos are in the order of the "
      "sequence",
      one.path.string(), other.path.string(), frame_name(position), frame_name(with.inverse), law.correlation, kNoPair);
}

Result<void> Import::check_order(std::size_t camera) const {
  for (int position = 0; position < static_cast<int>(sequence_.frames.size()); ++position) {
    const Role& role = sequence_.frames[position].role;
    const Companions with = companions(sequence_, position);
    if (with.white < 0 || with.black < 0) continue;
    const PhotoFile &white = *first(camera, with.white), &black = *first(camera, with.black);
    const double gain = mean_light(white.bins) - mean_light(black.bins);
    // Noise of a whole photo's mean is below a thousandth of full scale; a camera that does not see the projector: 0.
    if (role.kind == "white" && gain < -0.001)
      return error(
          ErrorCode::kRefused,
          "'{}' is darker than '{}' though it should be {} and the other {}: the photos are not in the order of "
          "the sequence",
          white.path.string(), black.path.string(), frame_name(with.white), frame_name(with.black));
    const bool second_of_pair = with.inverse >= 0 && with.inverse < position;
    if (second_of_pair && gain > 0.002) CS_TRY_VOID(check_pair(camera, position, with));
  }
  return {};
}

// What order the photos of a camera are in, where it is not that of the sequence.
std::string Import::diagnosis(std::size_t camera) const {
  const PhotoSource photos = [&](int index) -> Result<Photo> {
    for (int position = 0; position < static_cast<int>(sequence_.frames.size()); ++position)
      if (sequence_.frames[position].index == index)
        return read_photo(first(camera, position)->path, rig_.cameras[camera]);
    return error(ErrorCode::kBadFile, "no frame has index {}", index);
  };
  std::string text;
  for (const auto& [id, resolution] : sequence_.projectors) {
    Suspect suspect{rig_.cameras[camera].id, id};
    suspect.response = rig_.cameras[camera].response, suspect.photos_too = false;
    const std::string found = text_of(diagnose(sequence_, photos, suspect));
    if (!found.empty()) text += (text.empty() ? "" : " ") + found;
  }
  return text;
}

Result<void> Import::check_content() const {
  for (std::size_t c = 0; c < rig_.cameras.size(); ++c) CS_TRY_VOID(check_light(c));
  for (std::size_t c = 0; c < rig_.cameras.size(); ++c)
    if (const auto checked = check_order(c); !checked) {
      const std::string why = diagnosis(c);
      if (why.empty()) return checked;
      return error(checked.error().code, "{}. {}", checked.error().message, why);
    }
  return check_white_seen();
}

Result<void> Import::copy_to(const fs::path& folder) const {
  for (const PhotoFile& file : files_) {
    const fs::path target =
        folder / "photos" / rig_.cameras[file.camera].id /
        photo_name(sequence_.frames[file.position].index, file.exposure, file.path.extension().string());
    std::error_code reason;
    fs::create_directories(target.parent_path(), reason);
    if (!reason) fs::copy_file(file.path, target, reason);
    if (reason)
      return error(ErrorCode::kIo, "'{}' cannot be copied to '{}': {}; check the disk and its permissions",
                   file.path.string(), target.string(), reason.message());
  }
  return {};
}

}  // namespace

Result<void> import_session(const Rig& rig, const Sequence& sequence, const fs::path& photos, const fs::path& folder,
                            Progress& progress, const FillFolder& record) {
  CS_TRY_VOID(check_sequence(rig, sequence));
  if (fs::exists(folder))
    return error(ErrorCode::kExists, "'{}' exists already: choose another name for the session, or remove it",
                 folder.string());
  Import import(rig, sequence, photos, progress);
  CS_TRY_VOID(import.find());
  CS_TRY_VOID(import.read());
  CS_TRY_VOID(import.check_content());
  return create_folder_atomically(
      folder,
      [&](const fs::path& draft) -> Result<void> {
        CS_TRY_VOID(write_session_header(draft, rig, "", sequence));
        if (!import.unused().empty()) CS_TRY_VOID(write_unused(draft, import.unused()));
        return import.copy_to(draft);
      },
      record);
}

}  // namespace countershade::capture
