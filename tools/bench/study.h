// A study: one claimed figure, measured. Every figure of the README names the study that measures it.
#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "calib/base/progress.h"
#include "calib/base/result.h"

namespace countershade::bench {

struct Study {
  std::string title;
  std::vector<std::string> columns;
  std::vector<std::vector<std::string>> rows;
  std::vector<std::string> notes;
  std::string figure, bound;  // "suppression 31x at worst", ">= 20x"
  bool ok = false;
  std::vector<std::pair<std::string, std::string>> labels = {};  // what plot.py writes at axes and lines: name, text
};

struct StudyContext {
  std::filesystem::path output;  // build/bench; scratch files go to output/NAME/
  Progress* progress = nullptr;
};

using StudyFunction = Result<Study> (*)(const StudyContext&);

// One function per study; the table in main.cpp names them.
Result<Study> two_wall_loop(const StudyContext& context);
Result<Study> verify_honest(const StudyContext& context);
Result<Study> closed_form(const StudyContext& context);
Result<Study> form_factors(const StudyContext& context);
Result<Study> first_speed(const StudyContext& context);
Result<Study> decode_real(const StudyContext& context);
Result<Study> sim_faults(const StudyContext& context);
Result<Study> sim_speed(const StudyContext& context);
Result<Study> sim_truth(const StudyContext& context);
Result<Study> decode_hard(const StudyContext& context);
Result<Study> decode_economy(const StudyContext& context);
Result<Study> decode_speed(const StudyContext& context);
Result<Study> pre_scan(const StudyContext& context);
Result<Study> lens_calibration(const StudyContext& context);
Result<Study> kill_study(const StudyContext& context);
Result<Study> sync_study(const StudyContext& context);
Result<Study> capture_to_show(const StudyContext& context);
Result<Study> camera_throughput(const StudyContext& context);
Result<Study> loss_study(const StudyContext& context);

// Writes one picture per room to context.output: plain | indirect light x 4 | a Gray code's stripes | truth.
Result<void> render_gallery(const StudyContext& context);

}  // namespace countershade::bench
