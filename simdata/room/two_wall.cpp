// Two-wall rooms: the default one, and draws from the study distribution (docs/rooms.md).
#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>

#include "calib/base/random.h"
#include "simdata/room/framing.h"

namespace countershade::simdata {

namespace {

std::vector<Eigen::Vector3d> wall_points(const Simulation& room) {
  std::vector<Eigen::Vector3d> points;
  for (const auto& wall : room_screen(room).surfaces)
    for (double u : {0.0, 0.5, 1.0})
      for (double v : {0.0, 1.0}) points.push_back(wall->point(u, v));
  return points;
}

// Where a projector stands in front of its wall, before it is aimed.
struct Mount {
  double along = 0;    // from the wall's middle, outward, m
  double height = 0;   // above the height that the lens shift asks for, m
  double spill = 0.4;  // of its picture over the crease, m along the neighbour, at the height where it is least
};

// Moves a projector back and turns it until its picture just covers its wall and the spill; false where it cannot.
bool place_projector(const Rig& rig, const TwoWalls& room, bool left, const Mount& mount, SimulatedProjector& p) {
  Simulation probe;
  probe.surfaces = surfaces_of(room);
  const Screen screen = room_screen(probe);
  const Surface& wall = *screen.surfaces[left ? 0 : 1];
  const Surface& neighbour = *screen.surfaces[left ? 1 : 0];
  const double outer = left ? 0 : 1, width = (left ? room.left_size : room.right_size)[0];
  const double spill = mount.spill / (left ? room.right_size : room.left_size)[0];
  const double spill_u = left ? spill : 1 - spill;
  const double high = (left ? room.left_size : room.right_size)[1], rise = left ? room.left_rise : room.right_rise;
  std::vector<Eigen::Vector3d> cover{wall.point(outer, 0), wall.point(outer, 1)};
  for (double y : {rise, rise + high}) {
    Eigen::Vector3d x = neighbour.point(spill_u, 0);
    x.y() = y;
    cover.push_back(x);
  }
  const double pixels_x = rig.projector(p.id)->resolution[0], pixels_y = rig.projector(p.id)->resolution[1];
  const Eigen::Vector3d outward = (wall.point(outer, 0) - wall.point(1 - outer, 0)) / width;
  double distance = p.throw_ratio * (width + 0.3);
  p.target = array(wall.point(0.5, 0.5));
  for (int i = 0; i < 100; ++i) {
    const double picture_height = distance / p.throw_ratio * pixels_y / pixels_x;
    Eigen::Vector3d at = wall.point(0.5, 0.5) + mount.along * outward + distance * wall.normal(0.5, 0.5);
    at.y() = rise + high / 2 + p.lens_shift[1] * picture_height + mount.height;
    p.position = array(at);
    probe.projectors = {p};
    const Device device = true_projector(probe, rig, p.id).value();
    const auto found = box_of(device, cover);
    if (!found) return false;
    const Box& box = *found;
    const double margin = 0.006 * pixels_x;
    const Eigen::Vector2d size = (box.high - box.low) + Eigen::Vector2d::Constant(2 * margin);
    distance *= std::max(size.x() / pixels_x, size.y() / pixels_y);
    // Vertically in the middle; sideways flush with the crease side, which is right of the left wall.
    const double edge = left ? box.high.x() + margin - (pixels_x - 0.5) : box.low.x() - margin + 0.5;
    const double middle = (box.low.y() + box.high.y()) / 2 - (pixels_y - 1) / 2;
    p.target = turned(device, {edge, middle}, distance);
    if (!std::isfinite(p.target[0]) || !(distance < 20)) return false;
  }
  return true;
}

// Least and largest distance from the crease, along the neighbour, that the crease-side edge of a picture reaches.
std::pair<double, double> spill(const RigAndRoom& made, bool left) {
  const Screen screen = room_screen(made.simulation);
  const ProjectorSpec& spec = made.rig.projectors[left ? 0 : 1];
  const Device device = true_projector(made.simulation, made.rig, spec.id).value();
  const double x = left ? spec.resolution[0] - 0.5 : -0.5;
  double least = HUGE_VAL, largest = 0;
  int met = 0;
  for (int i = 0; i <= 20; ++i) {
    const ChartPoint hit = screen.intersect(device.ray({x, i / 20.0 * spec.resolution[1] - 0.5}));
    if (hit.surface != (left ? 1 : 0)) continue;
    const Eigen::Vector3d at = screen.point(hit);
    least = std::min(least, std::hypot(at.x(), at.z()));
    largest = std::max(largest, std::hypot(at.x(), at.z()));
    ++met;
  }
  return {met > 10 ? least : 0, largest};
}

// Every wall corner in the camera's picture, all devices before both walls, spill of 0.3 to 0.8 m.
bool usable(const RigAndRoom& made) {
  const Screen screen = room_screen(made.simulation);
  const Device camera = true_camera(made.simulation, made.rig.cameras[0].id).value();
  for (const auto& wall : screen.surfaces) {
    const Eigen::Vector3d origin = wall->point(0, 0), normal = wall->normal(0, 0);
    for (double u : {0.0, 1.0})
      for (double v : {0.0, 1.0})
        if (!camera.lens.contains(camera.project(wall->point(u, v)))) return false;
    if ((camera.position() - origin).dot(normal) < 0.5) return false;
    for (const ProjectorSpec& p : made.rig.projectors)
      if ((true_projector(made.simulation, made.rig, p.id).value().position() - origin).dot(normal) < 0.2) return false;
  }
  for (bool left : {true, false}) {
    const auto [least, largest] = spill(made, left);
    if (least < 0.3 || largest > 0.8) return false;
  }
  return true;
}

std::array<double, 3> tinted(Random& random) {
  const double albedo = random.uniform(0.7, 0.85);
  std::array<double, 3> tint;
  for (double& t : tint) t = rounded(std::clamp(albedo + random.uniform(-0.04, 0.04), 0.7, 0.85), 1e-3);
  return tint;
}

bool draw_projector(Random& random, const TwoWalls& walls, RigAndRoom& made, bool left) {
  SimulatedProjector& p = made.simulation.projectors[left ? 0 : 1];
  p.throw_ratio = rounded(random.uniform(1.0, 1.6), 1e-3);
  const double side = random.uniform() < 0.5 ? -1 : 1;
  const double vertical = random.uniform(0.1, 0.3);
  p.lens_shift = {rounded(std::clamp(0.01 * random.normal(), -0.1, 0.1), 1e-4), rounded(side * vertical, 1e-3)};
  p.roll_deg = rounded(random.uniform(-2, 2), 0.01);
  p.gain = rounded(random.uniform(0.85, 1.15), 1e-3);
  p.falloff = rounded(random.uniform(0.05, 0.25), 1e-3);
  Mount mount;
  mount.along = random.uniform(-0.35, 0.35);
  mount.height = random.uniform(-0.2, 0.2);
  mount.spill = random.uniform(0.32, 0.45);
  return place_projector(made.rig, walls, left, mount, p);
}

std::optional<RigAndRoom> draw_room(Random& random) {
  RigAndRoom made = blank_room({"left", "right"});
  Simulation& s = made.simulation;
  TwoWalls walls;
  walls.angle_deg = rounded(random.uniform(80, 110), 0.01);
  for (auto* size : {&walls.left_size, &walls.right_size}) {
    (*size)[0] = rounded(random.uniform(2.4, 3.6), 1e-3);
    (*size)[1] = rounded(std::clamp((*size)[0] * random.uniform(0.6, 0.7), 1.8, 2.4), 1e-3);
  }
  walls.left_rise = rounded(random.uniform(0, 0.3), 1e-3);
  walls.right_rise = rounded(walls.left_rise + random.uniform(-0.1, 0.1), 1e-3);
  walls.left_albedo = tinted(random);
  walls.right_albedo = tinted(random);
  s.surfaces = surfaces_of(walls);
  for (bool left : {true, false})
    if (!draw_projector(random, walls, made, left)) return std::nullopt;
  SimulatedCamera& c = s.cameras[0];
  const double bearing = random.uniform(-12, 12) * std::numbers::pi / 180, distance = random.uniform(4.2, 5.2);
  c.position = {distance * std::sin(bearing), walls.left_rise + random.uniform(0.7, 1.7), distance * std::cos(bearing)};
  c.roll_deg = rounded(random.uniform(-2, 2), 0.01);
  c.distortion = {rounded(random.uniform(-0.12, 0.02), 1e-4), rounded(random.uniform(-0.01, 0.03), 1e-4),
                  rounded(random.uniform(-5e-4, 5e-4), 1e-6), rounded(random.uniform(-5e-4, 5e-4), 1e-6), 0};
  c.principal = {rounded(959.5 + random.uniform(-12, 12), 0.1), rounded(599.5 + random.uniform(-12, 12), 0.1)};
  if (!aim_camera(wall_points(s), c)) return std::nullopt;
  round_numbers(s);
  return made;
}

// At least .2 m before the planes of both walls.
bool stands_before(const Simulation& room, const SimulatedProjector& p) {
  const Screen screen = room_screen(room);
  return std::all_of(screen.surfaces.begin(), screen.surfaces.end(), [&](const auto& wall) {
    const Eigen::Vector3d from = Eigen::Vector3d(p.position[0], p.position[1], p.position[2]) - wall->point(0, 0);
    return from.dot(wall->normal(0, 0)) >= 0.2;
  });
}

// Corners of a wall, and of so many metres of its neighbour beside the crease.
std::vector<Eigen::Vector3d> with_spill(const Screen& screen, int wall, double metres) {
  const Surface &own = *screen.surfaces[wall], &other = *screen.surfaces[1 - wall];
  const double width = (other.point(1, 0) - other.point(0, 0)).norm(),
               u = wall == 0 ? metres / width : 1 - metres / width;
  std::vector<Eigen::Vector3d> points;
  for (double v : {0.0, 1.0}) points.insert(points.end(), {own.point(0, v), own.point(1, v), other.point(u, v)});
  return points;
}

}  // namespace

RigAndRoom default_two_wall(double angle_deg) {
  RigAndRoom made = blank_room({"left", "right"});
  Simulation& s = made.simulation;
  TwoWalls walls;
  walls.angle_deg = angle_deg;
  walls.left_size = {3.0, 2.0}, walls.right_size = {2.75, 1.85};
  walls.left_rise = 0.1, walls.right_rise = 0.17;
  walls.left_albedo = {0.82, 0.80, 0.76}, walls.right_albedo = {0.77, 0.79, 0.81};
  s.surfaces = surfaces_of(walls);
  SimulatedProjector &left = s.projectors[0], &right = s.projectors[1];
  left.throw_ratio = 1.25, left.lens_shift = {0.004, 0.22}, left.roll_deg = 0.8, left.falloff = 0.15;
  right.throw_ratio = 1.1, right.lens_shift = {-0.003, 0.15}, right.roll_deg = -1.1, right.falloff = 0.18;
  right.gain = 0.95;
  bool placed = place_projector(made.rig, walls, true, {0.12, 0.1, 0.35}, left) && stands_before(s, left);
  placed &= place_projector(made.rig, walls, false, {-0.2, -0.08, 0.37}, right) && stands_before(s, right);
  if (!placed) {  // walls so close that projectors stand in front of the opening
    const Screen screen = room_screen(s);
    left.position = {0.16, 1.9, 4.3}, right.position = {-0.1, 2.0, 4.4};
    placed = aim_projector(with_spill(screen, 0, 0.35), made.rig, left) &&
             aim_projector(with_spill(screen, 1, 0.37), made.rig, right);
  }
  SimulatedCamera& c = s.cameras[0];
  c.position = {0.35, 1.4, 4.5};
  c.roll_deg = 0.7;
  c.distortion = {-0.08, 0.012, 2e-4, -1e-4, 0};
  c.principal = {962.3, 594.1};
  placed &= aim_camera(wall_points(s), c);
  CS_CHECK(placed, "the default room's devices have their places");
  round_numbers(s);
  return made;
}

RigAndRoom random_two_wall(std::uint64_t seed) {
  Random random(mix(seed ^ hash_name("two-wall")));
  for (int attempt = 0; attempt < 1000; ++attempt) {
    auto made = draw_room(random);
    if (!made || !usable(*made)) continue;
    made->simulation.seed = seed % 1000000007;
    return *std::move(made);
  }
  CS_CHECK(false, "no usable room was drawn");
  return {};
}

}  // namespace countershade::simdata
