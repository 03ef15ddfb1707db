// Decoding while the photos are taken: over when capture is.
#pragma once

#include <condition_variable>
#include <deque>
#include <filesystem>
#include <map>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "calib/file/session.h"
#include "capture/pattern/decode.h"

namespace countershade::capture {

// Reads one camera's photos of a session that is being captured, in a thread of its own, as they are stored (what
// CaptureOptions::stored tells). What it gives is what decode() gives for the finished session, bit for bit.
class LiveDecoding {
 public:
  LiveDecoding(std::filesystem::path session, Sequence sequence, std::string camera);
  LiveDecoding(const LiveDecoding&) = delete;
  LiveDecoding& operator=(const LiveDecoding&) = delete;
  ~LiveDecoding();  // drops what is not decoded yet

  // The photos of a frame (its index) stand in the session, or have taken the place of others.
  void stored(int frame);
  // All photos have been set aside (CaptureOptions::set_aside): nothing that was told before counts.
  void restart();
  // Waits for what is left, once. Per projector, in the order of the sequence; those whose frames are not all there are
  // errors (kRefused).
  std::vector<Result<Correspondence>> finish();

 private:
  struct Pending {
    std::optional<Decoder> decoder;
    std::set<int> frames, missing;  // of its code; not seen yet
    std::optional<Result<Correspondence>> result;
  };
  void begin();
  void work();
  void read(int frame);

  std::filesystem::path folder_;
  Sequence sequence_;
  std::string camera_;
  std::vector<Pending> projectors_;
  std::optional<Session> session_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<int> queue_;  // of frames, or kRestart
  bool last_ = false, drop_ = false;
  std::thread worker_;
};

}  // namespace countershade::capture
