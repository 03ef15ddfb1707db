// A sweep: where does the method fail, and does the program say so? One parameter of a rig is driven from harmless to
// hopeless; at each value the job runs, and what the program says is compared with what the simulator knows.
#pragma once

#include <functional>
#include <span>
#include <string>
#include <vector>

#include "simdata/render/simulator.h"
#include "simdata/room/rooms.h"
#include "tools/bench/study.h"
#include "tools/bench/sweep/sweep_verdict.h"

namespace countershade::bench {

// What a value of the parameter may change.
struct SweepSetting {
  simdata::RigAndRoom room;
  Device lens;                         // of the camera, as it is handed over; the true one unless a sweep changes it
  std::vector<simdata::Fault> faults;  // act in every stage; each stage counts its photos from 0
  std::vector<simdata::Fault> in_capture = {};  // act while the session is captured, too; of a show
};

// One more fault, from that photo on.
void add_fault(SweepSetting& setting, const std::string& name, double value, std::uint64_t photo = 0);
void add_fault(std::vector<simdata::Fault>& faults, const std::string& name, double value, std::uint64_t photo);
// Another room of full size takes the place of the setting's, with devices of as few pixels.
void move_to(const simdata::RigAndRoom& room, SweepSetting& setting);

// What a predictor may know: the setting and the truth, never a photo.
struct PredictorInput {
  const SweepSetting& setting;
  const simdata::Simulator& simulator;
  // Where it is the show that is judged:
  std::span<const Picture> plain;    // the pictures
  std::span<const Picture> emitted;  // what the projectors make of them
  double white = 1;                  // W [full scale]
};

// One way to drive the parameter. Several ways with one predictor are the test of the predictor.
struct SweepSeries {
  std::string name;
  std::vector<double> values, quick;  // in the sweep's unit
  std::function<void(double value, SweepSetting&)> apply;
};

// Where the job of a sweep ends: at the light of the show, captured with Gray code; or at the decoded code, captured
// with the one that the scene chooses.
enum class Judged { kShow, kDecoding };

struct Sweep {
  std::string name, title, unit;
  std::string predictor_name;  // with its unit
  Result<double> (*predictor)(const PredictorInput&, Progress&);
  std::vector<SweepSeries> series;
  SweepBounds bounds;
  Judged judged = Judged::kShow;
};

const std::vector<Sweep>& sweeps();
std::vector<Sweep> decode_sweeps();  // those of them that are judged by decoding
std::vector<Sweep> light_sweeps();   // those of what happens while photos are taken

// All points of a sweep on the documentation's two-wall room with fewer pixels. Scratch files: output/NAME/.
// Errors: those of the harness (disk, impossible room); what the program refuses is a point like any other.
Result<Study> run_sweep(const Sweep& sweep, bool quick, const StudyContext& context);

}  // namespace countershade::bench
