// A USB3 Vision camera of the tests (GenCP over bulk transfers, at high speed: the protocol is the same). What it sees
// is whatever it is given.
#pragma once

#include <atomic>
#include <functional>
#include <string>
#include <vector>

#include "tests/device/usb_device.h"

namespace countershade::testing {

struct U3vOptions {
  int width = 64, height = 48;
  std::string serial = "ROOM3";
  std::vector<std::string> formats = {"Mono8", "Mono16"};
  int cut_every = 0;  // every so manyth photo ends half-way
};

class U3vCamera final : public UsbDevice {
 public:
  // Values of 16 bits, row by row; called once per trigger, from the device's thread, when the exposure ends.
  using Photograph = std::function<std::vector<std::uint16_t>(double exposure_ms)>;
  U3vCamera(U3vOptions options, Photograph photograph);
  ~U3vCamera() override;
  int photos() const { return photos_; }

 protected:
  std::optional<Bytes> control(const UsbSetup&, const Bytes&) override { return std::nullopt; }
  bool received(int endpoint, const Bytes& data) override;
  std::optional<Bytes> send(int endpoint, std::size_t room) override;
  UsbDescriptors descriptors() const override;

 private:
  std::uint32_t get(std::uint32_t at) const;
  void set(std::uint32_t at, std::uint64_t value, int bytes = 4);
  void text(std::uint32_t at, const std::string& value);
  std::size_t photo_size() const;
  void photograph();
  Bytes leader() const;
  Bytes trailer() const;

  const U3vOptions options_;
  const Photograph photograph_;
  Bytes space_, answer_, photo_;
  std::size_t sent_ = 0;
  enum { kWaiting, kPixels, kEnd } stage_ = kWaiting;
  std::uint64_t block_ = 0;
  std::atomic<int> photos_{0};
};

}  // namespace countershade::testing
