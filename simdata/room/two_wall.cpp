// Two-wall rooms: the default one, and draws from the study distribution (docs/rooms.md).
#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>

#include "calib/base/random.h"
#include "simdata/room/rooms.h"

namespace countershade::simdata {

namespace {

std::array<double, 3> array(const Eigen::Vector3d& v) {
  return {v.x(), v.y(), v.z()};
}

struct Box {
  Eigen::Vector2d low = Eigen::Vector2d::Constant(HUGE_VAL), high = Eigen::Vector2d::Constant(-HUGE_VAL);
};

// None where a point is not in front of the device.
std::optional<Box> box_of(const Device& device, const std::vector<Eigen::Vector3d>& points) {
  Box box;
  for (const Eigen::Vector3d& x : points) {
    const Eigen::Vector2d q = device.project(x);
    if (!q.allFinite()) return std::nullopt;
    box.low = box.low.cwiseMin(q), box.high = box.high.cwiseMax(q);
  }
  return box;
}

// The world point under the pixel that lies `move` from the lens axis' pixel.
std::array<double, 3> turned(const Device& device, const Eigen::Vector2d& move, double distance) {
  const std::vector<double>& k = device.lens.intrinsics();
  const Ray ray = device.ray({k[2] + move.x(), k[3] + move.y()});
  return array(ray.origin + distance * ray.direction);
}

// Where a projector stands in front of its wall, before it is aimed.
struct Mount {
  double along = 0;    // from the wall's middle, outward, m
  double height = 0;   // above the height that the lens shift asks for, m
  double spill = 0.4;  // of its picture over the crease, m along the neighbour, at the height where it is least
};

// Moves a projector back and turns it until its picture just covers its wall and the spill; false where it cannot.
bool place_projector(const Rig& rig, const Simulation& room, bool left, const Mount& mount, SimulatedProjector& p) {
  const Screen screen = room_screen(room);
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
    Simulation probe = room;
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

// Turns a camera and sets its focal length so that both walls fill the picture but for a rim of 2 %; false where it
// cannot.
bool aim_camera(const Simulation& room, SimulatedCamera& c) {
  const Screen screen = room_screen(room);
  std::vector<Eigen::Vector3d> corners;
  for (const auto& wall : screen.surfaces)
    for (double u : {0.0, 0.5, 1.0})
      for (double v : {0.0, 1.0}) corners.push_back(wall->point(u, v));
  c.target = array(screen.surfaces[0]->point(1, 0.5));
  const Eigen::Vector2d picture(c.resolution[0], c.resolution[1]);
  for (int i = 0; i < 100; ++i) {
    Simulation probe = room;
    probe.cameras = {c};
    const Device device = true_camera(probe, c.id).value();
    const auto box = box_of(device, corners);
    if (!box) return false;
    c.focal_px *= (0.96 * picture.array() / (box->high - box->low).array()).minCoeff();
    c.target = turned(device, (box->low + box->high - picture + Eigen::Vector2d::Ones()) / 2, 4);
    if (!std::isfinite(c.target[0]) || !(c.focal_px > 100)) return false;
  }
  return true;
}

// What studies hold fixed (sensor, pictures, black level) is the default of the structs.
RigAndRoom blank() {
  RigAndRoom made;
  CameraSpec camera;
  camera.id = "camera";
  camera.backend = "simulated";
  camera.model = "camera.cameramodel";
  camera.full_scale = 4095;
  made.rig.cameras = {camera};
  SimulatedCamera true_camera;
  true_camera.id = camera.id;
  made.simulation.cameras = {true_camera};
  for (const char* id : {"left", "right"}) {
    ProjectorSpec spec;
    spec.id = id;
    spec.resolution = {1280, 800};
    spec.black_level = 0.001;
    made.rig.projectors.push_back(spec);
    SimulatedProjector projector;
    projector.id = id;
    made.simulation.projectors.push_back(projector);
  }
  return made;
}

// To a decimal fraction: unit = 1 / (a power of ten).
double rounded(double value, double unit) {
  return std::round(value / unit) / std::round(1 / unit);
}

// What an operator would type: millimetres and tenths of a pixel. Nothing depends on more digits.
void round_numbers(Simulation& s) {
  for (SimulatedCamera& c : s.cameras) {
    for (int k = 0; k < 3; ++k) c.position[k] = rounded(c.position[k], 1e-3), c.target[k] = rounded(c.target[k], 1e-3);
    c.focal_px = rounded(c.focal_px, 0.1);
  }
  for (SimulatedProjector& p : s.projectors)
    for (int k = 0; k < 3; ++k) p.position[k] = rounded(p.position[k], 1e-3), p.target[k] = rounded(p.target[k], 1e-3);
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

bool draw_projector(Random& random, RigAndRoom& made, bool left) {
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
  return place_projector(made.rig, made.simulation, left, mount, p);
}

std::optional<RigAndRoom> draw_room(Random& random) {
  RigAndRoom made = blank();
  Simulation& s = made.simulation;
  s.angle_deg = rounded(random.uniform(80, 110), 0.01);
  for (auto* size : {&s.left_size, &s.right_size}) {
    (*size)[0] = rounded(random.uniform(2.4, 3.6), 1e-3);
    (*size)[1] = rounded(std::clamp((*size)[0] * random.uniform(0.6, 0.7), 1.8, 2.4), 1e-3);
  }
  s.left_rise = rounded(random.uniform(0, 0.3), 1e-3);
  s.right_rise = rounded(s.left_rise + random.uniform(-0.1, 0.1), 1e-3);
  s.left_albedo = tinted(random);
  s.right_albedo = tinted(random);
  for (bool left : {true, false})
    if (!draw_projector(random, made, left)) return std::nullopt;
  SimulatedCamera& c = s.cameras[0];
  const double bearing = random.uniform(-12, 12) * std::numbers::pi / 180, distance = random.uniform(4.2, 5.2);
  c.position = {distance * std::sin(bearing), s.left_rise + random.uniform(0.7, 1.7), distance * std::cos(bearing)};
  c.roll_deg = rounded(random.uniform(-2, 2), 0.01);
  c.distortion = {rounded(random.uniform(-0.12, 0.02), 1e-4), rounded(random.uniform(-0.01, 0.03), 1e-4),
                  rounded(random.uniform(-5e-4, 5e-4), 1e-6), rounded(random.uniform(-5e-4, 5e-4), 1e-6), 0};
  c.principal = {rounded(959.5 + random.uniform(-12, 12), 0.1), rounded(599.5 + random.uniform(-12, 12), 0.1)};
  if (!aim_camera(s, c)) return std::nullopt;
  round_numbers(s);
  return made;
}

}  // namespace

RigAndRoom default_two_wall() {
  RigAndRoom made = blank();
  Simulation& s = made.simulation;
  s.angle_deg = 97;
  s.left_size = {3.0, 2.0};
  s.right_size = {2.75, 1.85};
  s.left_rise = 0.1;
  s.right_rise = 0.17;
  s.left_albedo = {0.82, 0.80, 0.76};
  s.right_albedo = {0.77, 0.79, 0.81};
  SimulatedProjector &left = s.projectors[0], &right = s.projectors[1];
  left.throw_ratio = 1.25, left.lens_shift = {0.004, 0.22}, left.roll_deg = 0.8, left.falloff = 0.15;
  right.throw_ratio = 1.1, right.lens_shift = {-0.003, 0.15}, right.roll_deg = -1.1, right.falloff = 0.18;
  right.gain = 0.95;
  bool placed = place_projector(made.rig, s, true, {0.12, 0.1, 0.35}, left);
  placed &= place_projector(made.rig, s, false, {-0.2, -0.08, 0.37}, right);
  SimulatedCamera& c = s.cameras[0];
  c.position = {0.35, 1.4, 4.5};
  c.roll_deg = 0.7;
  c.distortion = {-0.08, 0.012, 2e-4, -1e-4, 0};
  c.principal = {962.3, 594.1};
  placed &= aim_camera(s, c);
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
