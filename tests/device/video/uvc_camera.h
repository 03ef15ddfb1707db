// A USB webcam of the tests (USB Video Class 1.1, bulk transfers): the kernel's uvcvideo driver binds to it. What it
// sees is whatever it is given.
#pragma once

#include <array>
#include <functional>

#include "tests/device/usb_device.h"

namespace countershade::testing {

struct UvcOptions {
  int width = 64, height = 48;
  double rate = 20;                                     // photos per second, while the exposure lets it
  std::vector<std::string> formats = {"GREY", "Y16 "};  // of GREY, Y16, YUYV, BA81 (Bayer, blue first)
  int delay = 0;                                        // settings act so many photos later
  int step = 1;                  // exposures are rounded down to so many tenths of a millisecond, silently
  int cut_of = 0;                // one of so many photos ends half-way, at no fixed distance
  bool frozen_exposure = false;  // it reads back what is set, and exposes 10 ms
};

class UvcCamera final : public UsbDevice {
 public:
  // Values of 16 bits, row by row; called once per photo, from the device's thread, when the exposure ends.
  using Photograph = std::function<std::vector<std::uint16_t>(double exposure_ms)>;
  UvcCamera(UvcOptions options, Photograph photograph);
  ~UvcCamera() override;
  int photos() const { return photos_; }

 protected:
  std::optional<Bytes> control(const UsbSetup& setup, const Bytes& data) override;
  bool received(int, const Bytes&) override { return false; }
  std::optional<Bytes> send(int endpoint, std::size_t room) override;
  UsbDescriptors descriptors() const override;

 private:
  using Clock = std::chrono::steady_clock;
  struct Control;
  std::optional<Bytes> stream_control(const UsbSetup& setup, const Bytes& data);
  void photograph();
  const std::string& format() const;

  const UvcOptions options_;
  const Photograph photograph_;
  std::vector<Control> controls_;
  Bytes probe_, commit_;
  std::vector<int> asked_;  // exposures at the latest photos, tenths of a millisecond
  Bytes photo_;             // on its way
  std::size_t sent_ = 0;
  bool streaming_ = false, parity_ = false;
  Clock::time_point next_;
  std::atomic<int> photos_{0};
};

// What the driver of a /dev/video node says of a setting (V4L2_CID_...); -1 where it says nothing.
int read_back(const std::string& node, std::uint32_t what);

}  // namespace countershade::testing
