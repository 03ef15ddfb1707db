#include "capture/device/edid.h"

#include <algorithm>
#include <fstream>
#include <iterator>
#include <numeric>
#include <vector>

#include <fmt/format.h>

namespace countershade::capture {

namespace fs = std::filesystem;

namespace {

constexpr std::size_t kBlock = 128, kFirstDescriptor = 54, kDescriptor = 18, kDescriptors = 4;
constexpr std::uint8_t kSerialText = 0xff, kName = 0xfc;

// Text of the descriptor of this kind; control characters and blanks around it left out.
std::string text_of(std::span<const std::uint8_t> block, std::uint8_t kind) {
  for (std::size_t i = 0; i < kDescriptors; ++i) {
    const auto d = block.subspan(kFirstDescriptor + i * kDescriptor, kDescriptor);
    if (d[0] != 0 || d[1] != 0 || d[2] != 0 || d[3] != kind) continue;
    std::string text;
    for (const std::uint8_t c : d.subspan(5)) {
      if (c == '\n') break;
      if (c >= ' ' && c <= '~') text += static_cast<char>(c);
    }
    const auto first = text.find_first_not_of(' '), last = text.find_last_not_of(' ');
    return first == std::string::npos ? "" : text.substr(first, last - first + 1);
  }
  return "";
}

std::vector<std::uint8_t> bytes_of(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

// "card0-HDMI-A-1" is "HDMI-1" to the window system, or "HDMI-A-1".
bool is_output(const std::string& connector, const std::string& output) {
  const auto dash = connector.find('-');
  if (!connector.starts_with("card") || dash == std::string::npos) return false;
  std::string name = connector.substr(dash + 1);
  if (name == output) return true;
  if (const auto a = name.find("-A-"); a != std::string::npos) name.erase(a, 2);
  return name == output;
}

}  // namespace

std::string Edid::name() const {
  return maker + " " + model + (serial.empty() ? "" : " " + serial);
}

std::optional<Edid> parse_edid(std::span<const std::uint8_t> bytes) {
  constexpr std::uint8_t kHeader[] = {0, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0};
  if (bytes.size() < kBlock || !std::equal(std::begin(kHeader), std::end(kHeader), bytes.begin())) return std::nullopt;
  const auto block = bytes.first(kBlock);
  if (std::accumulate(block.begin(), block.end(), 0u) % 256 != 0) return std::nullopt;
  Edid edid;
  const unsigned letters = block[8] * 256u + block[9];
  for (const int shift : {10, 5, 0}) {
    const unsigned letter = (letters >> shift) & 31;
    edid.maker += letter >= 1 && letter <= 26 ? static_cast<char>('A' + letter - 1) : '?';
  }
  edid.model = text_of(block, kName);
  if (edid.model.empty()) edid.model = fmt::format("{:04X}", block[11] * 256u + block[10]);
  edid.serial = text_of(block, kSerialText);
  const unsigned number = block[15] * 16777216u + block[14] * 65536u + block[13] * 256u + block[12];
  if (edid.serial.empty() && number != 0) edid.serial = fmt::format("{}", number);
  return edid;
}

std::string name_on_output(const std::string& output, const fs::path& drm) {
  std::string found;
  std::error_code reason;
  for (const auto& entry : fs::directory_iterator(drm, reason)) {
    if (!is_output(entry.path().filename().string(), output)) continue;
    const auto edid = parse_edid(bytes_of(entry.path() / "edid"));
    if (!edid) continue;
    if (!found.empty()) return "";
    found = edid->name();
  }
  return found;
}

}  // namespace countershade::capture
