// The chain of one law for a pack of dampers (-DMRDAMP_LANES=8 -DMRDAMP_LAW=kBoucWen -Dmrdamp=...), compiled for a
// processor's vector units. The namespace has another name for each pack, so that nothing of it is shared.
#include "core/chain.cc"
#include "core/piece.cc"
#include "core/run.cc"

#define MRDAMP_JOIN(lanes, law) mrdamp_pack_##lanes##_##law
#define MRDAMP_PACK_NAME(lanes, law) MRDAMP_JOIN(lanes, law)

extern "C" MrdampRun MRDAMP_PACK_NAME(MRDAMP_LANES, MRDAMP_LAW);

extern "C" void MRDAMP_PACK_NAME(MRDAMP_LANES, MRDAMP_LAW)(const MrdampLane* lanes, int count, double dt, bool hold, int ncol,
                                                           const int* columns) {
  mrdamp::Damper d;
  d.hold = hold;
  for (int i = 0; i < mrdamp::kParamCount; i++) {
    for (int l = 0; l < mrdamp::kLanes; l++) d.p.data()[i].Set(l, lanes[l < count ? l : 0].params[i]);
  }
  mrdamp::Run(d, lanes, count, dt, ncol, columns);
}
