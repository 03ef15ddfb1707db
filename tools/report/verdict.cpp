// PASS or FAIL with the first thing to try, and the numbers as JSON.
#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "tools/report/metrics.h"

namespace countershade::tools {

namespace {

using nlohmann::json;

// Not finite: null.
json number(double value) {
  return std::isfinite(value) ? json(value) : json(nullptr);
}
json number(const std::optional<double>& value) {
  return value ? number(*value) : json(nullptr);
}

json json_of(const Deviations& d) {
  return {{"blocks", d.blocks},
          {"mean_percent_of_white", number(d.mean_percent)},
          {"p99_percent_of_white", number(d.p99_percent)},
          {"mean_grey_levels", number(d.mean_grey)},
          {"p99_grey_levels", number(d.p99_grey)},
          {"mean_delta_e_2000", number(d.mean_delta_e)},
          {"p95_delta_e_2000", number(d.p95_delta_e)}};
}

json json_of(const ZoneNumbers& z) {
  return {{"uncompensated", json_of(z.uncompensated)},
          {"compensated", json_of(z.compensated)},
          {"suppression", number(z.suppression)}};
}

json json_of(const Background& b) {
  return {{"held_out_percent_of_white", number(b.held_out_percent)},
          {"certificate_percent_of_white", number(b.certificate_percent)},
          {"reachable_gap_percent_of_white", number(b.reachable_gap_percent)},
          {"frames", b.frames ? json(*b.frames) : json(nullptr)},
          {"capture_seconds", number(b.capture_seconds)},
          {"compute_seconds", number(b.compute_seconds)}};
}

// Why the suppression is too low, the likeliest cause first.
std::string suppression_remedy(const VerifyNumbers& n, const Thresholds& t) {
  const double veil = n.unclipped.uncompensated.mean_percent;
  if (n.noise_floor_percent * t.suppression > veil)
    return fmt::format(
        "the photos' noise ({:.3f} % of white) hides what is left of a veil of {:.2f} %: show a brighter "
        "picture or average more exposures",
        n.noise_floor_percent, veil);
  const std::optional<double>& held_out = n.background.held_out_percent;
  if (held_out && *held_out * t.suppression > veil)
    return fmt::format(
        "the calibration predicts held-out patterns to {:.2f} % of white only: capture again with the "
        "lamps off and nothing moved",
        *held_out);
  if (!n.background.certificate_percent || *n.background.certificate_percent * t.suppression < veil)
    return "look at the held-out error of the calibration first; where it is small, something changed since: check "
           "that "
           "the display sends the pictures unaltered (colour management, night light, scaling) and that nothing moved, "
           "else capture again";
  return "the solver itself stops too early: allow more gathers";
}

void judge_suppression(const VerifyNumbers& n, const Thresholds& t, Verdict& v) {
  const Deviations &u = n.unclipped.uncompensated, &c = n.unclipped.compensated;
  if (u.blocks == 0) {
    v.failures.push_back(
        "every lit part of this picture needs clipping, so it cannot tell how good the model is: verify with a picture "
        "within range (--test-picture photo)");
  } else if (!(c.mean_percent > 0) && !(u.mean_percent > 0)) {
    v.failures.push_back(
        "the plain show equals the target already, there is nothing to judge: show a brighter picture, and check that "
        "the three photos are not the same file");
  } else if (!(n.unclipped.suppression >= t.suppression)) {
    v.failures.push_back(fmt::format("suppression {:.1f}x is below {:.0f}x: {}", n.unclipped.suppression, t.suppression,
                                     suppression_remedy(n, t)));
  }
}

}  // namespace

Verdict judge(const VerifyNumbers& n, const Thresholds& t) {
  Verdict v;
  if (n.all.uncompensated.blocks == 0) {
    v.failures.push_back(
        "nothing in the photos is lit: does the camera look at the screen, and is the lens uncovered?");
    return v;
  }
  judge_suppression(n, t, v);
  if (!(n.edge.compensated.mean_grey <= t.edge_grey))
    v.failures.push_back(
        fmt::format("{:.2f} grey levels are left beside the crease (bound {:.1f}): check the reprojection residual of "
                    "the projectors first, then try more patches",
                    n.edge.compensated.mean_grey, t.edge_grey));
  if (!(n.worse_share <= t.worse_share))
    v.failures.push_back(
        fmt::format("{:.1f} % of the picture got worse (bound {:.0f} %): something moved since the capture, or the "
                    "projector's response is not what rig.toml says",
                    100 * n.worse_share, 100 * t.worse_share));
  if (!(n.uncovered_share <= t.uncovered_share))
    v.failures.push_back(
        fmt::format("{:.1f} % of the lit pixels are not in the model (bound {:.0f} %): look at the rejected "
                    "correspondences; can the camera see the whole picture?",
                    100 * n.uncovered_share, 100 * t.uncovered_share));
  v.pass = v.failures.empty();
  return v;
}

std::string numbers_json(const VerifyNumbers& n, const Verdict& verdict) {
  const json document = {{"format_version", 1},
                         {"pass", verdict.pass},
                         {"failures", verdict.failures},
                         {"suppression", number(n.all.suppression)},
                         {"suppression_unclipped", number(n.unclipped.suppression)},
                         {"all", json_of(n.all)},
                         {"unclipped", json_of(n.unclipped)},
                         {"unclipped_is", n.clipped_text},
                         {"edge_zone", json_of(n.edge)},
                         {"edge_zone_is", n.edge_text},
                         {"per_pixel", json_of(n.per_pixel)},
                         {"paper_measure", number(n.paper_measure)},
                         {"clipped_share", number(n.clipped_share)},
                         {"uncovered_share", number(n.uncovered_share)},
                         {"above_white_share", number(n.above_white_share)},
                         {"unused_share", number(n.unused_share)},
                         {"worse_share", number(n.worse_share)},
                         {"pixel_mean_percent_of_white", number(n.pixel_mean_percent)},
                         {"noise_floor_percent_of_white", number(n.noise_floor_percent)},
                         {"pixel_noise_floor_percent_of_white", number(n.pixel_noise_floor_percent)},
                         {"histogram",
                          {{"reach_percent_of_white", n.histogram_reach},
                           {"uncompensated", n.histogram_u},
                           {"compensated", n.histogram_c}}},
                         {"background", json_of(n.background)}};
  return document.dump(1, ' ', false, json::error_handler_t::replace) + "\n";
}

}  // namespace countershade::tools
