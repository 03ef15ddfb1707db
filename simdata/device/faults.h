// What goes wrong on a real rig, done to a simulated one: each fault by name, with a strength and the photo from which
// it acts. The same faults do the same to the same room.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "calib/base/result.h"
#include "calib/geometry/pose.h"
#include "capture/device/device.h"

namespace countershade::simdata {

struct FaultKind {
  const char* name;
  const char* unit;  // of the value
  double value;      // by default
  double low, high;  // bounds, inclusive
  int photo;         // by default the first photo of a camera that it acts on
  const char* what;  // what it imitates
};
const std::vector<FaultKind>& fault_kinds();

struct Fault {
  const FaultKind* kind = nullptr;
  double value = 0;
  std::uint64_t photo = 0;
};

// "name", "name=value", "name=value@photo", several separated by commas. Errors: kBadValue: unknown name (gives the
// nearest), value that is no number or out of its range (gives the range).
Result<std::vector<Fault>> parse_faults(const std::string& text);

class Faults {
 public:
  Faults() = default;
  Faults(std::vector<Fault> faults, std::uint64_t seed) : faults_(std::move(faults)), seed_(seed) {}

  bool empty() const { return faults_.empty(); }
  // Which faults act on that photo, as a number: equal numbers, equal faults.
  std::uint64_t acting(std::uint64_t photo) const;
  // Whether the photo sees what was shown before the newest pictures.
  bool stale(std::uint64_t photo) const { return at(photo, "stale-frame"); }
  // The photo is the former one once more, under a new number.
  bool duplicated(std::uint64_t photo) const { return at(photo, "duplicated-frame"); }
  // Photos that the camera counts but never hands over, just before this one.
  int dropped(std::uint64_t photo) const;

  // Where the camera stands now, seen from where it stood: moved_from_camera; none where nobody touched it.
  std::optional<Pose> camera_move(std::uint64_t photo) const;
  // What the projectors really emit when they are sent these pictures.
  std::vector<Picture> emitted(std::vector<Picture> pictures, std::uint64_t photo) const;
  // What reaches the sensor, from the light of the room through the lens, (height, width, channels) full scale.
  void light(Image& light, std::uint64_t photo) const;
  // Factor on the exposure time that was asked for.
  double exposure_factor(const Image& light, std::uint64_t photo) const;
  // What arrives of the stored values.
  void arrived(capture::Exposure& exposure, std::uint64_t photo) const;

 private:
  // Value of a fault that acts on the photo, else 0.
  double value(std::uint64_t photo, const char* name) const;
  // Photos up to this one that a fault has acted on.
  std::uint64_t acted(std::uint64_t photo, const char* name) const;
  // Whether a fault of single photos acts on exactly this one.
  bool at(std::uint64_t photo, const char* name) const;

  std::vector<Fault> faults_;
  std::uint64_t seed_ = 0;
};

}  // namespace countershade::simdata
