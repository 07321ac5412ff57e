// The chain of one law for a pack of dampers, compiled for a processor's vector units with
//   -DMRDAMP_LANES=8 -DMRDAMP_LAW=kBoucWen -DMRDAMP_PACK=name -Dmrdamp=another_name   and -DMRDAMP_PLAIN or not.
// The namespace has another name for each pack, so that no code for one processor gets into that for another.
#include "core/chain.cc"
#include "core/piece.cc"
#include "core/run.cc"

extern "C" MrdampRun MRDAMP_PACK;

extern "C" void MRDAMP_PACK(const MrdampLane* lanes, int count, double dt, bool hold, int ncol, const int* columns) {
  mrdamp::Damper d;
  d.hold = hold;
  d.p.Each([&](int i, mrdamp::Real& attribute) {
    for (int l = 0; l < mrdamp::kLanes; l++) attribute.Set(l, lanes[l < count ? l : 0].params[i]);
  });
  mrdamp::Run(d, lanes, count, dt, ncol, columns);
}
