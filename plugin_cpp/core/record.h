// Simulation of a whole record by the chain.
#ifndef MRDAMP_CORE_RECORD_H_
#define MRDAMP_CORE_RECORD_H_

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <thread>
#include <vector>

#include "core/run.h"

namespace mrdamp {

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

// One damper through one record, with the samples that lead into it; out[c] (n doubles) for each requested column of mrdamp.h.
struct Job {
  const Damper* d;
  const RecordView* record;
  RunIn before;
  double* out;
};

// Runs all on up to `threads` threads, in packs of up to `lanes` (0: what the processor has). Results do not depend on
// either.
void RunJobs(const std::vector<Job>& jobs, int ncol, const int* columns, int threads, int lanes);

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
