// The rooms that `countershade new` writes, beside the plain two-wall one. Each is asymmetric in every index.
#include <algorithm>
#include <cmath>
#include <numbers>

#include "calib/base/check.h"
#include "calib/file/nearest.h"
#include "simdata/room/framing.h"
#include "simdata/room/shape.h"

namespace countershade::simdata {

namespace {

using Points = std::vector<Eigen::Vector3d>;
using Three = std::array<double, 3>;

SimulatedSurface rectangle(const char* id, const Three& origin, const Three& along_u, const Three& along_v,
                           const Three& albedo) {
  SimulatedSurface s;
  s.id = id, s.origin = origin, s.along_u = along_u, s.along_v = along_v, s.albedo = albedo;
  return s;
}

// Points of part of a surface's chart.
Points part(const SimulatedSurface& surface, double u0, double v0, double u1, double v1) {
  constexpr int kSteps = 6;
  const std::shared_ptr<const Shape> shape = make_shape(surface).value();
  Points points;
  for (int j = 0; j <= kSteps; ++j)
    for (int i = 0; i <= kSteps; ++i)
      points.push_back(shape->at(u0 + (u1 - u0) * i / kSteps, v0 + (v1 - v0) * j / kSteps).x);
  return points;
}
Points whole(const SimulatedSurface& surface) {
  return part(surface, 0, 0, 1, 1);
}
Points both(Points a, const Points& b) {
  a.insert(a.end(), b.begin(), b.end());
  return a;
}

const SimulatedSurface& surface(const RigAndRoom& made, const std::string& id) {
  const auto& all = made.simulation.surfaces;
  const auto found = std::find_if(all.begin(), all.end(), [&](const SimulatedSurface& s) { return s.id == id; });
  CS_CHECK(found != all.end(), "a room without the surface " + id);
  return *found;
}

// Sets a projector somewhere and makes its picture cover the points; devices differ from each other a little.
void place(RigAndRoom& made, int q, const Three& position, const Points& points) {
  SimulatedProjector& p = made.simulation.projectors[q];
  p.position = position;
  p.roll_deg = rounded(0.6 - 0.9 * q, 0.01);
  p.gain = rounded(1 - 0.04 * q, 0.01);
  p.falloff = rounded(0.12 + 0.03 * q, 0.01);
  CS_CHECK(aim_projector(points, made.rig, p), "projector '" + p.id + "' has its place");
}

void finish(RigAndRoom& made, const char* name, const Three& camera, const Points& points) {
  made.simulation.room = name;
  SimulatedCamera& c = made.simulation.cameras[0];
  c.position = camera;
  c.roll_deg = 0.7;
  c.distortion = {-0.08, 0.012, 2e-4, -1e-4, 0};
  c.principal = {962.3, 594.1};
  CS_CHECK(aim_camera(points, c), std::string("the camera of the room ") + name + " has its place");
  round_numbers(made.simulation);
}

// ---- boxes ----

// Open towards the audience: front wall at z = 0 from x = -1.5 to 1.55, 2.2 m high; side walls that widen a little.
std::vector<SimulatedSurface> cave_walls() {
  return {rectangle("left-wall", {-1.62, 0, 2.5}, {0.12, 0, -2.5}, {0, 2.2, 0}, {0.78, 0.76, 0.72}),
          rectangle("front-wall", {-1.5, 0, 0}, {3.05, 0, 0}, {0, 2.2, 0}, {0.8, 0.8, 0.78}),
          rectangle("right-wall", {1.55, 0, 0}, {0.2, 0, 2.4}, {0, 2.2, 0}, {0.74, 0.77, 0.79}),
          rectangle("floor", {-1.5, 0, 2.3}, {3.05, 0, 0}, {0, 0, -2.3}, {0.6, 0.58, 0.56})};
}

RigAndRoom cave4() {
  RigAndRoom made = blank_room({"left", "front", "right", "floor"});
  made.simulation.surfaces = cave_walls();
  place(made, 0, {1.15, 2.9, 2.6}, whole(surface(made, "left-wall")));
  place(made, 1, {0.15, 2.8, 3.6}, whole(surface(made, "front-wall")));
  place(made, 2, {-1.05, 3.0, 2.5}, whole(surface(made, "right-wall")));
  place(made, 3, {0.1, 4.4, 1.3}, whole(surface(made, "floor")));
  finish(made, "cave4", {0.3, 2.3, 5.6},
         both(whole(surface(made, "front-wall")),
              both(whole(surface(made, "left-wall")), whole(surface(made, "right-wall")))));
  return made;
}

RigAndRoom five_face() {
  RigAndRoom made = blank_room({"left", "front", "right", "floor", "ceiling"});
  made.simulation.surfaces = cave_walls();
  made.simulation.surfaces.push_back(
      rectangle("ceiling", {-1.5, 2.2, 0}, {3.05, 0, 0}, {0, 0, 2.35}, {0.7, 0.72, 0.7}));
  place(made, 0, {1.1, 1.3, 3.4}, whole(surface(made, "left-wall")));
  place(made, 1, {0.15, 1.0, 3.9}, whole(surface(made, "front-wall")));
  place(made, 2, {-1.0, 0.9, 3.3}, whole(surface(made, "right-wall")));
  place(made, 3, {0.1, 1.7, 3.6}, whole(surface(made, "floor")));
  place(made, 4, {-0.2, 0.5, 3.5}, whole(surface(made, "ceiling")));
  finish(made, "five-face", {0.3, 1.2, 5.8},
         both(whole(surface(made, "front-wall")),
              both(whole(surface(made, "left-wall")), whole(surface(made, "right-wall")))));
  return made;
}

// A room of 4.2 x 2.6 x 5.1 m: everything that is lit stays in it.
RigAndRoom closed_room() {
  RigAndRoom made = blank_room({"left", "right"});
  const double x0 = -2, x1 = 2.2, h = 2.6, z0 = 0, z1 = 5.1;
  made.simulation.surfaces = {rectangle("left-wall", {x0, 0, z1}, {0, 0, z0 - z1}, {0, h, 0}, {0.7, 0.68, 0.64}),
                              rectangle("front-wall", {x0, 0, z0}, {x1 - x0, 0, 0}, {0, h, 0}, {0.78, 0.78, 0.76}),
                              rectangle("right-wall", {x1, 0, z0}, {0, 0, z1 - z0}, {0, h, 0}, {0.66, 0.69, 0.72}),
                              rectangle("back-wall", {x1, 0, z1}, {x0 - x1, 0, 0}, {0, h, 0}, {0.3, 0.28, 0.26}),
                              rectangle("floor", {x0, 0, z1}, {x1 - x0, 0, 0}, {0, 0, z0 - z1}, {0.35, 0.3, 0.25}),
                              rectangle("ceiling", {x0, h, z0}, {x1 - x0, 0, 0}, {0, 0, z1 - z0}, {0.8, 0.8, 0.8})};
  place(made, 0, {0.8, 2.2, 3.6}, part(surface(made, "left-wall"), 0.42, 0.1, 0.99, 0.9));
  place(made, 1, {-0.5, 2.1, 3.9}, part(surface(made, "front-wall"), 0.3, 0.08, 0.98, 0.92));
  finish(made, "closed-room", {1.3, 1.5, 4.8},
         both(part(surface(made, "front-wall"), 0.02, 0.06, 0.95, 0.94),
              part(surface(made, "left-wall"), 0.45, 0.06, 1, 0.94)));
  return made;
}

// ---- round screens ----

SimulatedSurface round_screen(const char* shape, double radius, double height, std::array<double, 2> azimuth_deg) {
  SimulatedSurface s;
  s.id = "screen", s.shape = shape;
  s.radius = radius, s.height = height, s.azimuth_deg = azimuth_deg;
  s.albedo = {0.79, 0.8, 0.77};
  return s;
}

RigAndRoom cylinder() {
  RigAndRoom made = blank_room({"left", "right"});
  SimulatedSurface s = round_screen("cylinder", 2.6, 2.1, {-80, 72});
  s.origin = {0, 0.2, 0};
  made.simulation.surfaces = {s};
  place(made, 0, {0.5, 2.35, 0.35}, part(s, 0, 0, 0.56, 1));
  place(made, 1, {-0.4, 2.3, 0.5}, part(s, 0.46, 0, 1, 1));
  finish(made, "cylinder", {0.2, 1.5, 2.9}, whole(s));
  return made;
}

RigAndRoom cone() {
  RigAndRoom made = blank_room({"left", "right"});
  SimulatedSurface s = round_screen("cone", 2.4, 1.9, {-70, 66});
  s.top_radius = 1.7;
  s.origin = {0.05, 0.3, 0};
  made.simulation.surfaces = {s};
  place(made, 0, {0.5, 1.5, 1.4}, part(s, 0, 0, 0.57, 1));
  place(made, 1, {-0.45, 1.6, 1.3}, part(s, 0.45, 0, 1, 1));
  finish(made, "cone", {0.25, 1.3, 3.2}, whole(s));
  return made;
}

RigAndRoom dome() {
  RigAndRoom made = blank_room({"left", "right"});
  SimulatedSurface s = round_screen("sphere", 2.2, 1, {-95, 85});
  s.elevation_deg = {2, 78};
  s.origin = {0, 0.4, 0};
  made.simulation.surfaces = {s};
  place(made, 0, {0.45, 0.5, 1.15}, part(s, 0, 0, 0.55, 1));
  place(made, 1, {-0.4, 0.55, 1.2}, part(s, 0.47, 0, 1, 1));
  finish(made, "dome", {0.15, 0.7, 2.7}, whole(s));
  return made;
}

// ---- variations of two walls ----

// An L: a panel that stands at the back of a table, 104 degrees apart.
RigAndRoom workbench() {
  RigAndRoom made = blank_room({"panel", "table"});
  made.simulation.surfaces = {rectangle("panel", {-0.85, 0.9, 0}, {1.7, 0, 0}, {0, 0.97, -0.24}, {0.8, 0.79, 0.77}),
                              rectangle("table", {-0.85, 0.9, 0.95}, {1.75, 0, 0}, {0, 0, -0.95}, {0.74, 0.76, 0.78})};
  made.simulation.surfaces[0].patchwork = 0.06;
  place(made, 0, {0.25, 2.5, 2.0}, both(whole(surface(made, "panel")), part(surface(made, "table"), 0, 0.6, 1, 1)));
  place(made, 1, {-0.3, 2.9, 1.5}, both(whole(surface(made, "table")), part(surface(made, "panel"), 0, 0, 1, 0.4)));
  finish(made, "workbench", {0.2, 2.2, 2.6}, both(whole(surface(made, "panel")), whole(surface(made, "table"))));
  return made;
}

RigAndRoom rear() {
  RigAndRoom made = default_two_wall();
  for (int q = 0; q < 2; ++q) {
    SimulatedSurface& wall = made.simulation.surfaces[q];
    wall.albedo = {0.42, 0.41 + 0.01 * q, 0.4};
    wall.transmission = 1.1;
    const std::shared_ptr<const Shape> shape = make_shape(wall).value();
    const SurfacePoint middle = shape->at(0.5, 0.5);
    SimulatedProjector& p = made.simulation.projectors[q];
    const Eigen::Vector3d at = middle.x - (3.4 + 0.2 * q) * middle.normal + Eigen::Vector3d(0.05, 0.25, -0.1);
    p.position = array(at);
    p.throw_ratio = 1.2;
    CS_CHECK(aim_projector(whole(wall), made.rig, p), "a rear projector has its place");
  }
  made.simulation.room = "rear";
  round_numbers(made.simulation);
  return made;
}

// A column stands before the edge: it shades the walls and hides part of them from the camera.
RigAndRoom column() {
  RigAndRoom made = default_two_wall();
  SimulatedSurface pillar;
  pillar.id = "column", pillar.shape = "cylinder", pillar.lit = "outside";
  pillar.origin = {0.32, 0.12, 0.85}, pillar.radius = 0.09, pillar.height = 1.7;
  pillar.azimuth_deg = {-180, 180};
  pillar.albedo = {0.5, 0.47, 0.42};
  made.simulation.surfaces.push_back(pillar);
  made.simulation.room = "column";
  return made;
}

RigAndRoom painted() {
  RigAndRoom made = default_two_wall();
  made.simulation.surfaces[0].texture = 0.1;
  made.simulation.surfaces[1].patchwork = 0.12;
  made.simulation.surfaces[1].patchwork_cells = {7, 4};
  made.simulation.room = "painted";
  return made;
}

RigAndRoom glossy() {
  RigAndRoom made = default_two_wall();
  made.simulation.surfaces[0].gloss = 0.08, made.simulation.surfaces[0].roughness = 0.3;
  made.simulation.surfaces[1].gloss = 0.14, made.simulation.surfaces[1].roughness = 0.35;
  made.simulation.room = "glossy";
  return made;
}

RigAndRoom directing() {
  RigAndRoom made = default_two_wall();
  made.simulation.surfaces[0].directing = 1.5;
  made.simulation.surfaces[1].directing = 2, made.simulation.surfaces[1].directing_tilt_deg = {-12, 5};
  made.simulation.room = "directing";
  return made;
}

RigAndRoom daylit() {
  RigAndRoom made = default_two_wall();
  made.simulation.ambient = 0.01;
  made.simulation.surfaces[0].daylight = 0.25;
  made.simulation.surfaces[0].daylight_from = {0.08, 0.12}, made.simulation.surfaces[0].daylight_to = {0.3, 0.55};
  made.simulation.room = "daylit";
  return made;
}

// Steps that lead to the right: three treads and three risers, as an OBJ file of quadrilaterals.
RigAndRoom stepped() {
  RigAndRoom made = blank_room({"left", "right"});
  const std::vector<std::pair<double, double>> outline{{-1.6, 1.5}, {-0.7, 0.9},  {-0.55, 0.35},
                                                       {0.5, 0.1},  {0.62, -0.4}, {1.6, 0.2}};
  std::string obj = "# A free screen: vertical panels, faces anticlockwise from the audience, metres.\n";
  for (const auto& [x, z] : outline) obj += fmt::format("v {} 0.15 {}\nv {} 2.05 {}\n", x, z, x, z);
  for (std::size_t i = 0; i + 1 < outline.size(); ++i)
    obj += fmt::format("f {} {} {} {}\n", 2 * i + 1, 2 * i + 3, 2 * i + 4, 2 * i + 2);
  SimulatedSurface s;
  s.id = "screen", s.shape = "mesh", s.mesh = "screen.obj";
  s.albedo = {0.78, 0.77, 0.74};
  made.simulation.surfaces = {s};
  Points points;
  for (const auto& [x, z] : outline) points.insert(points.end(), {{x, 0.15, z}, {x, 2.05, z}});
  const Points left(points.begin(), points.begin() + 8), right(points.begin() + 4, points.end());
  place(made, 0, {0.6, 1.9, 4.0}, left);
  place(made, 1, {-0.2, 1.8, 4.2}, right);
  finish(made, "stepped", {0.35, 1.3, 5.0}, points);
  made.files = {{"screen.obj", obj}};
  return made;
}

struct Kind {
  const char* name;
  const char* what;
  RigAndRoom (*make)();
};

const std::vector<Kind>& kinds() {
  static const std::vector<Kind> all{
      {"two-wall", "two walls that meet in an edge", [] { return default_two_wall(); }},
      {"cave4", "three walls and a floor, four projectors", cave4},
      {"five-face", "three walls, floor and ceiling, five projectors", five_face},
      {"closed-room", "an ordinary room of six faces, two projectors", closed_room},
      {"cylinder", "part of an upright cylinder", cylinder},
      {"dome", "part of a sphere", dome},
      {"cone", "part of a cone that narrows upwards", cone},
      {"workbench", "an L: a panel behind a table", workbench},
      {"rear", "two walls lit from behind", rear},
      {"column", "two walls, and a column that hides part of them", column},
      {"painted", "two walls whose albedo varies, smoothly and by patches", painted},
      {"glossy", "two walls with a share of gloss", glossy},
      {"directing", "two walls of light-directing screens", directing},
      {"daylit", "two walls in a room that is not dark", daylit},
      {"stepped", "a free shape from an OBJ file", stepped},
  };
  return all;
}

}  // namespace

const std::vector<std::pair<std::string, std::string>>& room_kinds() {
  static const std::vector<std::pair<std::string, std::string>> names = [] {
    std::vector<std::pair<std::string, std::string>> list;
    for (const Kind& k : kinds()) list.emplace_back(k.name, k.what);
    return list;
  }();
  return names;
}

Result<RigAndRoom> default_room(const std::string& kind) {
  std::vector<std::string> names;
  for (const Kind& k : kinds()) {
    if (kind == k.name) return k.make();
    names.emplace_back(k.name);
  }
  return error(ErrorCode::kBadValue, "there is no room '{}'; the nearest is '{}', and there are: {}", kind,
               nearest(kind, names), fmt::join(names, ", "));
}

}  // namespace countershade::simdata
