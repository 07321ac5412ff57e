// One damper through one record, as it passes between code for packs of different lengths: plain C.
#ifndef MRDAMP_CORE_LANE_H_
#define MRDAMP_CORE_LANE_H_

#include "mrdamp.h"

struct MrdampLane {
  const double* params;           // attributes
  int n;                          // samples
  const double *x, *v, *a, *u;    // (n,)
  int from, to;                   // samples that lead into the motion; from == to: none
  double* out;                    // (columns, n)
};

// One row of closed loops over a control period (core/loop.h).
struct MrdampRow {
  double* state;
  const mrdamp_load* load;
  const double* command;      // one for each damper
  double *criteria, *measured;
  double* within;             // (steps, measurements) at their starts, or null
};

// The entries of code for one law and one length of pack (lanes/pack.cc). Dampers that share a pack are alike (core/packs.h).
struct MrdampPack {
  // `count` records at once.
  void (*run)(const MrdampLane* lanes, int count, double dt, bool hold, int ncol, const int* columns);
  // Work space for closed loops: mrdamp::Loop of dampers with attributes `params` one after the other. The others are
  // the scalar code's objects, whose layout is the same there.
  void* (*loop)(const void* linear, const void* plan, const void* place, const void* drift, int dampers, const double* params,
                int attributes, bool hold, int accelerometers, const double* readings);
  void (*step)(void* loop, const MrdampRow* rows, int count, const double* noise);
  void (*free)(void* loop);
};

#endif  // MRDAMP_CORE_LANE_H_
