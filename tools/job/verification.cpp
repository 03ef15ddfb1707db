#include "tools/job/verification.h"

#include <algorithm>
#include <cmath>

namespace countershade::tools {

namespace {

// Direct gain of all projectors at a chart point, mean of channels [camera units].
float total_gain(const solver::Model& model, const ChartPoint& at, const solver::PixelGeometry& pixels,
                 std::size_t pixel) {
  float sum = 0;
  for (std::size_t q = 0; q < model.projectors.size(); ++q) {
    if (std::isnan(pixels.beam[q][pixel].x())) continue;
    for (int c = 0; c < 3; ++c) sum += solver::sample_chart(model.projectors[q].gain[at.surface], at.u, at.v, c) / 3;
  }
  return sum;
}

double mean_width(const solver::Model& model) {
  double sum = 0;
  for (const auto& plane : model.planes) sum += plane->along_u().norm() / static_cast<double>(model.planes.size());
  return sum;
}

bool near_crease(const solver::Model& model, const ChartPoint& at, double reach) {
  for (const Crease& crease : model.screen.creases)
    for (const auto& [surface, u] : {std::pair{crease.surface_a, crease.u_a}, std::pair{crease.surface_b, crease.u_b}})
      if (surface == at.surface && std::abs(at.u - u) * model.planes[surface]->along_u().norm() < reach) return true;
  return false;
}

Table calibration_table(const CalibrationSummary& s) {
  Table t{"Calibration", {"what", "value"}, {}};
  for (const DecodeSummary& d : s.decoded)
    t.rows.push_back(
        {"decoded by " + d.projector,
         fmt::format("{:.2f} % of {} lit pixels{}", 100 * d.accepted, d.lit,
                     d.judged ? fmt::format("; {:.3f} % wrong by held-out patterns", 100 * d.wrong) : "")});
  for (const DecodeSummary& d : s.decoded)
    if (!d.rejected.empty()) t.rows.push_back({"rejected of " + d.projector, rejected_text(d.rejected)});
  for (std::size_t q = 0; q < s.reprojection_px.size(); ++q)
    t.rows.push_back({"reprojection of " + s.decoded[q].projector, fmt::format("{:.3f} px rms", s.reprojection_px[q])});
  for (std::size_t i = 0; i < s.crease_angle_deg.size(); ++i)
    t.rows.push_back(
        {"edge angle", fmt::format("{:.2f} +- {:.2f} degrees", s.crease_angle_deg[i], s.crease_sigma_deg[i])});
  t.rows.push_back({"held-out pattern error", fmt::format("{:.3f} % of white (99th percentile {:.3f} %)",
                                                          100 * s.held_out_error, 100 * s.held_out_p99)});
  if (s.veil > 0)
    t.rows.push_back({"veiling glare, taken out", fmt::format("{:.2f} % of a photo's mean", 100 * s.veil)});
  t.rows.push_back({"chi2 / degrees of freedom", fmt::format("{:.2f}", s.chi2)});
  t.rows.push_back({"photometric frames", fmt::format("{}", s.frames)});
  return t;
}

Table show_table(const Show& show) {
  const solver::FrameReport& r = show.compensated.report;
  const char* names[] = {"auto", "copy", "closed form", "clipped"};
  return {"The show",
          {"what", "value"},
          {{"engine", show.engine},
           {"solver chosen", fmt::format("{} ({} gathers)", names[static_cast<int>(r.used)], r.gathers)},
           {"strongest scattered light", fmt::format("{:.2f} % of white", 100 * r.largest_indirect)},
           {"projector pixels clipped", fmt::format("{:.2f} %", 100 * r.clipped_pixels)},
           {"one frame", fmt::format("{:.1f} ms", show.milliseconds)}}};
}

}  // namespace

VerifyMasks verify_masks(const Calibration& calibration, const solver::PixelGeometry& pixels, const Image& projected) {
  const solver::Model& model = calibration.model;
  VerifyMasks masks{Mask(pixels.width, pixels.height, 1), Mask(pixels.width, pixels.height, 1),
                    Mask(pixels.width, pixels.height, 1), ""};
  const double reach = mean_width(model) / 6;
  masks.edge_text = "a sixth of the mean screen width on either side of the crease";
  const int channels = projected.channels();
  for (std::size_t i = 0; i < pixels.chart.size(); ++i) {
    const ChartPoint& at = pixels.chart[i];
    float direct = 0;
    for (int c = 0; c < channels; ++c) direct += projected.data()[i * channels + c] / channels;
    const bool modelled = at.surface >= 0 && total_gain(model, at, pixels, i) > 0.02 * model.white;
    masks.modelled.data()[i] = modelled;
    masks.lit.data()[i] = modelled || direct > 0.02 * model.white;
    masks.edge.data()[i] = at.surface >= 0 && near_crease(model, at, reach);
  }
  return masks;
}

Image direct_target(const solver::Model& model, const solver::PixelGeometry& pixels, const Photographs& photos) {
  Image target = photos.target;
  if (photos.black.empty()) return target;
  const Image bounced = solver::bounced_light(pixels, model, photos.black);
  for (std::size_t i = 0; i < target.data().size(); ++i) target.data()[i] -= bounced.data()[i];
  return target;
}

Mask clipped_pixels(const solver::PixelGeometry& pixels, const Show& show) {
  Mask clipped(pixels.width, pixels.height, 1);
  for (std::size_t i = 0; i < clipped.data().size(); ++i) {
    bool lit = false;
    std::array<bool, 3> dark{true, true, true};
    for (std::size_t q = 0; q < pixels.beam.size(); ++q) {
      const Picture& picture = show.compensated.pictures[q];
      const Eigen::Vector2f& beam = pixels.beam[q][i];
      if (picture.empty() || std::isnan(beam.x())) continue;
      const int x = std::clamp(static_cast<int>(std::lround(beam.x())), 0, picture.width() - 1);
      const int y = std::clamp(static_cast<int>(std::lround(beam.y())), 0, picture.height() - 1);
      lit = true;
      for (int c = 0; c < 3; ++c) dark[c] = dark[c] && picture.row(y)[3 * static_cast<std::size_t>(x) + c] == 0;
    }
    clipped.data()[i] = lit && (dark[0] || dark[1] || dark[2]);
  }
  return clipped;
}

Result<Verification> report_verification(const Calibration& calibration,
                                         const std::filesystem::path& calibration_folder,
                                         const solver::PixelGeometry& pixels, const Photographs& photos,
                                         const Show* show, ReportContext context, const std::filesystem::path& out,
                                         const FillFolder& record) {
  const Image target = direct_target(calibration.model, pixels, photos);
  Image projected = photos.target;
  for (std::size_t i = 0; i < photos.black.data().size(); ++i) projected.data()[i] -= photos.black.data()[i];
  const VerifyMasks masks = verify_masks(calibration, pixels, projected);
  const CalibrationSummary& summary = calibration.summary;
  Report report;
  report.title = "Countershade verification";
  report.subtitle = std::move(context.subtitle);
  report.options = std::move(context.options);
  report.input = {&photos.uncompensated, &photos.compensated, &target,         &masks.lit,
                  &masks.edge,           &masks.modelled,     masks.edge_text, calibration.model.white,
                  photos.pixel_noise};
  Mask clipped;
  if (show) {
    clipped = clipped_pixels(pixels, *show);
    report.input.clipped = &clipped;
  }
  report.numbers = measure(report.input);
  Background& background = report.numbers.background;
  background.held_out_percent = 100 * summary.held_out_error;
  background.frames = summary.session_frames;
  background.capture_seconds = context.capture_seconds;
  background.compute_seconds = context.compute_seconds;
  if (show) {
    const solver::Forecast f = solver::forecast(calibration.model, show->plain, show->compensated.pictures);
    background.certificate_percent = 100 * f.certificate;
    background.reachable_gap_percent = 100 * (f.deviation - f.optimum);
  }
  report.verdict = judge(report.numbers, {});
  if (show) report.tables.push_back(show_table(*show));
  report.tables.push_back(calibration_table(summary));
  for (Table& t : context.tables) report.tables.push_back(std::move(t));
  for (const DecodeSummary& d : summary.decoded) {
    const std::filesystem::path png =
        calibration_folder / "correspondence" / (calibration.camera_id + "-" + d.projector + "-reasons.png");
    if (std::filesystem::exists(png))
      report.exhibits.push_back(
          {"projector " + d.projector +
               ": decoded (gradient), uncertain (orange), inconsistent (red), isolated (magenta), "
               "contradicting sinusoids (blue), between two surfaces (green), off its epipolar line (yellow), "
               "saturated "
               "(white)",
           png});
  }
  report.notes = summary.notes;
  if (report.numbers.above_white_share > 0.1)
    report.notes.push_back(fmt::format(
        "{:.0f} % of the edge zone are brighter than white, since the room is lit: grey levels clip there and tell "
        "nothing of them; the numbers in % of white do",
        100 * report.numbers.above_white_share));
  CS_TRY_VOID(write_report(out, report, record));
  return Verification{report.numbers, report.verdict};
}

}  // namespace countershade::tools
