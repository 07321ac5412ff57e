// A pack of dampers, each through a record of its own.
#ifndef MRDAMP_CORE_RUN_H_
#define MRDAMP_CORE_RUN_H_

#include "core/chain.h"
#include "core/lane.h"

namespace mrdamp {

// The state of a damper with the optional parts that its law and effects need.
struct OwnedState {
  State s;
  NarxHistory past;
  DelayLine line;

  explicit OwnedState(const Damper& d) {
    if (d.law == Law::kNarx) s.past = &past;
    if (HasDelay(d.p)) s.line = &line;
  }
  OwnedState(const OwnedState& o) : s(o.s), past(o.past), line(o.line) { Rebind(); }
  OwnedState& operator=(const OwnedState& o) {
    s = o.s;
    if (o.s.past) past = o.past;
    if (o.s.line) line = o.line;
    Rebind();
    return *this;
  }

 private:
  void Rebind() {
    if (s.past) s.past = &past;
    if (s.line) s.line = &line;
  }
};

// d: their attributes, lane by lane; the first `count` lanes are in use. Fills their `out` for each requested column of
// mrdamp.h.
void Run(const Damper& d, const MrdampLane* lanes, int count, double dt, int ncol, const int* columns);

}  // namespace mrdamp

#endif  // MRDAMP_CORE_RUN_H_
