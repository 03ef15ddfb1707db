// check and devices: what can be known before a capture.
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <optional>
#include <sstream>

#include "calib/file/file.h"
#include "capture/device/aravis/aravis.h"
#include "capture/device/video/libcamera.h"
#include "capture/device/video/v4l2.h"
#include "capture/device/window.h"
#include "tools/countershade/verbs.h"
#include "tools/job/check/identification.h"
#include "tools/job/check/inspection.h"
#include "tools/job/devices.h"

namespace countershade::tools {

namespace {

struct Options {
  std::filesystem::path rig, page = "check.html";
};

std::string text_of(const std::vector<Finding>& findings) {
  std::string text;
  for (const Finding& f : findings)
    text += fmt::format("{:<5} {:<48} {}{}\n", light_of(f), f.what, f.measured,
                        f.ok && !f.caution ? "" : "\n      " + f.remedy);
  return text;
}

// Also of what cameras and commands say, in whichever encoding.
std::string json_text(const nlohmann::json& document) {
  return document.dump(1, ' ', false, nlohmann::json::error_handler_t::replace) + "\n";
}

Result<Answer> run_check(const Options& options, const Context& context) {
  CS_TRY(const Rig rig, read_rig(options.rig));
  CS_TRY(const OpenDevices open, open_devices(rig, options.rig, *context.progress));
  CS_TRY(const Inspection inspection, inspect(rig, open.devices, *context.progress));
  const std::vector<Finding>& findings = inspection.findings;
  CS_TRY(const std::string page, check_html(options.rig.string(), findings, inspection.pictures));
  CS_TRY_VOID(write_atomically(options.page, page));
  nlohmann::json document = nlohmann::json::array();
  bool all_ok = true;
  for (const Finding& f : findings) {
    document.push_back({{"what", f.what},
                        {"measured", f.measured},
                        {"ok", f.ok},
                        {"light", light_of(f)},
                        {"remedy", f.ok && !f.caution ? "" : f.remedy}});
    all_ok = all_ok && f.ok;
  }
  return Answer{text_of(findings) + "page: " + options.page.string() + "\n", json_text(document), all_ok ? 0 : 1};
}

// Whether a shell would find it.
bool is_installed(const std::string& program) {
  const char* path = std::getenv("PATH");
  std::stringstream folders(path != nullptr ? path : "");
  for (std::string folder; std::getline(folders, folder, ':');)
    if (access((folder + "/" + program).c_str(), X_OK) == 0) return true;
  return false;
}

struct DevicesOptions {
  double identify_s = 0;
  std::filesystem::path rig;
};

Result<Answer> run_devices(const DevicesOptions& options, const Context& context) {
  if (options.identify_s > 0) {
    std::optional<Rig> rig;
    if (!options.rig.empty()) {
      CS_TRY(rig, read_rig(options.rig));
    }
    CS_TRY_VOID(identify_monitors(rig ? &*rig : nullptr, options.identify_s, *context.progress));
  }
  struct Row {
    std::string name, state, remedy;
  };
  std::vector<Row> rows = {
      {"simulated camera and projector", "ready", "a rig with [simulation]; countershade new two-wall writes one"},
      {"folder of photos", "ready", "countershade patterns, photograph, countershade import"},
      {"camera behind a command", is_installed("gphoto2") ? "gphoto2 is there" : "gphoto2 is not installed",
       "backend = \"command\", device = \"gphoto2 --capture-image-and-download --force-overwrite --filename "
       "{file}.jpg\""},
  };
  if (!capture::has_aravis()) rows.push_back({"aravis", "not built in", "install libaravis-dev and build again"});
  const std::vector<capture::AravisCamera> cameras = capture::list_aravis_cameras();
  if (capture::has_aravis() && cameras.empty())
    rows.push_back({"aravis (GigE and USB3 Vision)", "no camera answers",
                    "power, cable, same subnet, UDP port 3956 through the firewall; of USB a udev rule"});
  for (const capture::AravisCamera& c : cameras) {
    const std::string range =
        c.exposures_ms ? fmt::format(", {:.4g} to {:.4g} ms", (*c.exposures_ms)[0], (*c.exposures_ms)[1]) : "";
    rows.push_back(
        {"camera " + c.name, fmt::format("{} {} {}{}", c.protocol, c.address, fmt::join(c.formats, ","), range),
         !c.hindrance.empty() ? c.hindrance
                              : fmt::format("backend = \"aravis\", device = \"{}\" for a camera of the rig{}", c.device,
                                            c.advice.empty() ? "" : "; " + c.advice)});
  }
  const std::vector<capture::V4l2Camera> video = capture::list_v4l2_cameras();
  if (!capture::has_v4l2()) rows.push_back({"v4l2", "not on this system", "a Linux computer"});
  if (capture::has_v4l2() && video.empty())
    rows.push_back({"v4l2 (webcams, UVC cameras)", "no video device",
                    "plug it in; `lsusb` shows whether USB sees it; a container or virtual machine must be given it"});
  for (const capture::V4l2Camera& c : video)
    rows.push_back({"camera " + c.name, fmt::format("{} {}", c.device, fmt::join(c.formats, ",")),
                    !c.hindrance.empty()
                        ? c.hindrance
                        : fmt::format("backend = \"v4l2\", device = \"{}\" for a camera of the rig", c.device)});
  const std::vector<capture::LibcameraCamera> piped = capture::list_libcamera_cameras();
  if (piped.empty())
    rows.push_back({"libcamera", capture::has_libcamera() ? "no camera known" : "not built in",
                    capture::why_no_libcamera_camera()});
  for (const capture::LibcameraCamera& c : piped) {  // ids have backslashes, which a rig takes in single quotes
    const std::string range =
        c.exposures_ms ? fmt::format(", {} to {} ms", (*c.exposures_ms)[0], (*c.exposures_ms)[1]) : "";
    rows.push_back({"camera " + c.name, fmt::format("{} {}{}", c.id, fmt::join(c.formats, ","), range),
                    !c.hindrance.empty()
                        ? c.hindrance
                        : fmt::format("backend = \"libcamera\", device = '{}' for a camera of the rig", c.id)});
  }
  const auto monitors = capture::list_monitors();
  if (!monitors) rows.push_back({"displays", "none", monitors.error().message});
  for (const capture::Monitor& m : monitors ? *monitors : std::vector<capture::Monitor>())
    rows.push_back(
        {"display " + m.name, identification_text(m, nullptr)[1],
         !m.trap.empty()
             ? m.trap
             : fmt::format("monitor = \"{}\" for a projector of the rig{}", m.name,
                           m.edid.empty() ? "" : fmt::format(", or \"{}\", wherever it is plugged in", m.edid))});
  std::string text;
  nlohmann::json document = nlohmann::json::array();
  for (const Row& row : rows) {
    text += fmt::format("{:<32} {:<25} {}\n", row.name, row.state, row.remedy);
    document.push_back({{"backend", row.name}, {"state", row.state}, {"remedy", row.remedy}});
  }
  return Answer{text, json_text(document)};
}

}  // namespace

void add_check(CLI::App& app, Action& action) {
  auto* verb = app.add_subcommand(
      "check",
      "self-test before capture: display, latency, flicker, exposure, sharpness, coverage, movement; one page");
  auto options = std::make_shared<Options>();
  verb->add_option("rig", options->rig, "rig.toml")->required();
  verb->add_option("-o,--output", options->page, "page to write; one that stands there is replaced")
      ->capture_default_str();
  verb->callback([options, &action] { action = [options](const Context& c) { return run_check(*options, c); }; });
}

void add_devices(CLI::App& app, Action& action) {
  auto* verb =
      app.add_subcommand("devices", "cameras and displays this version can use; what is missing, and the remedy");
  auto options = std::make_shared<DevicesOptions>();
  verb->add_option(
          "--identify", options->identify_s,
          "show on every monitor, for so many seconds, its name, a frame of one pixel, single pixels and steps "
          "near black and white: what is cut off, scaled or clipped is seen")
      ->check(CLI::Range(0.0, 3600.0));
  verb->add_option("--rig", options->rig, "rig.toml: name its projectors on the monitors too");
  verb->callback([options, &action] { action = [options](const Context& c) { return run_devices(*options, c); }; });
}

}  // namespace countershade::tools
