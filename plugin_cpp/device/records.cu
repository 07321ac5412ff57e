// Parameter sets through a record on a GPU, a thread each; compiled as worlds.cu is.
#include "core/chain.cc"
#include "core/piece.cc"
#include "core/run.cc"
#include "core/shift.h"
#include "device/no_network.h"

struct Records {
  int sets, n, columns, hold;
  int from, to;                        // samples that lead into the motion
  double dt;                           // s
  const double *params, *x, *v, *a, *u;  // sets x attributes in use; n samples each
  const int* column;                   // numbers of mrdamp.h
  double *moved, *out;                 // sets x kRoom x n, null where channels read the motion; sets x columns x n
};

extern "C" __global__ void run(Records r) {
  const int set = blockIdx.x * blockDim.x + threadIdx.x;
  if (set >= r.sets) return;
  const std::size_t n = r.n, place = set;
  mrdamp::Damper d;
  d.hold = r.hold != 0;
  for (int i = 0; i < mrdamp::kParamCount; i++) d.p.data()[i] = r.params[place * mrdamp::kParamCount + i];
  MrdampLane lane = {d.p.data(), r.n, r.x, r.v, r.a, r.u, r.from, r.to, r.out + place * r.columns * n};
  if (r.moved && mrdamp::Misread(d.p)) {
    mrdamp::TakeBack(d.p.channel_shift_d, d.p.motion_lag_tau, d.p.motion_lag_width, r.dt, r.moved + mrdamp::kRoom * place * n, &lane);
  }
  mrdamp::Run(d, &lane, 1, r.dt, r.columns, r.column);
}
