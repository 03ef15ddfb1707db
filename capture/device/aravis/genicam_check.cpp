#include "capture/device/aravis/genicam_check.h"

#ifdef COUNTERSHADE_ARAVIS

#include <arv.h>

#include <algorithm>
#include <charconv>
#include <map>
#include <optional>
#include <set>
#include <vector>

#include "capture/device/aravis/camera_memory.h"

namespace countershade::capture {

namespace {

constexpr std::uint64_t kLargest = 8 << 20;           // bytes of a description; those of today's cameras have 1 MB
constexpr std::uint64_t kLargestUnpacked = 32 << 20;  // of one that is zipped
constexpr int kDeepest = 200;
constexpr double kMostWays = 1e6;

using Bytes = std::vector<std::uint8_t>;

// Where a description lies ("Local:camera.zip;10000;2f5a"; GigE Vision 2.0, 16.5 and 28.2).
struct Place {
  std::string text;
  std::optional<std::uint64_t> at, size;
  bool zipped = false;
};
Place place_of(const Bytes& register_text) {
  Place place;
  place.text.assign(register_text.begin(), std::find(register_text.begin(), register_text.end(), 0));
  // As Aravis reads it: small letters, blanks left out, the last two parts are numbers, whatever stands before.
  std::string url = place.text;
  std::transform(url.begin(), url.end(), url.begin(), g_ascii_tolower);
  std::erase_if(url, [](char c) { return g_ascii_isspace(c); });
  const std::size_t last = url.rfind(';'),
                    middle = last == std::string::npos || last == 0 ? last : url.rfind(';', last - 1);
  const auto hex = [](std::string digits) -> std::optional<std::uint64_t> {
    if (digits.starts_with("0x")) digits.erase(0, 2);
    std::uint64_t value = 0;
    const auto read = std::from_chars(digits.data(), digits.data() + digits.size(), value, 16);
    if (read.ec == std::errc::result_out_of_range) return UINT64_MAX;
    if (read.ec != std::errc()) return std::nullopt;
    return value;
  };
  if (last == std::string::npos || middle == std::string::npos || middle == last || !url.starts_with("local:"))
    return place;
  place.at = hex(url.substr(middle + 1, last - middle - 1)), place.size = hex(url.substr(last + 1));
  place.zipped = url.substr(0, middle).ends_with(".zip");
  return place;
}

// Why Aravis cannot unpack an archive; it believes every number in it. Numbers are little-endian (PKWARE's APPNOTE).
std::optional<std::string> damage(const Bytes& zip) {
  const auto number = [&](std::uint64_t at, int bytes) {
    std::uint64_t value = 0;
    for (int i = bytes - 1; i >= 0; --i) value = value << 8 | zip[at + i];
    return value;
  };
  const std::uint64_t size = zip.size();
  std::uint64_t end = size < 22 ? 0 : size - 22;
  for (; end > 0 && number(end, 4) != 0x06054b50;) --end;
  if (end == 0) return "it has no directory";
  const std::uint64_t files = number(end + 10, 2), length = number(end + 12, 4), offset = number(end + 16, 4);
  // What stands behind the last directory may look like one; Aravis would take it.
  for (std::uint64_t i = end + 1; i + 4 <= size; ++i)
    if (number(i, 4) == 0x06054b50) return "its directory is cut short";
  if (files == 0 || offset + length > end) return "its directory is not where it says";
  const std::uint64_t before = end - offset - length;  // bytes in front of the archive
  std::uint64_t at = before + offset;
  for (std::uint64_t i = 0; i < files; ++i) {
    if (at + 46 > size || number(at, 4) != 0x02014b50) return "its directory is cut short";
    const std::uint64_t packed = number(at + 20, 4), unpacked = number(at + 24, 4), file = before + number(at + 42, 4);
    const std::uint64_t next = at + 46 + number(at + 28, 2) + number(at + 30, 2) + number(at + 32, 2);
    if (next > size) return "its directory is cut short";
    if (unpacked > kLargestUnpacked)
      return fmt::format("it would be {} MB unpacked, more than {}", unpacked >> 20, kLargestUnpacked >> 20);
    if (file + 30 > size || number(file, 4) != 0x04034b50 ||
        file + 30 + number(file + 26, 2) + number(file + 28, 2) + packed > size)
      return "a file in it is not where its directory says";
    at = next;
  }
  return std::nullopt;
}

// What Aravis is asked for here, by whichever name cameras have it.
constexpr const char* kAsked[] = {"Width",        "Height",        "PixelFormat",      "PayloadSize",
                                  "ExposureTime", "ExposureAuto",  "AcquisitionStart", "AcquisitionStop",
                                  "TriggerMode",  "TriggerSource", "TriggerSoftware",  "AcquisitionMode",
                                  "GainAuto",     "GammaEnable",   "BalanceWhiteAuto", "ExposureTimeAbs"};

struct References {
  std::map<std::string, std::set<std::string>> to;      // nodes by name, with those that are evaluated for each
  std::map<std::string, std::set<std::string>> values;  // of these, those that hold the node's value
  std::set<std::string> nodes;
};

std::string text_of(ArvDomNode* node) {
  std::string text;
  for (ArvDomNode* child = arv_dom_node_get_first_child(node); child; child = arv_dom_node_get_next_sibling(child))
    if (const char* value = arv_dom_node_get_node_value(child)) text += value;
  const std::size_t from = text.find_first_not_of(" \t\r\n"), to = text.find_last_not_of(" \t\r\n");
  return from == std::string::npos ? "" : text.substr(from, to - from + 1);
}

bool is_evaluated(const std::string& tag) {
  static const std::set<std::string> kOther = {"pFeature", "pPort",      "pInvalidator", "pSelected", "pSelecting",
                                               "pAlias",   "pCastAlias", "pEventID",     "pError"};
  return tag.size() > 1 && tag[0] == 'p' && g_ascii_isupper(tag[1]) && !kOther.contains(tag);
}

void collect(ArvDomNode* parent, const std::string& owner, References& references) {
  for (ArvDomNode* node = arv_dom_node_get_first_child(parent); node; node = arv_dom_node_get_next_sibling(node)) {
    const char* tag_or_null = arv_dom_node_get_node_name(node);
    const std::string tag = tag_or_null ? tag_or_null : "";
    if (ARV_IS_GC_PROPERTY_NODE(node)) {
      if (is_evaluated(tag)) references.to[owner].insert(text_of(node));
      if (tag == "pValue") references.values[owner].insert(text_of(node));
      continue;
    }
    const char* name = ARV_IS_GC_FEATURE_NODE(node) ? arv_gc_feature_node_get_name(ARV_GC_FEATURE_NODE(node)) : nullptr;
    if (name == nullptr || tag == "EnumEntry") {
      collect(node, owner, references);
      continue;
    }
    references.nodes.insert(name);
    if (tag == "StructEntry") references.to[name].insert(owner);  // whose address it has
    collect(node, name, references);
  }
}

class Walk {
 public:
  explicit Walk(const References& references) : references_(references) {}
  // Ways from a node through what it refers to; complains of a bad one.
  Result<double> ways(const std::string& name) {
    if (const auto known = known_.find(name); known != known_.end()) {
      if (known->second.ways > 0 && static_cast<int>(path_.size()) + known->second.depth > kDeepest) return deep();
      if (known->second.ways > 0) return known->second.ways;
      return error(ErrorCode::kDevice, "node '{}' of its description refers to itself ({} -> {})", name,
                   fmt::join(std::find(path_.begin(), path_.end(), name), path_.end(), " -> "), name);
    }
    if (static_cast<int>(path_.size()) >= kDeepest) return deep();
    known_[name] = {};
    path_.push_back(name);
    Known now{1, 1};
    if (const auto found = references_.to.find(name); found != references_.to.end())
      for (const std::string& to : found->second) {
        CS_TRY(const double more, ways(to));
        now.ways += more;
        now.depth = std::max(now.depth, known_[to].depth + 1);
      }
    path_.pop_back();
    known_[name] = now;
    if (now.ways <= kMostWays) return now.ways;
    return error(ErrorCode::kDevice, "node '{}' of its description has more than {:.0f} ways through what it refers to",
                 name, kMostWays);
  }

