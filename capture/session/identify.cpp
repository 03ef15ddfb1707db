#include "capture/session/identify.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <optional>
#include <set>

#include "calib/base/parallel.h"
#include "calib/image/image_file.h"
#include "capture/pattern/identity.h"

namespace countershade::capture {

namespace fs = std::filesystem;

namespace {

constexpr double kMixed = 0.1;    // share of another frame's light that a photo may hold
constexpr double kAsGood = 0.02;  // shares that noise makes differ by as much
constexpr double kMargin = 0.2;   // of a mark's edge, around it: lenses blur, screens bend
constexpr int kNothing = -1;

struct Seen {
  std::vector<SeenMark> marks;  // one per place, those that could not be read left out
  bool all = false;             // there is one of every projector
  int position = kNothing;      // of the frame that all of them agree on
  double share = 0;             // of another frame's light
};

double edge_px(const SeenMark& m) {
  return (m.outline[0] - m.outline[2]).norm() / std::sqrt(2.0);
}

// Places of marks: where they are seen more than once, or where the only photo shows them.
std::vector<SeenMark> places_of(const std::vector<std::vector<SeenMark>>& photos) {
  struct Place {
    SeenMark mean;
    int count = 0;
  };
  std::vector<Place> places;
  int most = 0;
  for (const auto& marks : photos)
    for (const SeenMark& m : marks) {
      auto place = std::find_if(places.begin(), places.end(), [&](const Place& p) {
        return p.mean.projector == m.projector && (p.mean.centre - m.centre).norm() < 0.5 * edge_px(p.mean);
      });
      if (place == places.end()) place = places.insert(places.end(), Place{m, 0});
      const double weight = 1.0 / ++place->count;
      place->mean.centre += weight * (m.centre - place->mean.centre);
      for (int k = 0; k < 4; ++k) place->mean.outline[k] += weight * (m.outline[k] - place->mean.outline[k]);
      most = std::max(most, place->count);
    }
  std::vector<SeenMark> found;
  for (const Place& p : places)
    if (p.count > 1 || most == 1) found.push_back(p.mean);
  return found;
}

Seen agree(const std::vector<SeenMark>& marks, const std::vector<SeenMark>& places) {
  Seen seen;
  std::set<int> wanted, positions;
  for (const SeenMark& place : places) {
    wanted.insert(place.projector);
    for (const SeenMark& m : marks)
      if (m.projector == place.projector && (place.centre - m.centre).norm() < 0.5 * edge_px(place)) {
        seen.marks.push_back(m);
        break;
      }
  }
  for (const SeenMark& m : seen.marks) wanted.erase(m.projector), positions.insert(m.position);
  seen.all = wanted.empty();
  if (seen.all && positions.size() == 1) seen.position = *positions.begin();
  return seen;
}

class Identification {
 public:
  Identification(const Sequence& sequence, const std::vector<fs::path>& photos, const CameraSpec& camera,
                 Progress& progress)
      : sequence_(sequence), photos_(photos), camera_(camera), progress_(progress) {}

  Result<void> find();
  Result<void> measure_shares();
  std::vector<fs::path> choose() const;
  void count(Identified& found) const;
  const std::vector<SeenMark>& places() const { return places_; }

 private:
  int of() const { return static_cast<int>(photos_.size()); }
  template <class Work>
  Result<void> for_all(const char* stage, const Work& work);
  std::vector<int> others(int photo) const;

