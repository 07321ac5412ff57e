// The chain of one law for packs of dampers, compiled for a processor's vector units with
//   -DMRDAMP_LANES=8 -DMRDAMP_PACK_LAW=kBoucWen -DMRDAMP_PACK=name -Dmrdamp=another_name   and -DMRDAMP_PLAIN or not.
// The namespace has another name for each pack, so that no code for one processor gets into that for another.
#include "core/assembly.cc"
#include "core/chain.cc"
#include "core/loop.cc"
#include "core/piece.cc"
#include "core/run.cc"

namespace mrdamp {

namespace {

// Lane by lane: attributes(lane) of each.
template <class F>
Damper Made(bool hold, F&& attributes) {
  Damper d;
  d.hold = hold;
  d.p.Each([&](int i, Real& attribute) { attribute = Gather([&](int l) { return attributes(l)[i]; }); });
  return d;
}

// What a loop holds on to.
struct Owned {
  std::vector<Damper> dampers;
  std::vector<SensorParams> accelerometers;
};
struct OwnedLoop : Owned {
  Loop loop;

  OwnedLoop(Owned parts, const void* linear, const void* plan, const void* place, const void* drift)
      : Owned(std::move(parts)), loop(*static_cast<const Linear*>(linear), *static_cast<const RowsPlan*>(plan),
                                      *static_cast<const Sparse*>(place), *static_cast<const Sparse*>(drift), dampers, accelerometers) {}
};

void RunPack(const MrdampLane* lanes, int count, double dt, bool hold, int ncol, const int* columns) {
  Run(Made(hold, [&](int l) { return lanes[l < count ? l : 0].params; }), lanes, count, dt, ncol, columns);
}

void* NewLoop(const void* linear, const void* plan, const void* place, const void* drift, int dampers, const double* params,
              int attributes, bool hold, int accelerometers, const double* readings) {
  Owned parts;
  for (int k = 0; k < dampers; k++) parts.dampers.push_back(Made(hold, [&](int) { return params + static_cast<std::size_t>(k) * attributes; }));
  for (int k = 0; k < accelerometers; k++) {
    SensorParams p;
    for (std::size_t i = 0; i < sizeof p / sizeof(Real); i++) reinterpret_cast<Real*>(&p)[i] = *readings++;
    parts.accelerometers.push_back(p);
  }
  return new OwnedLoop(std::move(parts), linear, plan, place, drift);
}

void StepLoop(void* loop, const MrdampRow* rows, int count, const double* noise) {
  static_cast<OwnedLoop*>(loop)->loop.Step(rows, count, noise);
}

void FreeLoop(void* loop) { delete static_cast<OwnedLoop*>(loop); }

}  // namespace

}  // namespace mrdamp

extern "C" const MrdampPack MRDAMP_PACK;
extern "C" const MrdampPack MRDAMP_PACK = {mrdamp::RunPack, mrdamp::NewLoop, mrdamp::StepLoop, mrdamp::FreeLoop};
