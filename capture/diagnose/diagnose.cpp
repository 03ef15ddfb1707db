#include "capture/diagnose/diagnose.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <optional>

#include "calib/base/parallel.h"
#include "capture/diagnose/signs.h"
#include "capture/diagnose/trial.h"
#include "capture/pattern/pattern.h"
#include "capture/pattern/plan.h"

namespace countershade::capture {

namespace {

constexpr double kLeast = 0.5, kGain = 0.15;  // what an edit must reach, and gain, to be named
constexpr double kRival = 0.03;               // edits that come as near to the best one are named, too
constexpr double kMirrored = 0.8;             // share of places that makes a view a mirrored one

bool is_code(const Role& role) {
  return role.kind == "gray" || role.kind == "xor" || role.kind == "phase";
}

// A sequence that would be right if one likely mistake had been made.
struct Edit {
  std::string name;
  Sequence sequence;
  std::string if_so;   // "with x and y exchanged"
  std::string remedy;  // a question or what to do
};

// ---- edits ----

class Editor {
 public:
  Editor(const Sequence& given, const std::string& projector) : given_(given), projector_(projector) {}

  Edit swapped_axes() const;
  Edit swapped_levels() const;
  Edit exchanged_code(const std::string& other) const;
  Edit without_bounds() const;
  std::vector<Edit> of_axis() const;
  // From position k on, photos are `step` = 1 late or -1 early.
  Edit shifted(int k, int step) const;
  bool belongs(const Frame& frame) const {
    return frame.role.projector == projector_ || (given_.projectors.size() == 1 && frame.role.projector.empty());
  }
  bool codes_axis(const Frame& frame, int axis) const {
    return belongs(frame) && is_code(frame.role) && frame.role.axis == (axis ? "y" : "x");
  }
  bool has(int axis) const {
    return std::any_of(given_.frames.begin(), given_.frames.end(), [&](const Frame& f) { return codes_axis(f, axis); });
  }

 private:
  Sequence changed(const std::function<void(Role&)>& change) const {
    Sequence sequence = given_;
    for (Frame& frame : sequence.frames)
      if (belongs(frame)) change(frame.role);
    return sequence;
  }
  int highest_bit(const Role& like) const;
  int inverse_of(int position) const;

