// What a monitor or projector says of itself (EDID 1.4), wherever it is plugged in.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>

namespace countershade::capture {

struct Edid {
  std::string maker;   // three letters of the PNP registry, e.g. "EPS"
  std::string model;   // its name, or the number of the product where it has none
  std::string serial;  // as text, or as a number; empty where it has none

  std::string name() const;  // "EPS EB-L1755U X4KJ930"
};

// Nothing for fewer than 128 bytes, another header or a wrong checksum.
std::optional<Edid> parse_edid(std::span<const std::uint8_t> bytes);

// Name of what hangs on an output of this computer, as Linux's DRM tells below `drm`; empty where it does not, or where
// outputs of several graphics cards have that name. output: as the window system calls it ("HDMI-1" is "HDMI-A-1").
std::string name_on_output(const std::string& output, const std::filesystem::path& drm = "/sys/class/drm");

}  // namespace countershade::capture
