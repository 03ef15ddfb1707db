#include "tools/job/calibration.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>

#include "calib/base/parallel.h"
#include "calib/file/file.h"
#include "calib/image/image_file.h"
#include "capture/diagnose/diagnose.h"
#include "capture/diagnose/held_out.h"
#include "capture/pattern/decode.h"
#include "capture/pattern/pattern.h"
#include "capture/pattern/read/reject.h"
#include "capture/session/session_folder.h"
#include "solver/compensate/compensate.h"
#include "solver/fit/photometric_fit.h"
#include "solver/transport/form_factor.h"

namespace countershade::tools {

namespace {

using capture::Correspondence;
using nlohmann::json;
namespace fs = std::filesystem;

constexpr int kFormat = 2;  // of calibration.json; 1 knew no camera_veil
constexpr double kMostWrong =
    0.002;                           // of decoded pixels, by held-out patterns: more than decoders leave on real boards
constexpr double kMostUnread = 0.1;  // of pixels that are clearly lit

// What the decoder gave, and what is wrong with it, as notes; where it refused, in its error.
Result<Correspondence> decode_and_diagnose(const Session& session, const CameraSpec& camera,
                                           const std::string& projector, const CalibrateOptions& options, bool first,
                                           std::vector<std::string>& notes, Progress& progress) {
  const auto known = std::find_if(options.decoded.begin(), options.decoded.end(), [&](const Correspondence& d) {
    return d.camera == camera.id && d.projector == projector;
  });
  Result<Correspondence> c = known != options.decoded.end()
                                 ? Result<Correspondence>(*known)
                                 : capture::decode(session, camera.id, projector, {}, progress);
  const capture::PhotoSource photos = [&](int index) { return session.photo(camera.id, index); };
  const auto findings =
      capture::diagnose(session.sequence(), photos, {camera.id, projector, c ? &*c : nullptr, camera.response, first});
  if (!c && findings.empty()) return c;
  if (!c) return error(c.error().code, "{} {}", c.error().message, capture::text_of(findings));
  for (const capture::Finding& f : findings) notes.push_back(f.sentence);
  return c;
}

// Once nothing more is rejected: files, pictures, and what the summary says of them.
Result<void> keep_decoded(const std::vector<Correspondence>& all, const fs::path& folder, CalibrationSummary& summary) {
  for (std::size_t q = 0; q < all.size(); ++q) {
    const Correspondence& c = all[q];
    CS_TRY_VOID(capture::write_correspondence(folder, c));
    CS_TRY_VOID(capture::write_reason_picture(folder / (c.camera + "-" + c.projector + "-reasons.png"), c));
    summary.decoded[q].accepted = c.lit ? static_cast<double>(c.accepted) / static_cast<double>(c.lit) : 0;
    summary.decoded[q].expected_wrong = c.expected_wrong(), summary.decoded[q].rejected = c.rejected();
  }
  return {};
}

// findings (out): all sentences that say what is wrong with the photos.
Result<std::vector<Correspondence>> decode_all(const Session& session, const CameraSpec& camera,
                                               const CalibrateOptions& options, CalibrationSummary& summary,
                                               std::vector<std::string>& findings, Progress& progress) {
  std::vector<Correspondence> all;
  for (const auto& [id, resolution] : session.sequence().projectors) {
    CS_TRY(Correspondence c, decode_and_diagnose(session, camera, id, options, all.empty(), findings, progress));
    summary.decoded.emplace_back();
    summary.decoded.back().projector = id, summary.decoded.back().lit = c.lit;
    all.push_back(std::move(c));
  }
  const capture::PhotoSource photos = [&](int index) { return session.photo(camera.id, index); };
  CS_TRY(const std::vector<capture::CodeAudit> audits, capture::audit_codes(session.sequence(), photos, all));
  for (std::size_t q = 0; q < audits.size(); ++q) {
    summary.decoded[q].judged = audits[q].judged, summary.decoded[q].wrong = audits[q].wrong();
    if (audits[q].judged > 1000 && audits[q].wrong() > kMostWrong)
      summary.notes.push_back(fmt::format(
          "projector '{}': block patterns that decoding has not seen contradict {:.2f} % of its pixels (bound "
          "{:.2f} %): something moved during the capture, or the code does not suit the room; look at its "
          "reasons picture, and capture again with --code micro-phase-9",
          summary.decoded[q].projector, 100 * audits[q].wrong(), 100 * kMostWrong));
  }
  for (const Correspondence& c : all)
    if (c.expected_wrong() > kMostWrong)
      summary.notes.push_back(fmt::format(
          "projector '{}': by their sigma {:.2f} % of its codes are more than 1 px off (bound {:.2f} %): the stripes "
          "are out "
          "of focus, too fine for the camera, or too weak there; focus both, bring the camera nearer, or expose longer",
          c.projector, 100 * c.expected_wrong(), 100 * kMostWrong));
  CS_TRY(const capture::Unread unread, capture::unread_pixels(session.sequence(), photos, all));
  if (unread.clear > 1000 && unread.share() > kMostUnread)
    summary.notes.push_back(fmt::format(
        "camera '{}': block patterns are clearly seen in {} pixels, but in {:.0f} % of them no projector's code is "
        "(bound "
        "{:.0f} %): its stripes are out of focus there, or finer than the camera resolves: focus both, or bring the "
        "camera nearer",
        camera.id, unread.clear, 100 * unread.share(), 100 * kMostUnread));
  CS_TRY(const std::optional<capture::ViewShift> shift, capture::shift_of_view(session.sequence(), photos));
  if (shift && shift->moved())
    summary.notes.push_back(fmt::format(
        "camera '{}': its view moved by {:.2f} +- {:.2f} px between the white frames and the block patterns (bound {} "
        "px): the code and the light belong to different places; fasten the camera and what stands in the room, and "
        "capture again",
        camera.id, shift->length(), shift->sigma, capture::kMostViewShift));
  summary.notes.insert(summary.notes.end(), findings.begin(), findings.end());
  return all;
}

// Where photos do not fit their sequence, that is the first thing to know of what could not be done.
Error after_findings(const Error& e, const std::vector<std::string>& findings) {
  if (findings.empty()) return e;
  return error(e.code, "The photos do not fit their sequence: {} So this could not be done: {}",
               fmt::join(findings, " "), e.message);
}

// Of what could not be placed: what became of its pixels.
Error with_rejections(const Error& e, const std::vector<Correspondence>& decoded) {
  std::string text;
  for (const Correspondence& c : decoded)
    text += fmt::format(" Projector '{}': of {} lit pixels {:.1f} % are decoded; {}.", c.projector, c.lit,
                        100.0 * static_cast<double>(c.accepted) / static_cast<double>(std::max<std::size_t>(1, c.lit)),
                        c.rejected().empty() ? "none is rejected" : rejected_text(c.rejected()));
  return error(e.code, "{}{}", e.message, text);
}

// Square patches: 32 along the longest side of any chart; charts that share a crease share the count along it.
Patches auto_patches(const solver::GeometryFit& geometry, std::array<int, 2> asked) {
  double longest = 0;
  for (const auto& plane : geometry.planes)
    longest = std::max({longest, plane->along_u().norm(), plane->along_v().norm()});
  std::vector<std::pair<int, int>> grid;
  for (const auto& plane : geometry.planes) {
    if (asked[0] > 0) {
      grid.emplace_back(asked[0], asked[1]);
      continue;
    }
    const double edge = longest / 32;
    grid.emplace_back(std::max(4, static_cast<int>(std::lround(plane->along_u().norm() / edge))),
                      std::max(4, static_cast<int>(std::lround(plane->along_v().norm() / edge))));
  }
  return Patches(grid);
}

// What a frame tells the photometric fit.
enum class Use { kNone, kFit, kHeldOut };
Use use_of(const Role& role) {
  if (role.kind == "held-out") return Use::kHeldOut;
  return role.kind == "white" || role.kind == "black" || role.kind == "blocks" || role.kind == "primary" ? Use::kFit
                                                                                                         : Use::kNone;
}

std::array<bool, 3> channels_of(const Role& role) {
  if (role.kind != "blocks" && role.kind != "primary") return {true, true, true};
  return {role.channel.find('r') != std::string::npos, role.channel.find('g') != std::string::npos,
          role.channel.find('b') != std::string::npos};
}

// Linear light of a role on every projector, black level included.
Result<std::vector<Image>> lights_of(const Role& role, const solver::Model& model) {
  std::vector<Image> lights;
  for (const solver::ProjectorModel& p : model.projectors) {
    CS_TRY(const Picture picture, capture::render_role(role, p.id, p.device.lens.width(), p.device.lens.height()));
    lights.push_back(solver::light_of_picture(p.response, picture));
  }
  return lights;
}

// Of a camera that sees no colours: frames of one primary tell about that one, of the others only black tells about
// each.
void tell_primaries_apart(const std::vector<const Frame*>& frames, int black_frame,
                          std::vector<solver::PatchFrame>& fitted) {
  if (black_frame < 0) return;
  const auto is_one = [](const Frame* f) {
    return (f->role.kind == "blocks" || f->role.kind == "primary") && f->role.channel.size() == 1;
  };
  if (std::none_of(frames.begin(), frames.end(), is_one)) return;
  const solver::PatchFrame black = fitted[black_frame];
  for (std::size_t i = 0; i < frames.size(); ++i) {
    if (is_one(frames[i]))
      fitted[i] = solver::one_primary(fitted[i], black);
    else if (static_cast<int>(i) != black_frame)
      fitted[i].channels = {false, false, false};
  }
}

struct Photometry {
  solver::PhotometricData data;
  std::vector<int> white_frame;  // per projector: position in `fitted`
  int black_frame = -1;
  std::vector<const Frame*> fitted;
};

Result<Photometry> reduce_photos(const Session& session, const std::string& camera, const solver::PixelGeometry& pixels,
                                 const solver::Model& model, Progress& progress) {
  Photometry result;
  result.white_frame.assign(model.projectors.size(), -1);
  result.data.seen = solver::pixels_per_patch(pixels, model.patches.size());
  std::vector<const Frame*> frames;
  for (const Frame& frame : session.sequence().frames)
    if (use_of(frame.role) != Use::kNone) frames.push_back(&frame);
  NoiseModel noise;
  for (std::size_t i = 0; i < frames.size(); ++i) {
    progress.step("photometric frames", i, frames.size());
    const Role& role = frames[i]->role;
    CS_TRY(const Photo photo, session.photo(camera, frames[i]->index));
    if (i == 0) {
      noise = estimate_noise(std::span(&photo, 1));
      noise.read = std::max(noise.read, rounding_sigma(std::span(&photo, 1)));
    }
    result.data.grey = photo.value.channels() == 1;
    CS_TRY(const std::vector<Image> lights, lights_of(role, model));
    solver::PatchFrame frame = solver::reduce_frame(pixels, model.patches.size(), photo, noise, lights);
    frame.channels = channels_of(role);
    if (use_of(role) == Use::kHeldOut) {
      result.data.held_out.push_back(std::move(frame));
      continue;
    }
    const int at = static_cast<int>(result.fitted.size());
    for (std::size_t q = 0; q < model.projectors.size(); ++q)
      if (role.kind == "white" && (role.projector == model.projectors[q].id || model.projectors.size() == 1))
        result.white_frame[q] = at;
    if (role.kind == "black") result.black_frame = at;
    result.fitted.push_back(frames[i]);
    result.data.frames.push_back(std::move(frame));
  }
  progress.step("photometric frames", frames.size(), frames.size());
  if (result.data.grey) tell_primaries_apart(result.fitted, result.black_frame, result.data.frames);
  return result;
}

// 99th percentile of the direct light of the strongest projector at full white, mean of channels.
double reference_white(const solver::Model& model) {
  double white = 0;
  for (const solver::ProjectorModel& p : model.projectors) {
    std::vector<float> values;
    for (const Image& gain : p.gain)
      for (std::size_t i = 0; i < gain.pixels(); ++i) {
        const float v = (gain.data()[3 * i] + gain.data()[3 * i + 1] + gain.data()[3 * i + 2]) / 3;
        if (v > 0) values.push_back(v);
      }
    if (values.empty()) continue;
    const auto nth = values.begin() + static_cast<std::ptrdiff_t>(0.99 * (values.size() - 1));
    std::nth_element(values.begin(), nth, values.end());
    white = std::max<double>(white, *nth);
  }
  return white;
}

// Patch means of a are a coarse gain chart, for sessions without a white frame of the projector.
std::vector<Image> charts_of_patches(const solver::Model& model, const solver::Radiosity& a) {
  std::vector<Image> charts;
  for (int s = 0; s < model.screen.size(); ++s) {
    Image chart(model.patches.nu(s) * model.gain_factor, model.patches.nv(s) * model.gain_factor, 3);
    for (int y = 0; y < chart.height(); ++y)
      for (int x = 0; x < chart.width(); ++x)
        for (int c = 0; c < 3; ++c)
          chart.at(x, y, c) = a(model.patches.index(s, x / model.gain_factor, y / model.gain_factor), c);
    charts.push_back(std::move(chart));
  }
  return charts;
}

Result<solver::Model> start_model(const Rig& rig, const solver::GeometryFit& geometry, const CalibrateOptions& options,
                                  Progress& progress) {
  solver::Model model;
  model.screen = geometry.screen;
  model.planes = geometry.planes;
  model.patches = auto_patches(geometry, options.patches[0] > 0 ? options.patches : rig.screen.patches);
  model.F = solver::form_factors(model.screen, model.patches, solver::FormFactorMethod::kExact, progress);
  model.G = solver::receiver_form_factors(model.screen, model.patches,
                                          solver::receiver_points(model.patches, model.receiver_factor), progress);
  for (const solver::ProjectorFit& fit : geometry.projectors) {
    solver::ProjectorModel projector;
    projector.id = fit.id;
    const ProjectorSpec* spec = rig.projector(fit.id);
    CS_TRY(projector.response.curve, Response::parse(spec->response));
    projector.response.black_level = spec->black_level;
    projector.device = fit.device;
    projector.map = solver::pixel_map(fit.device, model.screen);
    model.projectors.push_back(std::move(projector));
  }
  return model;
}

Result<void> fit_light(const Session& session, const std::string& camera, const solver::PixelGeometry& pixels,
                       solver::Model& model, CalibrationSummary& summary, Progress& progress) {
  CS_TRY(Photometry photometry, reduce_photos(session, camera, pixels, model, progress));
  double white = 1e-9;
  for (const solver::PatchFrame& frame : photometry.data.frames) white = std::max<double>(white, frame.m.maxCoeff());
  if (photometry.data.grey)
    summary.notes.push_back(
        fmt::format("camera '{}' sees no colours: gains of the primaries come from photos of one primary each, and "
                    "what verify sees "
                    "is their sum",
                    camera));
  photometry.data.white = white;
  CS_TRY(solver::PhotometricFit fit, solver::fit_photometry(model.F, model.patches, photometry.data, {}, progress));
  const std::vector<solver::PatchFrame> frames = solver::without_veil(photometry.data.frames, fit.veil);
  model.k = fit.k;
  model.e = fit.e;
  for (std::size_t q = 0; q < model.projectors.size(); ++q) {
    const int w = photometry.white_frame[q], b = photometry.black_frame;
    if (w < 0 || b < 0) {
      model.projectors[q].gain = charts_of_patches(model, fit.a[q]);
      continue;
    }
    CS_TRY(Photo white_photo, session.photo(camera, photometry.fitted[w]->index));
    CS_TRY(Photo black_photo, session.photo(camera, photometry.fitted[b]->index));
    for (Photo* photo : {&white_photo, &black_photo}) take_out_veil(photo->value, fit.veil);
    model.projectors[q].gain =
        solver::gain_charts(pixels, model, static_cast<int>(q), white_photo, black_photo, frames[w], frames[b],
                            photometry.data.grey ? fit.a[q] : solver::Radiosity());
  }
  model.white = reference_white(model);
  summary.chi2 = fit.chi2;
  summary.veil = fit.veil;
  if (fit.veil > 0)
    summary.notes.push_back(
        fmt::format("camera '{}': veiling glare lays {:.1f} % of a photo's mean over it, measured where no indirect "
                    "light can be; it "
                    "is taken out of these photos and of those that verify takes",
                    camera, 100 * fit.veil));
  constexpr double kFlareWorthSaying = 0.003;  // doubles what is left of the show
  if (fit.flare > kFlareWorthSaying)
    summary.notes.push_back(fmt::format(
        "the projectors lay about {:.1f} % of their pictures' mean over all of them (flare: dust or haze in the lens, "
        "light that leaks); it is on the walls, is not compensated, and is likely to be most of what is left: clean "
        "the lenses",
        100 * fit.flare));
  summary.held_out_error = fit.held_out_error * white / model.white;
  summary.held_out_p99 = fit.held_out_p99 * white / model.white;
  for (int c = 0; c < 3; ++c) summary.mean_k[c] = fit.k.col(c).mean();
  summary.frames = static_cast<int>(photometry.fitted.size());
  summary.notes.insert(summary.notes.end(), fit.notes.begin(), fit.notes.end());
  constexpr double kHeldOutAllowed = 0.005;  // of white: what the compensated show may be wrong by
  if (summary.held_out_error > kHeldOutAllowed)
    summary.notes.push_back(
        fmt::format("the held-out pictures come out wrong by {:.2f} % of white, more than {:.1f} %: the model does not "
                    "describe this "
                    "rig. Likely causes: a projector's response or picture mode is not the stated one, a frame shows "
                    "another picture, "
                    "the camera has too few bits or its exposure moved; run `countershade check`",
                    100 * summary.held_out_error, 100 * kHeldOutAllowed));
  summary.has_model = true;
  return {};
}

json summary_json(const CalibrationSummary& s) {
  json decoded = json::array();
  for (const DecodeSummary& d : s.decoded)
    decoded.push_back({{"projector", d.projector},
                       {"lit_pixels", d.lit},
                       {"accepted_share", d.accepted},
                       {"judged_pixels", d.judged},
                       {"wrong_share", d.wrong},
                       {"expected_wrong_share", d.expected_wrong},
                       {"rejected_share", d.rejected}});
  return {{"format_version", kFormat},
          {"decoded", decoded},
          {"has_geometry", s.has_geometry},
          {"has_model", s.has_model},
          {"reprojection_rms_px", s.reprojection_px},
          {"crease_angle_deg", s.crease_angle_deg},
          {"crease_angle_sigma_deg", s.crease_sigma_deg},
          {"chi2_reduced", s.chi2},
          {"held_out_error", s.held_out_error},
          {"held_out_p99", s.held_out_p99},
          {"camera_veil", s.veil},
          {"mean_indirect_gain", {s.mean_k[0], s.mean_k[1], s.mean_k[2]}},
          {"photometric_frames", s.frames},
          {"session_frames", s.session_frames},
          {"notes", s.notes}};
}

CalibrationSummary summary_from(const json& j) {
  CalibrationSummary s;
  for (const json& d : j.at("decoded"))
    s.decoded.push_back({d.at("projector"), d.at("accepted_share"), d.at("lit_pixels"), d.value("judged_pixels", 0ul),
                         d.value("wrong_share", 0.0), d.value("expected_wrong_share", 0.0),
                         d.value("rejected_share", std::map<std::string, double>())});
  s.has_geometry = j.at("has_geometry");
  s.has_model = j.at("has_model");
  s.reprojection_px = j.at("reprojection_rms_px").get<std::vector<double>>();
  s.crease_angle_deg = j.at("crease_angle_deg").get<std::vector<double>>();
  s.crease_sigma_deg = j.at("crease_angle_sigma_deg").get<std::vector<double>>();
  s.chi2 = j.at("chi2_reduced");
  s.held_out_error = j.at("held_out_error");
  s.held_out_p99 = j.at("held_out_p99");
  s.veil = j.at("format_version") < 2 ? 0 : j.at("camera_veil").get<double>();
  s.frames = j.at("photometric_frames");
  s.session_frames = j.at("session_frames");
  s.notes = j.at("notes").get<std::vector<std::string>>();
  return s;
}

bool has_photometry(const Sequence& sequence) {
  return std::any_of(sequence.frames.begin(), sequence.frames.end(),
                     [](const Frame& f) { return f.role.kind == "blocks"; });
}

// The rig as a calibration carries it: the model of the camera in use lies in the calibration itself, others stay with
// the session, so that equal sessions give equal bytes wherever they lie.
Rig without_paths(const Rig& rig, const std::string& camera) {
  Rig own = rig;
  for (CameraSpec& c : own.cameras) c.model = c.id == camera && !c.model.empty() ? "geometry/camera.cameramodel" : "";
  for (ProjectorSpec& p : own.projectors) p.model.clear();
  return own;
}

Result<void> fill(const Session& session, const fs::path& folder, const CalibrateOptions& options,
                  CalibrationSummary& summary, Progress& progress) {
  const Rig& rig = session.rig();
  const CameraSpec& camera = camera_to_use(rig);
  if (rig.cameras.size() > 1)
    summary.notes.push_back(fmt::format("camera '{}' is used; the others are stored but not yet evaluated", camera.id));
  for (std::string& line : capture::unhealthy_cameras(session.folder())) summary.notes.push_back(std::move(line));
  std::error_code code;
  fs::create_directories(folder / "correspondence", code);
  if (code)
    return error(ErrorCode::kIo, "cannot create '{}': {}", (folder / "correspondence").string(), code.message());
  CS_TRY_VOID(write_atomically(folder / "rig.toml", canonical_rig_text(without_paths(rig, camera.id))));
  std::vector<std::string> findings;
  CS_TRY(std::vector<Correspondence> decoded, decode_all(session, camera, options, summary, findings, progress));
  if (camera.model.empty()) {
    CS_TRY_VOID(keep_decoded(decoded, folder / "correspondence", summary));
    summary.notes.push_back(fmt::format(
        "camera '{}' has no lens model ([[camera]] model = a .cameramodel): no geometry, no light model", camera.id));
    return {};
  }
  CS_TRY(Device lens, read_cameramodel(camera.model));
  if (!decoded.front().x.same_size(lens.lens.width(), lens.lens.height()))
    return error(ErrorCode::kBadValue,
                 "camera '{}': photos are {} x {} pixels but its model '{}' is for {} x {}; calibrate the lens at this "
                 "resolution",
                 camera.id, decoded.front().x.width(), decoded.front().x.height(), camera.model.string(),
                 lens.lens.width(), lens.lens.height());
  lens.device_from_world = {};
  std::vector<solver::ProjectorObservation> observations;
  for (const Correspondence& c : decoded) observations.push_back({*rig.projector(c.projector), &c.x, &c.y, &c.sigma});
  solver::GeometryOptions geometry_options;
  geometry_options.planes = rig.screen.planes;
  const auto fitted = solver::fit_geometry(lens, observations, rig.screen, geometry_options, progress);
  if (!fitted) return after_findings(with_rejections(fitted.error(), decoded), findings);
  const solver::GeometryFit& geometry = *fitted;
  for (std::size_t q = 0; q < decoded.size(); ++q) {
    const std::size_t before = decoded[q].accepted;
    const std::size_t off = capture::reject_off_epipolar(lens, geometry.projectors[q].device, decoded[q]);
    if (static_cast<double>(off) > kMostWrong * static_cast<double>(before))
      summary.notes.push_back(fmt::format(
          "projector '{}': {:.2f} % of its codes lie where no point of space explains them (bound {:.2f} %; epipolar "
          "geometry): they are rejected; something shiny, or something that moved, or a code that does not suit the "
          "room; look at its reasons picture",
          decoded[q].projector, 100 * static_cast<double>(off) / static_cast<double>(before), 100 * kMostWrong));
  }
  CS_TRY_VOID(keep_decoded(decoded, folder / "correspondence", summary));
  summary.has_geometry = true;
  summary.notes.insert(summary.notes.end(), geometry.notes.begin(), geometry.notes.end());
  for (const auto& p : geometry.projectors) summary.reprojection_px.push_back(p.rms_px);
  for (std::size_t i = 0; i < geometry.screen.creases.size(); ++i) {
    summary.crease_angle_deg.push_back(geometry.screen.creases[i].angle * 180 / std::numbers::pi);
    // A covariance's last digits depend on where memory lies; six decimals do not.
    summary.crease_sigma_deg.push_back(std::round(1e6 * geometry.angle_sigma[i] * 180 / std::numbers::pi) / 1e6);
  }
  fs::create_directories(folder / "geometry", code);
  CS_TRY_VOID(write_cameramodel(folder / "geometry" / "camera.cameramodel", lens));
  for (const auto& p : geometry.projectors)
    CS_TRY_VOID(write_cameramodel(folder / "geometry" / (p.id + ".cameramodel"), p.device));
  if (!has_photometry(session.sequence())) {
    summary.notes.push_back(
        "the sequence has no photometric frames (role 'blocks'): geometry only, nothing to compensate with");
    return {};
  }
  CS_TRY(solver::Model model, start_model(rig, geometry, options, progress));
  const solver::PixelGeometry pixels = solver::pixel_geometry(lens, geometry, model.patches);
  CS_TRY_VOID(fit_light(session, camera.id, pixels, model, summary, progress));
  fs::create_directories(folder / "model", code);
  return solver::write_model(folder / "model", model);
}

}  // namespace

std::string rejected_text(const std::map<std::string, double>& rejected) {
  std::vector<std::pair<double, std::string>> most;
  for (const auto& [name, share] : rejected) most.emplace_back(-share, name);
  std::sort(most.begin(), most.end());
  std::string text;
  for (const auto& [share, name] : most)
    text += fmt::format("{}{} {:.2f} %", text.empty() ? "" : ", ", name, -100 * share);
  return text;
}

const CameraSpec& camera_to_use(const Rig& rig) {
  for (const CameraSpec& c : rig.cameras)
    if (!c.model.empty()) return c;
  return rig.cameras.front();
}

Result<CalibrationSummary> calibrate(const fs::path& session_folder, const fs::path& out,
                                     const CalibrateOptions& options, Progress& progress, const FillFolder& record) {
  CS_TRY(const Session session, Session::open(session_folder));
  CalibrationSummary summary;
  summary.session_frames = static_cast<int>(session.sequence().frames.size());
  CS_TRY_VOID(create_folder_atomically(
      out,
      [&](const fs::path& folder) -> Result<void> {
        CS_TRY_VOID(fill(session, folder, options, summary, progress));
        return write_atomically(folder / "calibration.json", summary_json(summary).dump(1) + "\n");
      },
      record));
  return summary;
}

Result<Calibration> open_calibration(const fs::path& folder) {
  CS_TRY(const std::string text, read_text(folder / "calibration.json"));
  Calibration calibration;
  try {
    const json j = json::parse(text);
    if (j.at("format_version").get<int>() > kFormat)
      return error(ErrorCode::kBadFile,
                   "'{}' has format_version {}, this program reads up to {}; use a newer countershade",
                   (folder / "calibration.json").string(), j.at("format_version").get<int>(), kFormat);
    calibration.summary = summary_from(j);
  } catch (const json::exception& e) {
    return error(ErrorCode::kBadFile, "'{}' is not a calibration's summary: {}; run calibrate again",
                 (folder / "calibration.json").string(), e.what());
  }
  if (!calibration.summary.has_model)
    return error(ErrorCode::kRefused, "calibration '{}' holds no light model: {}", folder.string(),
                 calibration.summary.notes.empty() ? "no reason recorded"
                                                   : fmt::format("{}", fmt::join(calibration.summary.notes, "; ")));
  CS_TRY(calibration.rig, read_rig(folder / "rig.toml"));
  CS_TRY(calibration.camera, read_cameramodel(folder / "geometry" / "camera.cameramodel"));
  calibration.camera_id = camera_to_use(calibration.rig).id;
  CS_TRY(calibration.model, solver::read_model(folder / "model"));
  return calibration;
}

solver::PixelGeometry pixels_of(const Calibration& calibration) {
  solver::GeometryFit geometry;
  geometry.screen = calibration.model.screen;
  for (const solver::ProjectorModel& p : calibration.model.projectors)
    geometry.projectors.push_back({p.id, p.device, 0, {}});
  return solver::pixel_geometry(calibration.camera, geometry, calibration.model.patches);
}

}  // namespace countershade::tools
