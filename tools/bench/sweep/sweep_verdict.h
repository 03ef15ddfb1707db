// What a sweep found at its points, and what follows from it. Pure: no room, no file.
#pragma once

#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "tools/bench/study.h"

namespace countershade::bench {

inline constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();

// The loudest thing that the program said at a point, from silence upward. A PASS of verify is silence about an error,
// and so is a note, which tells what was set right ("taking it again"). kHeldOut is a number without a sentence: the
// printed held-out error is above the bound that the project states; kFew another: the printed share of decoded pixels,
// or of those that the choice of a code forecasts, is below it. kCalibrate: a note of calibrate on the photos.
enum class Said { kNothing, kPass, kNoted, kHeldOut, kFew, kCheck, kCalibrate, kFail, kRefused };
inline bool is_complaint(Said said) {
  return said > Said::kNoted;
}

// Light that is left by the simulator's truth: mean |C - T| [% of W], and mean |U - T| / mean |C - T|.
struct Residual {
  double percent = kUnknown, suppression = kUnknown;
};

// A decoded code by the simulator's truth (score_decode); of several projectors, each number at its worst.
struct Decoding {
  double accepted_percent = kUnknown;  // of the pixels whose centre the projector lights
  double wrong_percent = kUnknown;     // of the accepted ones: more than 1 px off, or not lit
  double bias_px = kUnknown, random_px = kUnknown;
  double z = kUnknown;  // rms of error over predicted sigma, of those that are not wrong
  // What the program printed of it.
  std::string codes;                                                     // that it chose
  double forecast_percent = kUnknown;                                    // pixels that the choice expects to decode
  double printed_percent = kUnknown, held_out_wrong_percent = kUnknown;  // decoded, of those it takes for lit; wrong
};

struct SweepPoint {
  std::string series;
  double value = 0;                  // of the parameter, in the sweep's unit
  double predictor = kUnknown;       // in the predictor's unit
  std::vector<Residual> methods;     // one per method name; the last is ours. Unknown where there was no show
  std::optional<Decoding> decoding;  // of a point that ends with it
  // What the program said, stage by stage; empty or nothing = no complaint, or the stage was not reached.
  std::string check, notes, calibrate, refusal;
  std::optional<bool> pass;  // the verdict of verify
  std::string failure;       // its first reason
  double verify_suppression = kUnknown;
  double held_out_percent = kUnknown, chi2 = kUnknown, reprojection_px = kUnknown;
};

// What is asked of a point: residual [% of W] up to which a show counts as right, and held-out error [% of W] from
// which the printed number counts as a complaint. Decoding is right with so many pixels accepted, at most so many of
// them wrong, and a sigma that is not too small by more than that factor.
struct SweepBounds {
  double residual_percent = 0.5, held_out_percent = 0.5;
  double accepted_percent = 90, wrong_percent = 0.2, z = 3;
};

Said said(const SweepPoint& point, const SweepBounds& bounds);

enum class PointVerdict { kRight, kFalseAlarm, kRefused, kSaidSo, kSilent };
// kRefused: no show, hence nothing wrong was shown. A residual that is not a number is not within any bound.
PointVerdict judge(const SweepPoint& point, const SweepBounds& bounds);

struct SweepVerdict {
  int points = 0, right = 0, false_alarms = 0, refused = 0, said_so = 0, silent = 0;
  bool decoding = false;            // it is decoding that was judged
  int by_verify_alone = 0;          // of those who said so: nothing before verify complained
  double worst_silent_percent = 0;  // largest residual among the silent ones; of decoded ones: wrong pixels
  // A regime that refuses everything has shown nothing.
  bool ok() const { return refused < points && silent == 0; }
};
SweepVerdict judge(const std::vector<SweepPoint>& points, const SweepBounds& bounds);

// "8 points: 3 right, 0 false alarms, 1 refused, 4 wrong and said so (1 by verify alone), 0 wrong in silence"
std::string text_of(const SweepVerdict& verdict);
const char* text_of(Said said);
const char* text_of(PointVerdict verdict);

// The table of a sweep: columns and rows, one per point; for points of decoding those of Decoding (no methods).
void fill_table(const std::vector<std::string>& methods, const std::vector<SweepPoint>& points,
                const SweepBounds& bounds, Study& study);

// A table as RFC 4180 has it: cells with a comma, a quote or a line break stand in quotes.
std::string csv_of(const Study& study);

}  // namespace countershade::bench