  const Sequence& sequence_;
  const int frames_ = static_cast<int>(sequence_.frames.size());
  const std::vector<fs::path>& photos_;
  const CameraSpec& camera_;
  Progress& progress_;
  std::vector<SeenMark> places_;
  std::vector<Seen> seen_;
};

// work(photo's index, its light), several at once.
template <class Work>
Result<void> Identification::for_all(const char* stage, const Work& work) {
  constexpr int kChunk = 16;  // photos in memory at a time
  for (int begin = 0; begin < of(); begin += kChunk) {
    progress_.step(stage, begin, of());
    const int count = std::min(kChunk, of() - begin);
    std::vector<std::optional<Error>> failures(count);
    parallel_for(count, [&](int i) {
      const auto photo = read_photo(photos_[begin + i], camera_);
      if (photo)
        work(begin + i, photo->value);
      else
        failures[i] = photo.error();
    });
    for (const auto& failure : failures)
      if (failure) return *failure;
  }
  progress_.step(stage, of(), of());
  return {};
}

Result<void> Identification::find() {
  std::vector<std::vector<SeenMark>> all(photos_.size());
  CS_TRY_VOID(for_all("identify", [&](int i, const Image& light) { all[i] = find_marks(light, sequence_); }));
  places_ = places_of(all);
  for (const auto& marks : all) seen_.push_back(agree(marks, places_));
  if (!places_.empty()) return {};
  return error(ErrorCode::kRefused,
               "none of {} photos of camera '{}' shows a mark of identity, which its sequence has: photograph the "
               "pictures that belong to it, with all of their corners, in focus, not saturated",
               of(), camera_.id);
}

// Frames whose light may be in a photo: those before and after it as they are played, and as they were photographed.
std::vector<int> Identification::others(int photo) const {
  const int own = seen_[photo].position;
  std::vector<int> others{(own + 1) % frames_, (own + frames_ - 1) % frames_};
  for (const int step : {-1, 1})
    for (int i = photo + step; i >= 0 && i < of(); i += step) {
      if (seen_[i].position == kNothing || seen_[i].position == own) continue;
      others.push_back(seen_[i].position);
      break;
    }
  return others;
}

Result<void> Identification::measure_shares() {
  return for_all("check", [&](int i, const Image& light) {
    if (seen_[i].position == kNothing) return;
    const std::vector<int> from = others(i);
    for (const SeenMark& mark : seen_[i].marks)
      for (const int other : from) seen_[i].share = std::max(seen_[i].share, share_of(other, mark, light, sequence_));
  });
}

std::vector<fs::path> Identification::choose() const {
  std::vector<double> least(frames_, kMixed);
  for (const Seen& seen : seen_)
    if (seen.position != kNothing) least[seen.position] = std::min(least[seen.position], seen.share);
  std::vector<fs::path> chosen(frames_);
  std::vector<int> longest(frames_, 0);
  for (int begin = 0, end; begin < of(); begin = end) {
    const int f = seen_[begin].position;
    const auto good = [&](int i) {
      return seen_[i].position == f && seen_[i].share <= std::min(kMixed, least[f] + kAsGood);
    };
    end = begin + 1;
    if (f == kNothing || !good(begin)) continue;
    while (end < of() && good(end)) ++end;
    if (end - begin <= longest[f]) continue;
    longest[f] = end - begin;
    chosen[f] = photos_[begin + (end - begin) / 2];
  }
  return chosen;
}

void Identification::count(Identified& found) const {
  found.marks = static_cast<int>(places_.size());
  for (const Seen& seen : seen_) {
    found.unread += !seen.all;
    found.mixed += seen.all && (seen.position == kNothing || seen.share > kMixed);
  }
}

}  // namespace

bool natural_less(const fs::path& a, const fs::path& b) {
  const std::string one = a.string(), two = b.string();
  const auto digit = [](char c) { return std::isdigit(static_cast<unsigned char>(c)) != 0; };
  std::size_t i = 0, j = 0;
  while (i < one.size() && j < two.size()) {
    if (!digit(one[i]) || !digit(two[j])) {
      if (one[i] != two[j]) return one[i] < two[j];
      ++i, ++j;
      continue;
    }
    const auto number = [&](const std::string& text, std::size_t& at) {
      while (at + 1 < text.size() && text[at] == '0' && digit(text[at + 1])) ++at;
      const std::size_t from = at;
      while (at < text.size() && digit(text[at])) ++at;
      return text.substr(from, at - from);
    };
    const std::string m = number(one, i), n = number(two, j);
    if (m != n) return m.size() != n.size() ? m.size() < n.size() : m < n;
  }
  return std::pair(one.size() - i, one) < std::pair(two.size() - j, two);
}

Result<Identified> identify_photos(const Sequence& sequence, const std::vector<fs::path>& photos,
                                   const CameraSpec& camera, Progress& progress) {
  Identification identification(sequence, photos, camera, progress);
  CS_TRY_VOID(identification.find());
  CS_TRY_VOID(identification.measure_shares());
  Identified found;
  found.photos = identification.choose();
  identification.count(found);
  for (const SeenMark& place : identification.places()) {
    auto& polygon = found.unused.emplace_back();
    for (const Eigen::Vector2d& q : place.outline)
      polygon.push_back(place.centre + (1 + 2 * kMargin) * (q - place.centre));
  }
  return found;
}

}  // namespace countershade::capture