  const Sequence& given_;
  const std::string& projector_;
};

Edit Editor::swapped_axes() const {
  return {"axes-swapped", changed([](Role& r) {
            if (is_code(r)) r.axis = r.axis == "x" ? "y" : "x";
          }),
          "with x and y exchanged", "Is `axis` right in sequence.json?"};
}

Edit Editor::swapped_levels() const {
  return {"levels-swapped", changed([](Role& r) {
            if (r.kind == "white")
              r.kind = "black";
            else if (r.kind == "black")
              r.kind = "white";
          }),
          "with the white and the black frame exchanged", "Exchange `white` and `black` in sequence.json."};
}

Edit Editor::exchanged_code(const std::string& other) const {
  Edit edit{"projectors-exchanged", given_, fmt::format("with the code of projector '{}'", other),
            fmt::format("Are photos of '{}' and '{}' exchanged, or `projector` in sequence.json?", projector_, other)};
  for (Frame& frame : edit.sequence.frames) {
    if (!is_code(frame.role)) continue;
    std::string& name = frame.role.projector;
    if (name == projector_)
      name = other;
    else if (name == other)
      name = projector_;
  }
  return edit;
}

Edit Editor::without_bounds() const {
  Edit edit{"other-projector", given_, "", ""};
  for (auto& [id, resolution] : edit.sequence.projectors)
    if (id == projector_)
      for (const Frame& f : given_.frames)
        if (belongs(f) && (f.role.kind == "gray" || f.role.kind == "xor")) {
          int& length = resolution[f.role.axis == "x" ? 0 : 1];
          length = std::max(length, f.role.cell_px << (f.role.bit + 1));
        }
  return edit;
}

int Editor::highest_bit(const Role& like) const {
  int highest = 0;
  for (const Frame& f : given_.frames)
    if (belongs(f) && (f.role.kind == "gray" || f.role.kind == "xor") && f.role.axis == like.axis)
      highest = std::max(highest, f.role.bit);
  return highest;
}

std::vector<Edit> Editor::of_axis() const {
  std::vector<Edit> edits;
  const auto bits = [](const Role& r) { return r.kind == "gray" || r.kind == "xor"; };
  const auto any = [&](const auto& what) {
    return std::any_of(given_.frames.begin(), given_.frames.end(),
                       [&](const Frame& f) { return belongs(f) && what(f.role); });
  };
  if (any(bits)) {
    edits.push_back({"inverse-swapped", changed([&](Role& r) {
                       if (bits(r)) r.inverse = !r.inverse;
                     }),
                     "with `inverse` exchanged",
                     "Is `inverse` true where the stripes are the complement (lit where the bit is 0)?"});
    const Edit reversed{"bits-reversed", changed([&](Role& r) {
                          const int top = highest_bit(r);
                          if (bits(r)) r.bit = top - r.bit;
                          if (r.kind == "xor") r.base = top - r.base;
                        }),
                        "with the bits in reverse order", "Bit 0 in sequence.json is that of the finest stripes."};
    edits.push_back(reversed);
  }
  if (any([](const Role& r) { return r.kind == "xor"; })) {
    // The photos were taken in reverse order, rather than numbered so: the frame of bit b has the photo of top - b.
    Edit edit{"bits-reversed", given_, "with the photos of the bits in reverse order",
              "Bit 0 in sequence.json is that of the finest stripes."};
    for (Frame& frame : edit.sequence.frames)
      for (const Frame& f : given_.frames)
        if (belongs(frame) && belongs(f) && bits(frame.role) && bits(f.role) && f.role.axis == frame.role.axis &&
            f.role.inverse == frame.role.inverse && f.role.bit == highest_bit(frame.role) - frame.role.bit)
          frame.index = f.index;
    edits.push_back(edit);
  }
  if (any([](const Role& r) { return r.kind == "phase"; }))
    edits.push_back({"steps-reversed", changed([](Role& r) {
                       if (r.kind == "phase") r.shift_rad = -wave_shift(r);
                     }),
                     "with the shifts of its sinusoids reversed",
                     "Is `step` (or the sign of `shift_rad`) right in sequence.json? The sinusoid is "
                     "cos(2 pi x / period_px + 2 pi step / steps)."});
  return edits;
}

int Editor::inverse_of(int position) const {
  Role inverse = given_.frames[position].role;
  inverse.inverse = !inverse.inverse;
  for (int i = 0; i < static_cast<int>(given_.frames.size()); ++i)
    if (is_code(inverse) && inverse.kind != "phase" && given_.frames[i].role == inverse) return i;
  return -1;
}

Edit Editor::shifted(int k, int step) const {
  const Frame& at = given_.frames[k];
  const std::string frame = fmt::format("frame {} ({})", at.index, at.role.name());
  Edit edit{step > 0 ? "frame-doubled" : "frame-missing", {}, "", ""};
  edit.if_so =
      step > 0
          ? fmt::format("if the photo of {} is one too many and each photo behind it shows the frame before its own",
                        frame)
          : fmt::format("if {} was not photographed and each photo from there on shows the frame after its own", frame);
  edit.remedy = step > 0 ? "A photo is doubled or foreign there: remove it and number those behind it anew."
                         : "It was not photographed: photograph again, or take the frame out of sequence.json and "
                           "number the photos anew.";
  edit.sequence.projectors = given_.projectors;
  const int count = static_cast<int>(given_.frames.size());
  const auto photo_of = [&](int position) {  // -1: there is none
    if (position < k) return given_.frames[position].index;
    if (step < 0 && position == k) return -1;
    return position + step < count ? given_.frames[position + step].index : -1;
  };
  for (int i = 0; i < count; ++i) {
    Frame moved = given_.frames[i];
    moved.index = photo_of(i);
    if (moved.index < 0) {
      const int partner = inverse_of(i);
      if (partner < 0 || photo_of(partner) < 0) continue;
      moved.index = Trial::complement_of(photo_of(partner));
    }
    edit.sequence.frames.push_back(moved);
  }
  return edit;
}

// ---- trying them ----

struct Tried {
  Edit edit;
  Trial::Fit fit[2];
  double total = 0;              // mean share of the axes, those that the edit leaves alone included
  double before = 0, after = 0;  // of those that it is about
  int axis = -1;                 // -1: both
  bool twice = false;            // shifted photos: the one in question is that of its neighbour
};

class Trials {
 public:
  Trials(const Sequence& given, const std::string& projector, Trial& trial)
      : given_(given), projector_(projector), editor_(given, projector), trial_(trial) {
    for (int a = 0; a < 2; ++a) {
      has_[a] = editor_.has(a);
      if (has_[a]) as_given_[a] = trial_.fit(given, a);
    }
  }
  double total(const Trial::Fit (&fit)[2]) const {
    return (has_[0] * fit[0].share + has_[1] * fit[1].share) / std::max(1, has_[0] + has_[1]);
  }
  double as_given() const { return total(as_given_); }
  std::vector<Tried> all();
  Tried whole(const Edit& edit);

