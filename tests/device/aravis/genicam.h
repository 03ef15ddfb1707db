// The description (GenICam) and the registers of the tests' machine vision cameras, whatever they are plugged into.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace countershade::testing {

// Registers of 4 bytes, relative to GenicamTransport::base.
enum FeatureRegister : std::uint32_t {
  kWidth = 0xa100,
  kHeight = 0xa104,
  kFormat = 0xa108,
  kExposure = 0xa10c,
  kExposureAuto = 0xa110,
  kRun = 0xa114,
  kTriggerMode = 0xa118,
  kTriggerSource = 0xa11c,
  kTrigger = 0xa120,
  kZero = 0xa124,
  kAcquisitionMode = 0xa128,
};

struct GenicamCamera {
  int width, height;
  std::vector<std::string> formats;
  bool triggered = true;  // else it runs freely
};
struct GenicamTransport {
  std::string name;        // "GEV", "U3V"
  std::string endianness;  // "BigEndian", "LittleEndian"
  std::uint32_t base;
};

std::string genicam_description(const GenicamCamera& camera, const GenicamTransport& transport);

}  // namespace countershade::testing
