#include "tools/bench/decode/decode_trial.h"

#include <cmath>
#include <limits>

#include "capture/pattern/pattern.h"
#include "tools/job/devices.h"

namespace countershade::bench {

Result<DecodeRig> DecodeRig::make(const simdata::RigAndRoom& room, Progress& progress) {
  DecodeRig made;
  CS_TRY(made.simulator_, simdata::Simulator::make(room.rig, room.simulation, progress));
  made.truth_ = made.simulator_->geometry(0);
  return made;
}

Result<DecodeRig::Photos> DecodeRig::photograph(int projector, const std::vector<Role>& roles) const {
  const capture::Devices devices = simdata::simulated_devices(simulator_);
  const ProjectorSpec& spec = rig().projectors[projector];
  CS_TRY_VOID(devices.cameras[0]->arm(0));
  for (const auto& p : devices.projectors) CS_TRY_VOID(p->show(Picture(p->width(), p->height(), 3)));
  Photos taken;
  taken.sequence.projectors = {{spec.id, spec.resolution}};
  for (const Role& role : roles) {
    CS_TRY(const Picture picture, capture::render_role(role, spec.id, spec.resolution[0], spec.resolution[1]));
    CS_TRY_VOID(devices.projectors[projector]->show(picture));
    CS_TRY(const capture::Exposure exposure, devices.cameras[0]->trigger());
    taken.sequence.frames.push_back({static_cast<int>(taken.photos.size()), role});
    taken.photos.push_back(tools::photo_of(exposure, rig().cameras[0]));
  }
  return taken;
}

Result<std::vector<Role>> roles_of(const std::string& code, const ProjectorSpec& projector, bool levels) {
  std::vector<Role> roles;
  Role role;
  role.projector = projector.id;
  if (levels)
    for (const char* kind : {"white", "black"}) role.kind = kind, roles.push_back(role);
  CS_TRY(const std::vector<Role> code_roles, capture::code_roles(code, projector));
  roles.insert(roles.end(), code_roles.begin(), code_roles.end());
  return roles;
}

namespace {

// How far a reading is from the truth of a pixel whose centre is not lit but whose neighbours are: that truth is
// continued from two lit pixels on the side that fits best, and what such a pixel receives comes from up to a pixel
// away. NaN where there are no such neighbours.
double off_border(const Image& truth, int u, int v, double read) {
  double best = std::numeric_limits<double>::quiet_NaN();
  for (int dv = -1; dv <= 1; ++dv)
    for (int du = -1; du <= 1; ++du) {
      const int fu = u + 2 * du, fv = v + 2 * dv;
      if (fu < 0 || fv < 0 || fu >= truth.width() || fv >= truth.height()) continue;
      const double near = truth.at(u + du, v + dv), slope = near - truth.at(fu, fv);
      const double off = std::max(0.0, std::abs(near + slope - read) - std::abs(slope));
      if (std::isfinite(off) && !(off >= best)) best = off;
    }
  return best;
}

}  // namespace

DecodeScore score_decode(const simdata::TrueGeometry& truth, int projector, const capture::Correspondence& c) {
  const Image &tx = truth.projector_x[projector], &ty = truth.projector_y[projector];
  struct Box {
    double n = 0, x = 0, y = 0, variance = 0;
  };
  constexpr int kSide = 16;
  const int across = tx.width() / kSide + 1;
  std::vector<Box> boxes(static_cast<std::size_t>(across) * (tx.height() / kSide + 1));
  DecodeScore s;
  double squares = 0, good = 0;
  for (int v = 0; v < tx.height(); ++v)
    for (int u = 0; u < tx.width(); ++u) {
      const bool lit = std::isfinite(tx.at(u, v));
      s.visible += lit;
      if (c.reason.at(u, v)) continue;
      s.accepted += 1, s.covered += lit;
      const double qx = c.x.at(u, v), qy = c.y.at(u, v);
      const double ex = lit ? qx - tx.at(u, v) : off_border(tx, u, v, qx),
                   ey = lit ? qy - ty.at(u, v) : off_border(ty, u, v, qy);
      if (!(std::max(std::abs(ex), std::abs(ey)) <= 1)) {
        s.wrong += 1;
        continue;
      }
      if (!lit) continue;
      const double variance = c.sigma.at(u, v) * c.sigma.at(u, v);
      good += 1, squares += (ex * ex + ey * ey) / 2, s.z2 += (ex * ex + ey * ey) / 2 / variance;
      Box& box = boxes[static_cast<std::size_t>(v / kSide) * across + u / kSide];
      box.n += 1, box.x += ex, box.y += ey, box.variance += ex * ex + ey * ey;
    }
  if (good == 0) return s;
  s.rms = std::sqrt(squares / good), s.z2 /= good;
  double sum = 0, count = 0;
  for (const Box& b : boxes) {
    if (b.n < kSide * kSide / 2) continue;
    const double mean = (b.x * b.x + b.y * b.y) / (b.n * b.n);
    sum += std::max(0.0, mean - (b.variance / b.n - mean) / b.n) / 2, count += 1;
  }
  s.bias = count > 0 ? std::sqrt(sum / count) : std::numeric_limits<double>::quiet_NaN();
  s.random = std::sqrt(std::max(0.0, s.rms * s.rms - s.bias * s.bias));
  return s;
}

Result<capture::Correspondence> decode_by_fixed_thresholds(const DecodeRig::Photos& taken,
                                                           const ProjectorSpec& projector) {
  constexpr float kDark = 40 / 255.0f, kLeast = 5 / 255.0f, kNaN = std::numeric_limits<float>::quiet_NaN();
  std::map<std::string, const Photo*> by_name;
  for (std::size_t i = 0; i < taken.photos.size(); ++i)
    by_name[taken.sequence.frames[i].role.name()] = &taken.photos[i];
  const auto light = [&](const Role& role) { return luminance_mean(by_name.at(role.name())->value); };
  Role role;
  role.projector = projector.id, role.kind = "white";
  Image contrast = light(role);
  role.kind = "black";
  const Image black = light(role);
  capture::Correspondence c;
  c.projector = projector.id, c.projector_resolution = projector.resolution;
  c.reason = Mask(contrast.width(), contrast.height(), 1);
  c.x = c.y = Image(contrast.width(), contrast.height(), 1, kNaN);
  c.sigma = Image(contrast.width(), contrast.height(), 1, 0.29f);
  for (std::size_t i = 0; i < contrast.data().size(); ++i)
    if (contrast.data()[i] - black.data()[i] <= kDark)
      c.reason.data()[i] = static_cast<std::uint8_t>(capture::Reason::kDark);
  role.kind = "gray";
  for (int a = 0; a < 2; ++a) {
    role.axis = a ? "y" : "x";
    std::vector<unsigned> code(contrast.data().size());
    for (role.bit = 0; role.bit < capture::gray_bits(projector.resolution[a]); ++role.bit) {
      role.inverse = false;
      const Image plain = light(role);
      role.inverse = true;
      const Image inverse = light(role);
      for (std::size_t i = 0; i < code.size(); ++i) {
        const float difference = plain.data()[i] - inverse.data()[i];
        if (difference > 0) code[i] |= 1u << role.bit;
        if (std::abs(difference) <= kLeast && !c.reason.data()[i])
          c.reason.data()[i] = static_cast<std::uint8_t>(capture::Reason::kUncertainBit);
      }
    }
    for (std::size_t i = 0; i < code.size(); ++i) {
      const unsigned q = capture::binary_from_gray(code[i]);
      if (static_cast<int>(q) >= projector.resolution[a] && !c.reason.data()[i])
        c.reason.data()[i] = static_cast<std::uint8_t>(capture::Reason::kInconsistent);
      (a ? c.y : c.x).data()[i] = static_cast<float>(q);
    }
  }
  return c;
}

}  // namespace countershade::bench
