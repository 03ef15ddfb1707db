#include "capture/device/aravis/genicam_check.h"

#ifdef COUNTERSHADE_ARAVIS

#include <arpa/inet.h>
#include <arv.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <map>
#include <set>
#include <vector>

namespace countershade::capture {

namespace {

constexpr std::uint64_t kLargest = 8 << 20;  // bytes of a description; those of today's cameras have 1 MB
constexpr int kDeepest = 200;
constexpr double kMostWays = 1e6;

// What the camera says where its description lies ("Local:camera.zip;10000;2f5a"), by one register read (GigE Vision
// 2.0, 16.5 and 28.2). Empty where no answer comes.
std::string description_url(const std::string& address) {
  constexpr std::uint8_t kReadMemory[16] = {0x42, 1, 0, 0x84, 0, 8, 0x7f, 1, 0, 0, 2, 0, 0, 0, 2, 0};
  sockaddr_in camera{};
  camera.sin_family = AF_INET, camera.sin_port = htons(3956);
  if (inet_aton(address.c_str(), &camera.sin_addr) == 0) return "";
  const int file = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  std::string url;
  for (int i = 0; i < 3 && url.empty(); ++i) {
    std::array<std::uint8_t, 1024> answer{};
    pollfd waiting{file, POLLIN, 0};
    if (connect(file, reinterpret_cast<sockaddr*>(&camera), sizeof camera) != 0) break;
    if (send(file, kReadMemory, sizeof kReadMemory, 0) < 0 || poll(&waiting, 1, 500) <= 0) continue;
    const ssize_t n = recv(file, answer.data(), answer.size() - 1, 0);
    if (n > 12 && answer[3] == 0x85 && answer[6] == 0x7f) url = reinterpret_cast<const char*>(answer.data() + 12);
  }
  close(file);
  return url;
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

Result<void> check_description_size(const std::string& address) {
  const std::string url = description_url(address);
  const std::size_t at = url.find(';'), size_at = at == std::string::npos ? at : url.find(';', at + 1);
  if (size_at == std::string::npos) return {};
  std::uint64_t size = 0;
  const auto read = std::from_chars(url.data() + size_at + 1, url.data() + url.size(), size, 16);
  if (read.ec == std::errc::invalid_argument || (read.ec == std::errc() && size <= kLargest)) return {};
  return error(ErrorCode::kDevice, "it says that its description ('{}') is longer than {} MB", url, kLargest >> 20);
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
