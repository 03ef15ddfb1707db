#include "simdata/device/timeline.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "calib/base/random.h"

namespace countershade::simdata {

namespace {

constexpr double kMostEdges = 20000;

// A share as a multiple of 2^-24, so that times that add up to the whole exposure give 1.
float snapped(double share) {
  return static_cast<float>(std::ldexp(std::round(std::ldexp(share, 24)), -24));
}

// Position within a period, 0..1.
double phase(double time, double hz) {
  const double turns = time * hz;
  return turns - std::floor(turns);
}

// The light of one picture up to each edge; it grows linearly in between.
struct Sum {
  Shown shown;
  std::vector<Eigen::Array3d> at;
};

}  // namespace

Timeline::Timeline(const SimulatedProjector& spec, std::uint64_t seed, Shown black)
    : spec_(spec),
      seed_(mix(seed) ^ hash_name(spec.id)),
      sent_{{-std::numeric_limits<double>::infinity(), black, black}} {}

double Timeline::first_refresh_after(double time) const {
  return (std::floor(time * spec_.refresh_hz + 1e-6) + 1) / spec_.refresh_hz;  // a refresh is not after itself
}

double Timeline::show(Shown left, Shown right, double now) {
  Random random(mix(seed_ ^ mix(sent_count_++)));
  const double late = (spec_.latency_ms + spec_.latency_jitter_ms * random.uniform()) * 1e-3;
  while (sent_.size() > 1 && sent_[1].from <= now) sent_.erase(sent_.begin());
  const double from = std::max(first_refresh_after(now + late), sent_.back().from);
  sent_.push_back({from, std::move(left), std::move(right)});
  return first_refresh_after(now);
}

std::vector<Timeline::Part> Timeline::parts(const RowExposure& e, const Glasses& glasses, bool without_newest) const {
  const std::size_t count = sent_.size() - (without_newest && sent_.size() > 1 ? 1 : 0);
  const double end = e.exposure + e.rolling;  // relative to the start, as all edges
  std::vector<double> edges{0, end};
  const auto add_periodic = [&](double hz, double most) {
    if (!(hz > 0) || hz * end > most) return false;
    for (double n = std::floor(e.start * hz) + 1; n / hz - e.start < end; ++n) edges.push_back(n / hz - e.start);
    return true;
  };
  bool pair = glasses.left != glasses.right;
  for (std::size_t i = 0; i < count; ++i) {
    const double from = sent_[i].from - e.start;
    if (from > 0 && from < end) edges.push_back(from);
    pair |= sent_[i].left.hash != sent_[i].right.hash;
  }
  const bool wheel = add_periodic(3 * spec_.colour_wheel_hz, kMostEdges),
             pulses = add_periodic(2 * spec_.pwm_hz, kMostEdges);
  if (pair) add_periodic(spec_.refresh_hz, HUGE_VAL);
  std::sort(edges.begin(), edges.end());

  std::vector<Sum> sums;
  for (std::size_t j = 0; j + 1 < edges.size(); ++j) {
    const double middle = e.start + (edges[j] + edges[j + 1]) / 2;
    std::size_t i = count - 1;
    while (i > 0 && sent_[i].from > middle) --i;
    const bool right_eye = std::fmod(std::floor(middle * spec_.refresh_hz), 2) != 0;
    Eigen::Array3d light = Eigen::Array3d::Constant(right_eye ? glasses.right : glasses.left);
    for (int c = 0; c < 3 && wheel; ++c)
      light[c] *= static_cast<int>(3 * phase(middle, spec_.colour_wheel_hz)) == c ? 3 : 0;
    if (pulses) light *= phase(middle, spec_.pwm_hz) < 0.5 ? 2 : 0;
    const Shown& shown = right_eye ? sent_[i].right : sent_[i].left;
    auto sum = std::find_if(sums.begin(), sums.end(), [&](const Sum& s) { return s.shown.hash == shown.hash; });
    if (sum == sums.end()) sum = sums.insert(sums.end(), {shown, {j + 1, Eigen::Array3d::Zero()}});
    for (Sum& s : sums) s.at.push_back(s.at.back());
    sum->at.back() += light * (edges[j + 1] - edges[j]);
  }

  const double lamp = 1 - spec_.warm_up * std::exp(-(e.start + end / 2) / spec_.warm_up_s);
  const auto up_to = [&](const Sum& s, double time) -> Eigen::Array3d {
    const auto above = std::upper_bound(edges.begin() + 1, edges.end() - 1, time);
    const std::size_t j = above - edges.begin();
    const double share = edges[j] > edges[j - 1] ? (time - edges[j - 1]) / (edges[j] - edges[j - 1]) : 0;
    return s.at[j - 1] + share * (s.at[j] - s.at[j - 1]);
  };
  std::vector<Part> parts;
  for (const Sum& s : sums) {
    Part part{s.shown, {}};
    for (int y = 0; y < e.rows; ++y) {
      const double from = e.rows > 1 ? e.rolling * y / (e.rows - 1) : 0;
      const Eigen::Array3d mean = (up_to(s, from + e.exposure) - up_to(s, from)) / e.exposure;
      part.share.emplace_back(snapped(mean[0]), snapped(mean[1]), snapped(mean[2]), 0);
      part.share.back() *= static_cast<float>(lamp);
      if (e.rolling == 0) break;
    }
    const auto same = [&](const Light4& share) { return (share == part.share.front()).all(); };
    if (std::all_of(part.share.begin(), part.share.end(), same)) part.share.resize(1);
    if (part.share.size() > 1 || part.share.front().maxCoeff() > 0) parts.push_back(std::move(part));
  }
  return parts;
}

}  // namespace countershade::simdata
