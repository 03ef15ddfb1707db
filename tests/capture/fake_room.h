// Cameras and projectors for tests of the session runner: a photo is a function of the pictures shown, asymmetric in
// every index; latency, noise, wrong frames, failures and death can be planted.
#pragma once

#include <unistd.h>

#include <csignal>
#include <filesystem>
#include <fstream>
#include <functional>
#include <map>
#include <memory>
#include <string>

#include "calib/base/random.h"
#include "calib/file/file.h"
#include "calib/file/session.h"
#include "capture/device/device.h"

namespace countershade::capture::fake {

struct Room {
  std::map<std::string, std::vector<Picture>> shown;  // per projector, every picture so far
  int latency = 0;                                    // shows that pass before a picture is on the screen
  int frozen_after = -1;                              // shows per projector after which the display stands still
  double noise = 0;  // photon and read noise of a camera with this full well [e-]; 0 = none
  int shift_px = 0;  // how far the cameras have moved
  int bump_at = -1, bump_px = 0, bump_again = 0;  // trigger before which somebody pushes them; and every so many after
  double full_scale = 65535;
  double beside = 1;  // pictures from this share of their width on fall beside the screen, and nothing bounces
  int roll_at = -1, roll_px = 0;  // trigger from which pictures lie so many columns farther left, round and round
  int lamp_at = -1;               // trigger at which the lamp becomes lamp_to
  double lamp_to = 1;
  double lamp = 1, flicker = 0;  // brightness of everything, and its change between even and odd photos
  std::map<int, int> wrong;      // trigger number -> how many shows ago the photo was really taken
  int triggers = 0, events = 0;
  int die_at = -1;   // event (show or trigger) at which the process kills itself
  int fail_at = -1;  // trigger that fails

  void event() {
    if (events++ == die_at) raise(SIGKILL);
  }
};

class FakeProjector final : public Projector {
 public:
  FakeProjector(std::shared_ptr<Room> room, std::string id, int width, int height)
      : room_(std::move(room)), id_(std::move(id)), width_(width), height_(height) {}
  const std::string& id() const override { return id_; }
  int width() const override { return width_; }
  int height() const override { return height_; }
  Result<void> show(const Picture& picture) override {
    CS_CHECK(picture.same_size(width_, height_), "size");
    room_->event();
    room_->shown[id_].push_back(picture);
    return {};
  }

 private:
  std::shared_ptr<Room> room_;
  std::string id_;
  int width_, height_;
};

inline double mean_of(const Picture& picture) {
  double sum = 0;
  for (std::uint16_t value : picture.data()) sum += value / 65535.0;
  return sum / static_cast<double>(picture.data().size());
}

// Light of one projector's picture on a camera pixel, 0..1, and a tenth of its mean that bounced.
inline double light_on(const Picture& picture, double mean, int which, int x, int y, int width, int height,
                       double beside = 1, int roll_px = 0) {
  const double u = which == 0 ? x / (0.8 * width) : (x - 0.3 * width) / (0.7 * width), v = (y + 0.5) / height;
  const double bounced = beside < 1 ? 0 : (0.08 + 0.02 * which) * mean;
  if (u < 0 || u >= beside) return bounced;
  const int px = (static_cast<int>(u * picture.width()) + roll_px) % picture.width(),
            py = static_cast<int>(v * picture.height());
  const double encoded = picture.at(px, py, (x + y) % 3) / 65535.0;
  return bounced + (0.6 + 0.2 * u - 0.1 * v) * encoded * encoded;
}

class FakeCamera final : public Camera {
 public:
  FakeCamera(std::shared_ptr<Room> room, std::string id, int width, int height)
      : room_(std::move(room)), id_(std::move(id)), width_(width), height_(height) {}
  const std::string& id() const override { return id_; }
  Result<void> arm(double exposure_ms) override {
    exposure_ms_ = exposure_ms > 0 ? exposure_ms : 10;
    return {};
  }
  Result<Exposure> trigger() override {
    CS_CHECK(exposure_ms_ > 0, "armed");
    room_->event();
    const int number = room_->triggers++;
    if (number == room_->lamp_at) room_->lamp = room_->lamp_to;
    const int since = room_->bump_at < 0 ? -1 : number - room_->bump_at;
    if (since == 0 || (since > 0 && room_->bump_again > 0 && since % room_->bump_again == 0))
      room_->shift_px += room_->bump_px;
    if (number == room_->fail_at) return error(ErrorCode::kDevice, "camera '{}' was unplugged", id_);
    const auto wrong = room_->wrong.find(number);
    const int ago = room_->latency + (wrong == room_->wrong.end() ? 0 : wrong->second);
    Exposure exposure;
    exposure.values = Image(width_, height_, 1);
    exposure.full_scale = room_->full_scale;
    exposure.exposure_ms = exposure_ms_;
    exposure.timestamp_s = number;
    Random random(hash_name(id_) + static_cast<std::uint64_t>(number));
    const auto pictures = on_screen(ago);
    for (int y = 0; y < height_; ++y)
      for (int x = 0; x < width_; ++x) exposure.values.at(x, y) = static_cast<float>(value(x, y, pictures, random));
    return exposure;
  }

