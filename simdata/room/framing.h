// Placing devices: turning and zooming them until what they shall see or light fills their picture.
#pragma once

#include <optional>
#include <vector>

#include "simdata/room/rooms.h"

namespace countershade::simdata {

std::array<double, 3> array(const Eigen::Vector3d& v);
// To a decimal fraction: unit = 1 / (a power of ten).
double rounded(double value, double unit);
// As a person would type it: millimetres and tenths of a pixel. Nothing depends on more digits.
void round_numbers(Simulation& simulation);

struct Box {
  Eigen::Vector2d low = Eigen::Vector2d::Constant(HUGE_VAL), high = Eigen::Vector2d::Constant(-HUGE_VAL);
};
// Of the points' pixels; none where one is not in front of the device.
std::optional<Box> box_of(const Device& device, const std::vector<Eigen::Vector3d>& points);
// The world point under the pixel that lies `move` from the lens axis' pixel.
std::array<double, 3> turned(const Device& device, const Eigen::Vector2d& move, double distance);

// Turns a camera and sets its focal length so that the points fill the picture but for a rim of 2 %; false where it
// cannot.
bool aim_camera(const std::vector<Eigen::Vector3d>& points, SimulatedCamera& camera);
// Turns a projector and sets its throw ratio so that its picture covers the points, with a rim of 1 %; false where it
// cannot.
bool aim_projector(const std::vector<Eigen::Vector3d>& points, const Rig& rig, SimulatedProjector& projector);

// A camera and projectors with what studies hold fixed (sensor, pictures, black level: the defaults of the structs).
RigAndRoom blank_room(const std::vector<std::string>& projector_ids);

}  // namespace countershade::simdata
