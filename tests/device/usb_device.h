// A USB device that is a thread of this process: the device's end of the USB/IP protocol (the kernel's
// Documentation/usb/usbip_protocol.rst) on a socket whose other end this machine's own vhci_hcd holds, so that the
// kernel's true drivers bind to it. Needs root and the module vhci_hcd.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <list>
#include <optional>
#include <span>
#include <string>
#include <thread>
#include <vector>

namespace countershade::testing {

using Bytes = std::vector<std::uint8_t>;

// Little-endian numbers at the end of a descriptor, a register or a packet.
void add_number(Bytes& to, std::uint64_t value, int bytes);

// One request of endpoint 0, as USB 2.0 section 9.3 has it.
struct UsbSetup {
  std::uint8_t type = 0, request = 0;
  std::uint16_t value = 0, index = 0, length = 0;
};

struct UsbDescriptors {
  Bytes device, configuration;
  std::vector<std::string> strings;  // number 1, 2, ...
};

class UsbDevice {
 public:
  virtual ~UsbDevice();
  // Plugs it into a free high-speed port. Says why not; empty when done. Serves requests until unplug().
  std::string plug_in();
  void unplug();

 protected:
  // Called from the device's thread. Each returns what to answer; none = stall (the device does not know the request).
  virtual std::optional<Bytes> control(const UsbSetup& setup, const Bytes& data) = 0;
  virtual bool received(int endpoint, const Bytes& data) = 0;
  // At most `room` bytes for a host that waits at an endpoint; none = nothing yet.
  virtual std::optional<Bytes> send(int endpoint, std::size_t room) = 0;
  virtual UsbDescriptors descriptors() const = 0;

 private:
  struct Waiting {
    std::uint32_t number;
    int endpoint;
    std::size_t room;
  };
  void serve();
  bool read_request();
  bool answer_waiting();
  bool reply(std::uint32_t command, std::uint32_t number, int status, std::span<const std::uint8_t> data,
             std::size_t length);
  std::optional<Bytes> standard(const UsbSetup& setup) const;

  int socket_ = -1;
  UsbDescriptors descriptors_;
  std::list<Waiting> waiting_;
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

}  // namespace countershade::testing
