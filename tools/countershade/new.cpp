#include <CLI/CLI.hpp>

#include "calib/file/file.h"
#include "calib/geometry/lens.h"
#include "simdata/room/rooms.h"
#include "tools/countershade/verbs.h"

namespace countershade::tools {

namespace {

struct Options {
  std::string room = "two-wall";
  double angle_deg = 97;
  std::filesystem::path out = "rig.toml";
};

Result<Answer> run_new(const Options& options) {
  if (std::filesystem::exists(options.out))
    return error(ErrorCode::kExists, "'{}' exists already; choose another name with -o or remove it",
                 options.out.string());
  CS_TRY(simdata::RigAndRoom made, simdata::default_room(options.room));
  if (options.angle_deg != Options().angle_deg) {
    if (options.room != "two-wall")
      return error(ErrorCode::kBadValue, "--angle is the angle between the walls of 'two-wall'; '{}' has none to set",
                   options.room);
    if (!(options.angle_deg >= 15 && options.angle_deg <= 170))
      return error(ErrorCode::kBadValue, "--angle {} is outside 15 to 170 degrees", options.angle_deg);
    made = simdata::default_two_wall(options.angle_deg);
  }
  const std::filesystem::path folder = options.out.has_parent_path() ? options.out.parent_path() : ".";
  std::string models;
  for (const CameraSpec& camera : made.rig.cameras) {
    if (camera.model.empty()) continue;
    CS_TRY(Device device, simdata::true_camera(made.simulation, camera.id));
    device.device_from_world = {};  // what a lens calibration knows: the lens, not the place
    CS_TRY_VOID(write_cameramodel(folder / camera.model, device));
    models += " and " + (folder / camera.model).string();
  }
  for (const auto& [name, contents] : made.files) {
    if (std::filesystem::exists(folder / name))
      return error(ErrorCode::kExists, "'{}' exists already; write the rig to another folder or remove it",
                   (folder / name).string());
    CS_TRY_VOID(write_atomically(folder / name, contents));
    models += " and " + (folder / name).string();
  }
  CS_TRY_VOID(write_atomically(options.out, rig_text(made.rig, &made.simulation)));
  return Answer{fmt::format("wrote {}{}\nnext: countershade run {} -o results/\n", options.out.string(), models,
                            options.out.string()),
                fmt::format("{{\"rig\": \"{}\"}}\n", options.out.string())};
}

}  // namespace

void add_new(CLI::App& app, Action& action) {
  auto* verb = app.add_subcommand("new", "write a commented rig file to edit");
  auto options = std::make_shared<Options>();
  std::string rooms = "kind of room:";
  for (const auto& [name, what] : simdata::room_kinds()) rooms += fmt::format("\n{} - {}", name, what);
  verb->add_option("room", options->room, rooms)->required();
  verb->add_option("--angle", options->angle_deg, "angle between the walls of two-wall [degrees]")
      ->capture_default_str();
  verb->add_option("-o,--output", options->out, "rig file to write")->capture_default_str();
  verb->callback([options, &action] { action = [options](const Context&) { return run_new(*options); }; });
}

}  // namespace countershade::tools
