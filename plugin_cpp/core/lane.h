// One damper through one record, as it passes between code for packs of different lengths: plain C.
#ifndef MRDAMP_CORE_LANE_H_
#define MRDAMP_CORE_LANE_H_

struct MrdampLane {
  const double* params;           // attributes
  int n;                          // samples
  const double *x, *v, *a, *u;    // (n,)
  int from, to;                   // samples that lead into the motion; from == to: none
  double* out;                    // (columns, n)
};

// `count` lanes at once, alike in what mrdamp::Alike compares.
using MrdampRun = void(const MrdampLane* lanes, int count, double dt, bool hold, int ncol, const int* columns);

#endif  // MRDAMP_CORE_LANE_H_
