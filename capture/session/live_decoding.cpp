#include "capture/session/live_decoding.h"

#include <algorithm>
#include <memory>
#include <utility>

namespace countershade::capture {

namespace {

constexpr int kRestart = -1;

}  // namespace

LiveDecoding::LiveDecoding(std::filesystem::path session, Sequence sequence, std::string camera)
    : folder_(std::move(session)), sequence_(std::move(sequence)), camera_(std::move(camera)) {
  begin();
  worker_ = std::thread([this] { work(); });
}

void LiveDecoding::begin() {
  projectors_.clear();
  for (const auto& [id, resolution] : sequence_.projectors) {
    Pending& pending = projectors_.emplace_back();
    Result<Decoder> decoder = Decoder::make(sequence_, camera_, id, {});
    if (!decoder) {
      pending.result = decoder.error();
      continue;
    }
    const std::vector<int> frames = decoder->frames();
    pending.frames.insert(frames.begin(), frames.end());
    pending.missing = pending.frames;
    pending.decoder = *std::move(decoder);
  }
}

LiveDecoding::~LiveDecoding() {
  {
    const std::lock_guard lock(mutex_);
    drop_ = last_ = true;
  }
  changed_.notify_one();
  if (worker_.joinable()) worker_.join();
}

void LiveDecoding::stored(int frame) {
  {
    const std::lock_guard lock(mutex_);
    queue_.push_back(frame);
  }
  changed_.notify_one();
}

void LiveDecoding::restart() {
  {
    const std::lock_guard lock(mutex_);
    queue_.assign(1, kRestart);
  }
  changed_.notify_one();
}

std::vector<Result<Correspondence>> LiveDecoding::finish() {
  {
    const std::lock_guard lock(mutex_);
    last_ = true;
  }
  changed_.notify_one();
  worker_.join();
  std::vector<Result<Correspondence>> all;
  for (Pending& p : projectors_) all.push_back(p.result ? *std::move(p.result) : p.decoder->finish());
  return all;
}

void LiveDecoding::work() {
  while (true) {
    int frame = 0;
    {
      std::unique_lock lock(mutex_);
      changed_.wait(lock, [this] { return last_ || !queue_.empty(); });
      if (drop_ || queue_.empty()) return;
      frame = queue_.front();
      queue_.pop_front();
    }
    frame == kRestart ? begin() : read(frame);
  }
}

void LiveDecoding::read(int frame) {
  const auto wants = [&](const Pending& p) { return !p.result && p.frames.contains(frame); };
  if (std::none_of(projectors_.begin(), projectors_.end(), wants)) return;
  const auto photo = [&]() -> Result<Photo> {
    if (!session_) {
      CS_TRY(session_, Session::open_unfinished(folder_));
    }
    return session_->photo(camera_, frame);
  }();
  if (!photo) {
    for (Pending& p : projectors_)
      if (wants(p)) p.result = photo.error();
    return;
  }
  const bool one = photo->value.channels() == 1;  // as decode_frames keeps them
  const auto kept = std::make_shared<const StoredPhoto>(
      Photo{one ? photo->value : luminance_mean(photo->value), photo->valid, photo->exposure_ms});
  for (Pending& p : projectors_) {
    if (!wants(p)) continue;
    if (const auto added = p.decoder->add(frame, kept); !added) {
      p.result = added.error();
    } else if (p.missing.erase(frame) > 0 && p.missing.empty()) {
      p.result = p.decoder->finish();
      p.decoder.reset();  // its memory
    }
  }
}

}  // namespace countershade::capture
