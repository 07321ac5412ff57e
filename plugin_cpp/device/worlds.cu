// Dampers in worlds on a GPU, compiled at run time (mrdamp.gpu) for a law and the attributes in use.
#include "core/chain.cc"
#include "core/piece.cc"
#include "core/worlds.h"
#include "device/no_network.h"

extern "C" __global__ void act(mrdamp::Worlds a) {
  const int world = blockIdx.x * blockDim.x + threadIdx.x;
  if (world < a.worlds) mrdamp::ActInWorld(a, world);
}

extern "C" __global__ void read(mrdamp::Worlds a) {
  const int world = blockIdx.x * blockDim.x + threadIdx.x;
  if (world < a.worlds) mrdamp::ReadWorld(a, world);
}
