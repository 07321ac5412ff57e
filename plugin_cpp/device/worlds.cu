// Dampers in worlds on a GPU, compiled at run time (mrdamp.warp.cuda) for a law and the attributes in use.
#include "core/chain.cc"
#include "core/piece.cc"
#include "core/worlds.h"

namespace mrdamp {
// Networks hold their weights in host memory.
void Narx::Start(const NarxNet&, NarxHistory*, double, double, double) {}
void Narx::Push(const NarxNet&, NarxHistory*, double, double, double) {}
void Narx::Amend(const NarxNet&, NarxHistory*, double, double, double) {}
double Narx::Force(const NarxNet&, const NarxHistory&, double, double, double, double) { return 0; }
}  // namespace mrdamp

extern "C" __global__ void act(mrdamp::Worlds a) {
  const int world = blockIdx.x * blockDim.x + threadIdx.x;
  if (world < a.worlds) mrdamp::ActInWorld(a, world);
}

extern "C" __global__ void read(mrdamp::Worlds a) {
  const int world = blockIdx.x * blockDim.x + threadIdx.x;
  if (world < a.worlds) mrdamp::ReadWorld(a, world);
}
