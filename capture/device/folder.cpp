#include "capture/device/folder.h"

#include <algorithm>
#include <charconv>
#include <chrono>
#include <map>
#include <optional>
#include <thread>

#include "calib/image/image_file.h"

namespace countershade::capture {

namespace fs = std::filesystem;

namespace {

using Clock = std::chrono::steady_clock;

double seconds_since(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

// Files NNNN.<type> of a folder by number.
std::map<int, fs::path> numbered_files(const fs::path& folder, const std::vector<std::string>& types) {
  std::map<int, fs::path> files;
  std::error_code reason;
  for (const auto& entry : fs::directory_iterator(folder, reason)) {
    const std::string stem = entry.path().stem().string();
    int number = 0;
    const auto parsed = std::from_chars(stem.data(), stem.data() + stem.size(), number);
    const bool type = std::find(types.begin(), types.end(), entry.path().extension().string()) != types.end();
    if (type && parsed.ec == std::errc() && parsed.ptr == stem.data() + stem.size() && number >= 0)
      files[number] = entry.path();
  }
  return files;
}

class FolderCamera final : public Camera {
 public:
  FolderCamera(std::string id, fs::path folder, const FolderCameraOptions& options)
      : id_(std::move(id)), folder_(std::move(folder)), options_(options) {}

  const std::string& id() const override { return id_; }

  Result<void> arm(double exposure_ms) override {
    if (!(exposure_ms >= 0))
      return error(ErrorCode::kBadValue, "camera '{}': exposure of {} ms; it must be positive, or 0 for the default",
                   id_, exposure_ms);
    armed_ = true;
    exposure_ms_ = exposure_ms > 0 ? exposure_ms : options_.exposure_ms;
    return {};
  }

  Result<Exposure> trigger() override {
    CS_CHECK(armed_, "trigger() before arm()");
    const auto start = Clock::now();
    std::optional<Error> unreadable;
    do {
      const auto files = numbered_files(folder_, {".png", ".tif", ".tiff", ".exr"});
      const auto file = next_ ? files.find(*next_) : files.begin();
      if (file != files.end()) {
        auto read = read_image(file->second);  // a photo that is still growing is truncated, and tried again
        if (read) return exposure_of(std::move(*read), file->first, seconds_since(opened_));
        unreadable = read.error();
      }
      std::this_thread::sleep_for(std::chrono::duration<double>(options_.poll_s));
    } while (seconds_since(start) < options_.timeout_s);
    if (unreadable)
      return error(ErrorCode::kDevice, "camera '{}': {} (waited {} s)", id_, unreadable->message, options_.timeout_s);
    return error(
        ErrorCode::kDevice,
        "camera '{}': no photo {:04}.png, .tif or .exr came into '{}' within {} s: check the program that writes "
        "them",
        id_, next_.value_or(0), folder_.string(), options_.timeout_s);
  }

 private:
  Exposure exposure_of(StoredImage image, int number, double time_s) {
    next_ = number + 1;
    Exposure exposure;
    exposure.full_scale = image.full_scale;
    exposure.exposure_ms = exposure_ms_;
    exposure.timestamp_s = time_s;
    exposure.counter = static_cast<std::uint64_t>(number);
    std::size_t saturated = 0;
    for (std::size_t i = 0; i < image.values.pixels(); ++i) {
      const float* p = image.values.data().data() + i * image.values.channels();
      saturated += *std::max_element(p, p + image.values.channels()) >= 0.995 * image.full_scale;
    }
    exposure.saturated = static_cast<double>(saturated) / std::max<std::size_t>(1, image.values.pixels());
    exposure.values = std::move(image.values);
    return exposure;
  }

  std::string id_;
  fs::path folder_;
  FolderCameraOptions options_;
  Clock::time_point opened_ = Clock::now();
  bool armed_ = false;
  double exposure_ms_ = 0;
  std::optional<int> next_;
};

class FolderProjector final : public Projector {
 public:
  FolderProjector(std::string id, int width, int height, fs::path folder, int next)
      : id_(std::move(id)), width_(width), height_(height), folder_(std::move(folder)), next_(next) {}

  const std::string& id() const override { return id_; }
  int width() const override { return width_; }
  int height() const override { return height_; }

  Result<void> show(const Picture& picture) override {
    CS_CHECK(picture.same_size(width_, height_) && picture.channels() == 3,
             "a picture in the projector's own resolution, RGB");
    CS_TRY_VOID(write_picture(folder_ / fmt::format("{:04}.png", next_), picture, 8));
    ++next_;
    return {};
  }

 private:
  std::string id_;
  int width_, height_;
  fs::path folder_;
  int next_;
};

}  // namespace

Result<std::unique_ptr<Camera>> open_folder_camera(const std::string& id, const fs::path& folder,
                                                   const FolderCameraOptions& options) {
  if (!fs::is_directory(folder))
    return error(ErrorCode::kBadFile,
                 "camera '{}': there is no folder '{}' to take photos from: create it, or correct "
                 "`device` in the rig",
                 id, folder.string());
  return std::unique_ptr<Camera>(std::make_unique<FolderCamera>(id, folder, options));
}

Result<std::unique_ptr<Projector>> open_folder_projector(const std::string& id, int width, int height,
                                                         const fs::path& folder) {
  std::error_code reason;
  fs::create_directories(folder, reason);
  if (reason)
    return error(ErrorCode::kIo,
                 "projector '{}': folder '{}' cannot be created: {}; check the disk and its permissions", id,
                 folder.string(), reason.message());
  const auto files = numbered_files(folder, {".png"});
  const int next = files.empty() ? 0 : files.rbegin()->first + 1;
  return std::unique_ptr<Projector>(std::make_unique<FolderProjector>(id, width, height, folder, next));
}

}  // namespace countershade::capture