 private:
  std::vector<Tried> by_axis();
  std::optional<Tried> best_shift(int step);
  bool is_twice(int position);
  Tried unbounded();
  Tried tried(const Edit& edit, const Trial::Fit (&fit)[2]) const;

  const Sequence& given_;
  const std::string& projector_;
  Editor editor_;
  Trial& trial_;
  bool has_[2];
  Trial::Fit as_given_[2];
};

Tried Trials::tried(const Edit& edit, const Trial::Fit (&fit)[2]) const {
  Tried t{edit, {fit[0], fit[1]}, total(fit), as_given(), total(fit), -1};
  return t;
}

Tried Trials::whole(const Edit& edit) {
  Trial::Fit fit[2];
  for (int a = 0; a < 2; ++a) fit[a] = trial_.fit(edit.sequence, a);
  Tried t = tried(edit, fit);
  if (has_[0] != has_[1]) t.total = t.after = std::max(fit[0].share, fit[1].share);  // an edit may move the code
  return t;
}

// Mistakes that are made on one axis or on both, the best of each axis.
std::vector<Tried> Trials::by_axis() {
  std::vector<Tried> found;
  for (int a = 0; a < 2; ++a) {
    if (!has_[a]) continue;
    std::optional<Tried> best;
    for (const Edit& edit : editor_.of_axis()) {
      Trial::Fit fit[2] = {as_given_[0], as_given_[1]};
      fit[a] = trial_.fit(edit.sequence, a);
      Tried t = tried(edit, fit);
      t.before = as_given_[a].share, t.after = fit[a].share, t.axis = a;
      if (!best || t.after > best->after) best = t;
    }
    if (best) found.push_back(*best);
  }
  const auto clear = [](const Tried& t) { return t.after >= kLeast && t.after >= t.before + kGain; };
  if (found.size() < 2 || !clear(found[0]) || !clear(found[1])) return found;
  // On both axes: the share is that of both.
  const Trial::Fit fit[2] = {found[0].fit[0], found[1].fit[1]};
  const double both = total(fit);
  if (found[0].edit.name != found[1].edit.name) {
    for (Tried& t : found) t.total = both;
    return found;
  }
  return {tried(found[0].edit, fit)};
}

// Every position is tried in a few places, the best of them in all.
std::optional<Tried> Trials::best_shift(int step) {
  const auto few = [&](const Sequence& sequence) {
    Trial::Fit fit[2];
    for (int a = 0; a < 2; ++a)
      if (has_[a]) fit[a] = trial_.fit(sequence, a, true);
    return total(fit);
  };
  double best = few(given_) + kGain;
  int position = -1;
  for (int k = 0; k < static_cast<int>(given_.frames.size()); ++k) {
    if (!editor_.belongs(given_.frames[k]) || !is_code(given_.frames[k].role)) continue;
    if (const double share = few(editor_.shifted(k, step).sequence); share > best) best = share, position = k;
  }
  if (position < 0) return std::nullopt;
  Tried t = whole(editor_.shifted(position, step));
  t.twice = is_twice(position);
  return t;
}

// Whether the photo of a position is also that of one beside it.
bool Trials::is_twice(int position) {
  for (int k = position - 1; k <= position + 1; ++k)
    if (k > 0 && k < static_cast<int>(given_.frames.size()) && is_code(given_.frames[k].role) &&
        is_code(given_.frames[k - 1].role) && trial_.same(given_.frames[k - 1].index, given_.frames[k].index))
      return true;
  return false;
}

// What the code says when nothing bounds it, and who could have shown that.
Tried Trials::unbounded() {
  Tried t = whole(editor_.without_bounds());
  t.total -= kRival;  // it may read anything: an edit that keeps within the resolution is the better answer
  std::array<int, 2> own{0, 0};
  for (const auto& [id, resolution] : given_.projectors)
    if (id == projector_) own = resolution;
  t.edit.if_so =
      fmt::format("when columns up to {:.0f} and rows up to {:.0f} are let pass, but sequence.json says {} x {}",
                  t.fit[0].highest, t.fit[1].highest, own[0], own[1]);
  t.edit.remedy = "Are these photos of another projector, or is its resolution wrong?";
  for (const auto& [id, resolution] : given_.projectors)
    if (id != projector_ && t.fit[0].highest < resolution[0] && t.fit[1].highest < resolution[1]) {
      t.edit.name = "projectors-exchanged";
      t.edit.remedy =
          fmt::format("Projector '{}' has {} x {}: are photos of the two exchanged, or `projector` in sequence.json?",
                      id, resolution[0], resolution[1]);
    }
  return t;
}

std::vector<Tried> Trials::all() {
  std::vector<Tried> all = by_axis();
  all.push_back(whole(editor_.swapped_axes()));
  all.push_back(whole(editor_.swapped_levels()));
  for (const auto& [id, resolution] : given_.projectors)
    if (id != projector_) all.push_back(whole(editor_.exchanged_code(id)));
  all.push_back(unbounded());
  auto missing = best_shift(-1);
  const auto doubled = best_shift(1);
  // Where all photos are a pair too early, each bit reads as the next finer one: a map of half the scale, as smooth as
  // the true one. But then a photo is there twice.
  if (missing && doubled && missing->twice && doubled->total > missing->total - kRival) missing.reset();
  if (missing) all.push_back(*missing);
  if (doubled) all.push_back(*doubled);
  std::erase_if(all, [](const Tried& t) { return t.after < kLeast || t.after < t.before + kGain; });
  std::stable_sort(all.begin(), all.end(), [](const Tried& a, const Tried& b) { return a.total > b.total; });
  if (!all.empty()) std::erase_if(all, [best = all[0].total](const Tried& t) { return t.total < best - kRival; });
  return all;
}

Finding finding_of(const Tried& t, const Suspect& suspect) {
  const std::string where = t.axis < 0 ? "" : fmt::format(" on axis {}", t.axis ? "y" : "x");
  return {t.edit.name, t.before, t.after,
          fmt::format("camera '{}', projector '{}': {:.0f} % of the lit pixels fit their neighbours{} {}, {:.0f} % as "
                      "given. {}",
                      suspect.camera, suspect.projector, 100 * t.after, where, t.edit.if_so, 100 * t.before,
                      t.edit.remedy)};
}

// ---- what a view and its photos give away ----

// Whether the numbers of bits, or the longest sinusoids, fit the resolution better with x and y exchanged.
bool lengths_say_swapped(const CodePlan& plan) {
  const auto fits = [&](int code, int length) {
    const AxisCode& axis = plan.axis[code];
    const int pixels = plan.axis[length].length_px;
    if (!axis.bits.empty())
      return static_cast<int>(axis.bits.size()) == gray_bits((pixels + axis.cell_px - 1) / axis.cell_px);
    double longest = 0;
    for (const WaveFrame& wave : axis.waves) longest = std::max(longest, wave.period_px);
    return std::abs(longest - pixels) < 0.5;
  };
  if (!plan.axis[0].exists() || !plan.axis[1].exists()) return false;
  return fits(0, 1) && fits(1, 0) && !fits(0, 0) && !fits(1, 1);
}

Finding mirrored(const Handedness& h, const CodePlan& plan, const Suspect& suspect) {
  const bool waves = !plan.axis[0].waves.empty() || !plan.axis[1].waves.empty();
  return {"mirrored", static_cast<double>(h.places), h.mirrored,
          fmt::format("camera '{}' sees projector '{}' mirrored (in {:.0f} % of {} places). A screen lit from behind "
                      "looks like that, and light by way of a mirror; the geometry cannot be right with a mirror, "
                      "flipped photos{} or x and y exchanged: flip the photos or the projector's picture back, or "
                      "correct sequence.json.",
                      suspect.camera, suspect.projector, 100 * h.mirrored, h.places,
                      waves ? ", sinusoids that step backwards" : "")};
}

// White, black, and the finest pair of stripes; white and black from the coarsest pair where they were not shown.
struct Plain {
  Image white, black, a, b;
  Mask valid;
  bool pair = false;
};

std::optional<Plain> plain_photos(const CodePlan& plan, const PhotoSource& photos) {
  const AxisCode& code = plan.axis[plan.axis[0].bits.empty() ? 1 : 0];
  std::vector<int> wanted = {plan.white, plan.black};
  const bool levels = plan.white >= 0 && plan.black >= 0;
  if (!levels && code.bits.empty()) return std::nullopt;
  if (!levels) wanted = {code.bits.back().plain, code.bits.back().inverse};
  if (!code.bits.empty()) wanted.push_back(code.bits[0].plain), wanted.push_back(code.bits[0].inverse);
  std::vector<std::optional<Photo>> read(wanted.size());
  parallel_for(static_cast<int>(wanted.size()), [&](int k) {
    if (auto photo = photos(wanted[k])) photo->value = luminance_mean(photo->value), read[k] = *std::move(photo);
  });
  for (const auto& photo : read)
    if (!photo || !photo->value.same_size(read[0]->value.width(), read[0]->value.height())) return std::nullopt;
  Plain plain{read[0]->value, read[1]->value, {}, {}, read[0]->valid, read.size() > 2};
  for (const auto& photo : read)
    for (std::size_t i = 0; i < plain.valid.data().size(); ++i) plain.valid.data()[i] &= photo->valid.data()[i];
  if (plain.pair) plain.a = read[2]->value, plain.b = read[3]->value;
  if (!levels)
    for (std::size_t i = 0; i < plain.white.data().size(); ++i)
      if (plain.white.data()[i] < plain.black.data()[i]) std::swap(plain.white.data()[i], plain.black.data()[i]);
  return plain;
}

// What to state instead of `response` when photos are still off by an exponent.
std::string mended_response(const std::string& response, double exponent) {
  double stated = 1;
  if (response == "srgb") stated = 2.2;
  if (response.rfind("gamma:", 0) == 0) stated = std::strtod(response.c_str() + 6, nullptr);
  const double total = std::clamp(stated * exponent, 0.2, 5.0);
  if (std::abs(total - 1) < 0.1) return "response = \"linear\"";
  return fmt::format("response = \"gamma:{:.1f}\"{}", total,
                     total > 1.9 && total < 2.6 ? " (or \"srgb\", if that is what it writes)" : "");
}

void look_at_photos(const Plain& plain, const Suspect& suspect, std::vector<Finding>& findings) {
  if (plain.pair)
    if (const auto sum = pair_sum(plain.white, plain.black, plain.a, plain.b, plain.valid); sum && sum->gamma())
      findings.push_back(
          {"gamma-encoded", 1, sum->exponent,
           fmt::format(
               "photos of camera '{}' are not linear light: where a pattern is half lit, it and its inverse add "
               "up to {:.0f} % of white too {} ({} pixels); raised to {:.2f} they add up. Gamma-encoded? State "
               "{} for this camera in rig.toml, which says \"{}\", or store linear photos.",
               suspect.camera, 100 * std::abs(sum->excess), sum->excess > 0 ? "much" : "little", sum->half,
               sum->exponent, mended_response(suspect.response, sum->exponent), suspect.response)});
  if (const Blockiness b = blockiness(plain.white); b.compressed)
    findings.push_back({"jpeg", b.inside, b.across,
                        fmt::format("photos of camera '{}' were JPEG-compressed: steps across the borders of 8 x 8 "
                                    "blocks are {:.0f} % larger than inside them ({:.0f} sigma). Fine stripes and dim "
                                    "light are lost in it: store photos without loss (raw, TIFF, PNG), and not "
                                    "converted from JPEG.",
                                    suspect.camera, 100 * (b.across / b.inside - 1), b.sigmas)});
}

// Whether a picture that differs from projector to projector agrees with another one's better than with its own.
std::optional<Finding> check_exchange(const Sequence& sequence, const PhotoSource& photos, const Plain& plain,
                                      const Suspect& suspect) {
  const auto frame = std::find_if(sequence.frames.begin(), sequence.frames.end(),
                                  [](const Frame& f) { return f.role.kind == "held-out" && f.role.projector.empty(); });
  if (frame == sequence.frames.end() || sequence.projectors.size() < 2) return std::nullopt;
  const Correspondence& c = *suspect.decoded;
  const auto read = photos(frame->index);
  if (!read || !plain.white.same_size(c.x.width(), c.x.height())) return std::nullopt;
  const Image photo = luminance_mean(read->value);
  const auto agrees = [&](const std::string& id) -> double {
    const auto picture = render_role(frame->role, id, c.projector_resolution[0], c.projector_resolution[1]);
    if (!picture) return 0;
    return agreement(c, *picture, photo, plain.white, plain.black).value_or(0);
  };
  const double own = agrees(suspect.projector);
  std::optional<Finding> found;
  for (const auto& [id, resolution] : sequence.projectors) {
    if (id == suspect.projector) continue;
    const double other = agrees(id);
    if (other < 0.6 || other < own + 0.2 || (found && found->if_so > other)) continue;
    found = Finding{
        "projectors-exchanged", own, other,
        fmt::format("camera '{}', projector '{}': the photo of {} agrees with what projector '{}' showed "
                    "in it (correlation {:.2f}), not with what '{}' did ({:.2f}). Are photos of the two "
                    "exchanged, or `projector` in sequence.json, or the cables?",
                    suspect.camera, suspect.projector, fmt::format("frame {} ({})", frame->index, frame->role.name()),
                    id, other, suspect.projector, own)};
  }
  return found;
}

// Edits of the sequence, tried in a few places. `mirrored`: the view is, or nullptr.
std::vector<Finding> try_edits(const Sequence& sequence, const PhotoSource& photos, const Suspect& suspect,
                               const CodePlan* plan, const Handedness* mirrored, bool poor) {
  std::vector<Finding> findings;
  auto trial = Trial::of(sequence, photos, suspect.projector);
  if (!trial) return findings;
  Trials trials(sequence, suspect.projector, *trial);
  if (poor)
    for (const Tried& t : trials.all()) findings.push_back(finding_of(t, suspect));
  if (!mirrored || !findings.empty()) return findings;
  // The wrong handedness is evidence, too. Beside it is enough: code that is as long as the other axis; a picture that
  // stands upright or on its head once x and y are exchanged (a mirror would have to come with a camera on its side); a
  // twentieth that leaves the resolution as given.
  const Tried swapped = trials.whole(Editor(sequence, suspect.projector).swapped_axes());
  const bool lengths = plan && lengths_say_swapped(*plan), upright = mirrored->crossed > kMirrored;
  if (swapped.after > swapped.before - 0.05 && (lengths || upright || swapped.after > swapped.before + 0.05)) {
    findings.push_back(finding_of(swapped, suspect));
    std::string& text = findings.back().sentence;
    if (lengths) text += " The code of each axis is as long as the other axis needs it.";
    text += upright ? " As given, the picture is mirrored and lies on its side; exchanged, it is neither."
                    : " As given, the picture is mirrored.";
  }
  return findings;
}

}  // namespace

bool reads_poorly(const Correspondence& c, const Sequence& sequence) {
  constexpr double kGood = 0.75;  // what is left without any fault: edges, shadows and light by way of other surfaces
  if (static_cast<double>(c.accepted) < kGood * static_cast<double>(c.lit)) return true;
  const int stride = std::clamp(std::min(c.reason.width(), c.reason.height()) / 400, 1, 3);
  const int extent = (kPatch - 1) * stride + 1;
  Mask accepted = c.reason;
  for (std::uint8_t& a : accepted.data()) a = a == 0;
  const auto plan = plan_code(sequence, c.projector);
  for (int axis = 0; axis < 2; ++axis) {
    const Image& q = axis ? c.y : c.x;
    const AxisCode* code = plan ? &plan->axis[axis] : nullptr;
    const float reach = code && code->waves.empty() ? 1.6f * static_cast<float>(code->cell_px) : 1.5f;
    double fits = 0, counted = 0;
    for (int row = 0; row < 6; ++row)
      for (int column = 0; column < 8; ++column) {
        const int x = column * (c.reason.width() - extent) / 7, y = row * (c.reason.height() - extent) / 5;
        if (x < 0 || y < 0) continue;
        int count = 0;
        fits += share_on_plane(q, accepted, x, y, stride, reach, count) * count, counted += count;
      }
    if ((!code || code->exists()) && fits < kGood * counted) return true;
  }
  return false;
}

std::vector<Finding> diagnose(const Sequence& sequence, const PhotoSource& photos, const Suspect& suspect) {
  std::vector<Finding> findings;
  const auto plan = plan_code(sequence, suspect.projector);
  const Correspondence* c = suspect.decoded;
  const Handedness hand = c ? handedness(*c) : Handedness{};
  const bool is_mirrored = hand.places >= 200 && hand.mirrored > kMirrored;
  const bool poor = !c || reads_poorly(*c, sequence);
  if (poor || is_mirrored)
    findings = try_edits(sequence, photos, suspect, plan ? &*plan : nullptr, is_mirrored ? &hand : nullptr, poor);
  const bool explained = std::any_of(findings.begin(), findings.end(), [](const Finding& f) {
    return f.name == "axes-swapped" || f.name == "steps-reversed";
  });
  if (!plan) return findings;
  if (is_mirrored && !explained) findings.push_back(mirrored(hand, *plan, suspect));
  const bool exchange = c && sequence.projectors.size() > 1;
  if (!suspect.photos_too && !exchange) return findings;
  const auto plain = plain_photos(*plan, photos);
  if (!plain) return findings;
  if (exchange && findings.empty())
    if (const auto found = check_exchange(sequence, photos, *plain, suspect)) findings.push_back(*found);
  if (suspect.photos_too) look_at_photos(*plain, suspect, findings);
  return findings;
}

std::string text_of(const std::vector<Finding>& findings) {
  std::string text;
  for (const Finding& f : findings) text += (text.empty() ? "" : " ") + f.sentence;
  return text;
}

}  // namespace countershade::capture
