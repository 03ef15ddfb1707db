// A GigE Vision camera of the tests: it answers discovery, registers, triggers and resend requests with real packets
// (GVCP, GVSP) on the loopback interface, has a description (GenICam) of its own, and photographs whatever it is given.
// It can lose packets, be deaf to resend requests, change settings behind one's back, and lie about what it sends.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <thread>
#include <vector>

namespace countershade::testing {

// A network of this process alone, in which loopback is up; so that no camera of another test answers. Says why not,
// where the machine does not allow that; empty when done. Call it before any thread is started.
std::string enter_private_network();

struct GigeOptions {
  int width = 64, height = 48;
  std::string serial = "ROOM1";
  std::string address = "127.0.0.1";
  std::vector<std::string> formats = {"Mono8", "Mono16"};
  int largest_packet = 9000;    // bytes that "the network" lets through, of a packet with its headers
  int drop_every = 0;           // every so manyth stream packet is not sent the first time; 0 = none
  bool deaf = false;            // resend requests are not answered
  double exposure_step_us = 0;  // exposures are rounded to it, silently
  int automatic = 0;            // 1: exposure stays automatic whatever is written
  bool silent = false;          // never sends a photo
  int lines_short = 0;          // a photo has so many lines less than it says
  int claimed_width = 0;        // what a photo says that its width is; 0 = the truth
  bool repeats_frame = false;   // every second photo is the one before, with its number
};

class GigeCamera {
 public:
  // Values of 16 bits, row by row; called once per trigger, from the camera's thread, after the exposure has passed.
  using Photograph = std::function<std::vector<std::uint16_t>(double exposure_ms)>;
  GigeCamera(GigeOptions options, Photograph photograph);
  ~GigeCamera();
  void unplug();  // no answer from now on
  int photos() const { return photos_; }
  int resent() const { return resent_; }

 private:
  struct State;
  void serve();
  std::unique_ptr<State> state_;
  std::atomic<bool> stop_{false};
  std::atomic<int> photos_{0}, resent_{0};
  std::thread thread_;
};

}  // namespace countershade::testing
