// The verification report: one self-contained HTML file, its numbers as JSON and its pictures as PNG beside it.
#pragma once

#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "calib/base/result.h"
#include "calib/file/file.h"
#include "tools/report/metrics.h"

namespace countershade::tools {

struct Table {
  std::string title;
  std::vector<std::string> header;
  std::vector<std::vector<std::string>> rows;
};

// A picture that is embedded as it is, such as a map of rejected correspondences.
struct Exhibit {
  std::string caption;
  std::filesystem::path png;
};

struct Report {
  std::string title, subtitle;  // subtitle: which rig, which picture, when
  VerifyInput input;            // the photos
  VerifyNumbers numbers;        // from measure(input), with the background that the caller knows
  Verdict verdict;
  Thresholds thresholds;      // those that the verdict was found with
  int profile_row = -1;       // camera row of the profile; -1 = the middle of the rows that cross the edge zone
  std::vector<Table> tables;  // calibration, effort, ladders and their reasons
  std::vector<Exhibit> exhibits;
  std::vector<std::string> notes, warnings;
  std::vector<std::pair<std::string, std::string>> options;  // effective options: name, value
};

// report.html, numbers.json, u.png, c.png, t.png, difference_uncompensated.png, difference_compensated.png and
// difference_compensated_x5.png (all lit pixels, +-10 % of white; the last +-2 %). The folder appears whole.
// Errors: kExists, kIo, kBadFile for an exhibit that cannot be read.
Result<void> write_report(const std::filesystem::path& folder, const Report& report, const FillFolder& record = {});

}  // namespace countershade::tools
