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

// What a camera does wrong, in every photo.
enum class GigeFault {
  kNone,
  kShortLeader,   // ends behind its header
  kOtherPayload,  // its leader announces a kind of payload that was not asked for, with 65535 parts
  kTinyPackets,   // packets of 1 to 7 bytes among the others
  kPacketBeyond,  // data packets numbered beyond the photo
  kFarBeyond,     // the same behind a packet that makes Aravis forget how many there are
  kHalfPacket,    // one data packet is half as long as it should be, each time it is sent
  kLongPackets,   // every data packet goes on with what the next one begins with
  kMovedPart,     // one data packet says by itself where it belongs, and that is elsewhere
  kNoData,        // leader and trailer, nothing between
  kNoTrailer,     // also when it is asked for
  kBackwards,     // last packet first
  kInterleaved,   // packets of the photo and of another one in turns
  kNoise,         // random packets before and among the photo's
  kBlockJumps,    // block numbers jump ahead by 30000
  kBlockBack,     // they fall back by 50
  kBlockWraps,    // they are about to begin anew
  kClockBack,     // its clock goes back
  kClockAhead,    // it is centuries ahead
  kHoldsBack,     // every third photo is sent when the next one has been asked for
};

struct GigeOptions {
  int width = 64, height = 48;
  std::string serial = "ROOM1";
  std::string address = "127.0.0.1";
  std::vector<std::string> formats = {"Mono8", "Mono16"};
  int largest_packet = 9000;    // bytes that "the network" lets through, of a packet with its headers
  int drop_every = 0;           // every so manyth stream packet is not sent the first time; 0 = none
  double loss = 0;              // share of stream packets that are lost at random, those sent again too
  bool deaf = false;            // resend requests are not answered
  double exposure_step_us = 0;  // exposures are rounded to it, silently
  int automatic = 0;            // 1: exposure stays automatic whatever is written
  bool silent = false;          // never sends a photo
  int lines_short = 0;          // a photo has so many lines less than it says
  int claimed_width = 0;        // what a photo says that its width is; 0 = the truth
  bool repeats_frame = false;   // every second photo is the one before, with its number
  int unplug_after = 0;         // it is unplugged when it has taken so many photos; 0 = never
  bool runs_freely = false;     // cannot be triggered; exposes one photo while it sends the one before
  bool blanks = false;          // in the place of its description
  int obeys_after = 0;          // so many photos pass until one has the exposure that was set
  GigeFault fault = GigeFault::kNone;
  std::string description = "";         // instead of the right one; "" = that
  std::size_t claimed_description = 0;  // bytes that it says it has; 0 = the truth
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
  double cpu_s() const;  // that the camera itself has used

 private:
  struct State;
  void serve();
  std::unique_ptr<State> state_;
  std::atomic<bool> stop_{false};
  std::atomic<int> photos_{0}, resent_{0};
  std::thread thread_;
};

}  // namespace countershade::testing