 private:
  struct Known {
    double ways = 0;  // 0 = on the way
    int depth = 0;
  };
  Error deep() const {
    return error(ErrorCode::kDevice, "node '{}' of its description stands before a chain of more than {} nodes",
                 path_.front(), kDeepest);
  }
  const References& references_;
  std::map<std::string, Known> known_;
  std::vector<std::string> path_;
};

// Aravis takes a value that is to be found in a node that there is not for a value of its own: it reads back what was
// written, and nothing reaches the camera. Call when no node refers to itself.
Result<void> find_values(const References& references, const std::string& name) {
  const auto found = references.values.find(name);
  if (found == references.values.end()) return {};
  for (const std::string& to : found->second) {
    if (!references.nodes.contains(to))
      return error(ErrorCode::kDevice, "node '{}' of its description has its value in '{}', which is not there", name,
                   to);
    CS_TRY_VOID(find_values(references, to));
  }
  return {};
}

}  // namespace

Result<void> check_description_file(const std::string& address) {
  CameraMemory memory(address);
  for (const std::uint32_t at : {0x200u, 0x400u}) {  // Aravis tries the second where the first does not lead anywhere
    const Bytes text = memory.read(at, 512);
    if (text.empty()) return {};
    const Place place = place_of(text);
    if (!place.at || !place.size) continue;
    if (*place.size > kLargest)
      return error(ErrorCode::kDevice, "it says that its description ('{}') is longer than {} MB", place.text,
                   kLargest >> 20);
    if (!place.zipped) continue;
    const Bytes zip = memory.read(static_cast<std::uint32_t>(*place.at), static_cast<std::uint32_t>(*place.size));
    if (zip.empty()) return error(ErrorCode::kDevice, "its description ('{}') cannot be read", place.text);
    if (const auto why = damage(zip))
      return error(ErrorCode::kDevice, "its description ('{}') cannot be unpacked: {}", place.text, *why);
  }
  return {};
}

Result<void> check_description(ArvDevice* device) {
  ArvGc* description = arv_device_get_genicam(device);
  if (description == nullptr) return error(ErrorCode::kDevice, "it has no description that can be read");
  References references;
  collect(ARV_DOM_NODE(description), "", references);
  Walk walk(references);
  for (const auto& [name, to] : references.to) CS_TRY_VOID(walk.ways(name));
  for (const char* name : kAsked) CS_TRY_VOID(find_values(references, name));
  return {};
}

}  // namespace countershade::capture

#endif