 private:
  using Shown = std::vector<std::pair<const Picture*, double>>;  // per projector: picture, mean
  Shown on_screen(int ago) const {
    Shown shown;
    for (const auto& [id, pictures] : room_->shown) {
      int last = static_cast<int>(pictures.size()) - 1;
      if (room_->frozen_after >= 0) last = std::min(last, room_->frozen_after);
      const Picture* picture = last - ago >= 0 ? &pictures[last - ago] : nullptr;
      shown.emplace_back(picture, picture ? mean_of(*picture) : 0);
    }
    return shown;
  }
  double value(int x, int y, const Shown& shown, Random& random) const {
    double light = 0.02;  // ambient
    for (std::size_t p = 0; p < shown.size(); ++p)
      if (shown[p].first)
        light += light_on(*shown[p].first, shown[p].second, static_cast<int>(p), x + room_->shift_px, y, width_,
                          height_, room_->beside, room_->triggers > room_->roll_at ? room_->roll_px : 0);
    light *= 0.5 * exposure_ms_ / 10 * (room_->lamp + (room_->triggers % 2 ? room_->flicker : 0));
    if (room_->noise > 0) light += random.normal() * std::sqrt(light * room_->noise + 25) / room_->noise;
    return std::round(std::clamp(light, 0.0, 1.0) * room_->full_scale);
  }
  std::shared_ptr<Room> room_;
  std::string id_;
  int width_, height_;
  double exposure_ms_ = 0;
};

inline Rig rig(int cameras = 1) {
  Rig rig;
  rig.cameras.resize(cameras);
  rig.cameras[0].id = "cam";
  if (cameras > 1) {
    rig.cameras[1].id = "side";
    rig.cameras[1].exposures_ms = {4, 12.5};
  }
  rig.projectors.resize(2);
  rig.projectors[0].id = "left";
  rig.projectors[0].resolution = {32, 20};
  rig.projectors[1].id = "right";
  rig.projectors[1].resolution = {24, 16};
  return rig;
}

// Two projectors, white, black, and pairs of Gray bits each; by itself one coarse and one fine: enough for every rule
// of the runner.
inline Sequence sequence(const std::vector<std::pair<std::string, int>>& axis_and_bit = {
                             {"x", 4}, {"y", 3}, {"x", 0}}) {
  Sequence s;
  s.projectors = {{"left", {32, 20}}, {"right", {24, 16}}};
  const auto add = [&](Role role) { s.frames.push_back({static_cast<int>(s.frames.size()), std::move(role)}); };
  for (const char* id : {"left", "right"}) {
    Role role;
    role.projector = id;
    for (const char* kind : {"white", "black"}) role.kind = kind, add(role);
    role.kind = "gray";
    for (const auto& [axis, bit] : axis_and_bit)
      for (bool inverse : {false, true}) role.axis = axis, role.bit = bit, role.inverse = inverse, add(role);
  }
  return s;
}

// Its first four frames: for tests that capture many times.
inline Sequence short_sequence() {
  Sequence s = sequence();
  s.frames.resize(4);
  return s;
}

inline Devices devices(const std::shared_ptr<Room>& room, const Rig& rig) {
  Devices all;
  for (std::size_t c = 0; c < rig.cameras.size(); ++c)
    all.cameras.push_back(std::make_unique<FakeCamera>(room, rig.cameras[c].id, c == 0 ? 64 : 40, c == 0 ? 48 : 56));
  for (const ProjectorSpec& p : rig.projectors)
    all.projectors.push_back(std::make_unique<FakeProjector>(room, p.id, p.resolution[0], p.resolution[1]));
  all.clock = [](double) {};  // waiting costs nothing
  return all;
}

// A folder of this test and process alone, removed at the end; in memory where there is a place for that, since
// hundreds of synced photos would take a minute on a busy disk.
class Scratch {
 public:
  explicit Scratch(const std::string& name)
      : path_((std::filesystem::is_directory("/dev/shm") ? "/dev/shm" : std::filesystem::temp_directory_path()) /
              ("countershade-" + name + "-" + std::to_string(getpid()))) {
    std::filesystem::remove_all(path_);
    std::filesystem::create_directories(path_);
  }
  ~Scratch() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  std::filesystem::path operator/(const std::string& name) const { return path_ / name; }

 private:
  std::filesystem::path path_;
};

inline std::string bytes_of(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

// Hash of every file below a folder by its relative name, hidden ones too.
inline std::map<std::string, std::string> tree(const std::filesystem::path& folder) {
  std::map<std::string, std::string> files;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder))
    files[std::filesystem::relative(entry.path(), folder).string()] =
        entry.is_regular_file() ? hash_text(bytes_of(entry.path())) : "";
  return files;
}

}  // namespace countershade::capture::fake
