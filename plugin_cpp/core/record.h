// Simulation of a whole record by the chain.
#ifndef MRDAMP_CORE_RECORD_H_
#define MRDAMP_CORE_RECORD_H_

#include <algorithm>
#include <atomic>
#include <thread>
#include <vector>

#include "core/chain.h"

namespace mrdamp {

// The state of one damper with the optional parts that its law and effects need.
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

// Inputs of a record: n samples each; v and a are computed by Differentiate if they were not measured.
struct RecordView {
  double dt;
  int n;
  const double* x;
  const double* v;
  const double* a;
  const double* u;
};

// Central differences, one-sided at the ends.
std::vector<double> Differentiate(const double* x, int n, double dt);

// Samples of a record that stand for the motion before it: from `from` to `to`, where displacement, velocity and command
// are nearest to those at its start. from == to where it begins at rest or does not come back.
struct RunIn {
  int from = 0, to = 0;
};
RunIn FindRunIn(const RecordView& r);

// Runs one damper; out[c] (n doubles) for each requested column of mrdamp.h.
void RunRecord(const Damper& d, const RecordView& r, const RunIn& before, int ncol, const int* columns, double* out);

// task(0 .. n - 1) on up to `threads` threads; the tasks must be independent.
template <class Task>
void ParallelFor(int n, int threads, Task&& task) {
  threads = std::min({threads, n, 256});
  if (threads <= 1) {
    for (int i = 0; i < n; i++) task(i);
    return;
  }
  std::atomic<int> next{0};
  const auto work = [&] {
    for (int i; (i = next.fetch_add(1)) < n;) task(i);
  };
  std::vector<std::thread> pool;
  for (int k = 1; k < threads; k++) pool.emplace_back(work);
  work();
  for (std::thread& t : pool) t.join();
}

}  // namespace mrdamp

#endif  // MRDAMP_CORE_RECORD_H_
