// The chain: command -> driver -> magnetics -> fluid -> mechanics -> mount -> sensor.
//
// The physics of one damper with known motion, used by MuJoCo, the record runner, the frame and real-time code. A
// state is plain doubles and can be copied and stored.
#ifndef MRDAMP_CORE_CHAIN_H_
#define MRDAMP_CORE_CHAIN_H_


#include "core/params.h"
#include "effects/driver.h"
#include "effects/fluid.h"
#include "effects/magnetics.h"
#include "effects/mechanics.h"
#include "effects/mount.h"
#include "laws/law.h"
#include "laws/narx.h"

namespace mrdamp {

// A damper's fixed part.
struct Damper {
#ifdef MRDAMP_PACK_LAW  // code that is made for one law
  static constexpr Law law = Law::MRDAMP_PACK_LAW;
  Law law_left_out = law;
#else
  Law law{};
#endif
  Params p;
  const NarxNet* net = nullptr;  // narx alone; not owned
  bool hold = true;              // the command is constant between samples; false: linear

  Real Clamp(Real u) const;
  // The fluid feels the size of the field: without a least command a negative current acts as a positive one. A
  // network takes what it was trained with.
  bool AnySign() const { return std::isnan(Head(p.command_min)) && law != Law::kNarx; }
  Real Acting(Real current) const { return AnySign() ? fabs(current) : current; }
};

// Inner state of the chain; plain doubles.
struct ChainState {
  Real time = 0;             // s since the start; read of the first lane alone
  Coil coil;                   // the driver's lag
  Magnet magnet;               // remanence
  Real field = 0;              // of the coil's current
  Real heat = 0, body = 0;   // K, of the fluid and of the housing
  Real z = 0, r = 0;         // Bouc-Wen z and x - y; or Gavin's g and g'
  Mechanics mechanics;       // seal friction
  Real piston = 0, piston_velocity = 0;  // behind the mount
  Real piston_slope = 0;     // N s/m, d(force)/dv of the last balance, start of the next solve
  Stroke stroke;
  GasPocket gas;        // in series with the fluid
  Real plate = 0;  // -1 to 1, asymmetry along the stroke or in its own time
  Elastomer elastomer;    // friction inside the mount
  SprungMasses sprung;        // accelerations of sprung moving masses
};

inline constexpr int kChainSize = sizeof(ChainState) / sizeof(Real);
static_assert(sizeof(ChainState) % sizeof(Real) == 0, "the state is stored as doubles");

// State of optional parts. `past` and `line` may be null if law and effects do not need them.
struct State {
  ChainState c;
  NarxHistory* past = nullptr;
  DelayLine* line = nullptr;
};

// What a pack's state is in the lanes that are not `here` comes back at the end of the scope.
struct Held {
#ifdef MRDAMP_LANES
  State* s;
  Mask out;
  bool some = Any(out);
  alignas(ChainState) unsigned char kept[sizeof(ChainState)];  // as a ChainState it would be made of zeros first

  Held(State* state, Mask here) : s(state), out(!here) {
    if (some) std::memcpy(kept, &s->c, sizeof kept);
  }
  ~Held() {
    if (some) Keep(out, &s->c, *reinterpret_cast<const ChainState*>(kept));
  }
#else
  Held(State*, Mask) {}
#endif
};

// Piston motion in a step: velocity linear from v0 to v1, shifted so that the path is x1 - x0.
struct Motion {
  Real x0, v0, x1, v1;
  double dt;
};

// Output of the damper at one instant.
struct Observation {
  Real force;      // N, at the rod end, with the moving mass
  Real damper;     // N, without it
  Real slope;      // N s/m, d(force)/dv at fixed state
  Real current, field, temperature, piston, inner;
};

// Starts the chain at rest at displacement x, where the command was u before, including the narx history.
void Start(const Damper& d, State* s, Real x, Real v, Real u);

// Steps the chain over the motion while the command runs linearly from u0 to u1 (u1 == u0: constant).
void Advance(const Damper& d, State* s, const Motion& m, Real u0, Real u1);

// To be called if a step ends at a sample, with the motion and the command there: they replace the step's values in a
// network sample at this instant.
void Settle(const Damper& d, State* s, Real x, Real v, Real u);

// Of a command that jumps at an instant: as it was, as it is.
enum Side { kBefore, kAfter };

// True if the current jumps with the command: a held one without a lag.
inline bool CurrentJumps(const Damper& d) {
  return !HasLag(d.p) && (HasDelay(d.p) ? Jumps(d.p, d.hold) : d.hold);
}

// The force in the state s, at rod displacement x, velocity v and acceleration a, with the present command u. side: of a
// delayed command that arrives now.
Observation Observe(const Damper& d, const State& s, Real x, Real v, Real a, Real u, Side side = kAfter);

// The force alone, before a change of the command; behind a mount it is independent of the damper's force.
Real RodForce(const Damper& d, const State& s, Real x, Real v, Real a, Real u);

// How much an inner rate that is fast against dt changes with a jump of the command from u0 to u1, within dt: that of
// a law with an inner displacement.
Real RateJump(const Damper& d, const State& s, Real x, Real v, Real u0, Real u1, double dt);

// The coil current alone.
Real CurrentNow(const Damper& d, const State& s, Real u);

// Checks ranges and the requirements of the law; false and one line (without element name) on failure.
bool Check(const Damper& d, char* error, int error_size);

}  // namespace mrdamp

#endif  // MRDAMP_CORE_CHAIN_H_
