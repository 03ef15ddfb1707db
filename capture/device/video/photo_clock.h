// Which photos of a camera that runs freely were exposed after somebody asked for one.
#pragma once

namespace countershade::capture {

// By the times that the driver gives them, for as long as these can be true: of the computer's own clock, never later
// than the photo's arrival, each after the one before. A time may be the start or the end of the exposure (drivers say
// the one and mean the other), so the exposure is taken off. Where times are not believed, or the exposure is not
// known, the third photo that arrives counts: two may be under way. Photos that a camera holds back inside, and whose
// times are those of their arrival, look younger than they are: the session runner measures that together with the
// display's lateness. All times in seconds.
class PhotoClock {
 public:
  // From now on photos are of before until one was begun after `now`.
  void ask(double now) {
    asked_ = now;
    seen_ = 0;
  }
  // A photo that has arrived: whether it may have been begun before the question. same_clock: the driver says that its
  // times are of the clock that `now` and `arrived` are of. exposure: 0 = not known.
  bool of_before(double time, bool same_clock, double arrived, double exposure);
  bool believed() const { return believed_; }

 private:
  double asked_ = 0, former_ = 0;
  int seen_ = 0;  // photos since the question
  bool believed_ = true;
};

}  // namespace countershade::capture
