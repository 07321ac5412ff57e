// Dampers in worlds on a CPU, for mrdamp.warp: MuJoCo Warp's arrays by their addresses.
#include "core/worlds.h"

#include "capi/make.h"
#include "core/pool.h"

using namespace mrdamp;

namespace {

// f(worlds, world) of each, on `threads`. One call at a time.
template <class F>
void InEach(const Worlds& a, int threads, F&& f) {
  static Pool pool;
  pool.For(a.worlds, threads, 16, [&](int first, int last, int) {
    for (int world = first; world < last; world++) f(a, world);
  });
}

}  // namespace

extern "C" {

MRDAMP_API void mrdamp_worlds_sizes(int* sizes) {
  const std::size_t all[] = {sizeof(Worlds), sizeof(WorldDamper), sizeof(WorldLine), sizeof(WorldPast), sizeof(Reading),
                             sizeof(ReadingState), sizeof(SensorParams), static_cast<std::size_t>(kMostDampers)};
  for (const std::size_t size : all) *sizes++ = static_cast<int>(size);
}
MRDAMP_API const void* mrdamp_worlds_net(const mrdamp_narx* net) { return net->net.get(); }
MRDAMP_API void mrdamp_worlds_act(const void* worlds, int threads) {
  InEach(*static_cast<const Worlds*>(worlds), threads, ActInWorld);
}
MRDAMP_API void mrdamp_worlds_read(const void* worlds, int threads) {
  InEach(*static_cast<const Worlds*>(worlds), threads, ReadWorld);
}

}  // extern "C"
