// The chain: command -> driver -> magnetics -> fluid -> mechanics -> mount -> sensor.
//
// Pure physics of one damper whose motion is known: MuJoCo, the record runner, the frame and a laboratory's
// real-time loop all step this. A state is plain doubles and can be copied, stored and tried at will.
#ifndef MRDAMP_CORE_CHAIN_H_
#define MRDAMP_CORE_CHAIN_H_

#include "core/params.h"
#include "effects/driver.h"
#include "effects/fluid.h"
#include "effects/magnetics.h"
#include "effects/mechanics.h"
#include "effects/mount.h"
#include "laws/coefficients.h"
#include "laws/narx.h"

namespace mrdamp {

// A damper's fixed part.
struct Damper {
  Law law = Law::kBingham;
  Params p;
  const NarxNet* net = nullptr;  // narx alone; not owned
  bool hold = true;              // the command is held between samples; false: straight lines

  double Clamp(double u) const;
};

// Inner state of the chain; plain doubles.
struct ChainState {
  double time = 0;             // s since the start
  Coil coil;                   // the driver's lag
  Magnet magnet;               // remanence
  double heat = 0, body = 0;   // K, of the fluid and of the body around it
  double z = 0, r = 0;         // Bouc-Wen z and x - y; or Gavin's g and g'
  double bristle = 0;          // m, seal friction
  double piston = 0, piston_velocity = 0;  // behind the mount
  double piston_slope = 0;     // N s/m, d(force)/dv of the last balance, where the next one's solve begins
  Stroke stroke;
  Pocket gas;        // in series with the fluid
  double plate = 0;  // -1 to 1, asymmetry along the stroke or in its own time
  Rubber rubber;    // friction inside the mount
  Felt felt;        // what moving masses on springs of their own feel
};

inline constexpr int kChainSize = sizeof(ChainState) / sizeof(double);
static_assert(sizeof(ChainState) % sizeof(double) == 0, "the state is stored as doubles");

// With what only some dampers have. `past` and `line` may be null where law and effects do not need them.
struct State {
  ChainState c;
  NarxHistory* past = nullptr;
  DelayLine* line = nullptr;
};

// Piston motion in a step: velocity runs straight from v0 to v1, shifted so that the path is x1 - x0.
struct Motion {
  double x0, v0, x1, v1, dt;
};

// What the damper does at one instant.
struct Observation {
  double force;      // N, at the rod end, with the moving mass
  double damper;     // N, without it
  double slope;      // N s/m, d(force)/dv at fixed state
  double current, field, temperature, piston, inner;
};

// Starts the chain at rest at displacement x with command u. The narx history, where used, is filled too.
void Start(const Damper& d, State* s, double x, double v, double u);

// Steps the chain over the motion while the command runs from u0 to u1 (u1 == u0: held).
void Advance(const Damper& d, State* s, const Motion& m, double u0, double u1);

// To be called where a step ends at a sample, with the motion and the command there: a network's own sample that
// falls on this instant takes them in place of what the step ran with.
void Settle(const Damper& d, State* s, double x, double v, double u);

// The force at the state s, at rod displacement x, velocity v and acceleration a, command u now.
Observation Observe(const Damper& d, const State& s, double x, double v, double a, double u);

// The force of that alone; behind a mount it takes no force of the damper's.
double RodForce(const Damper& d, const State& s, double x, double v, double a, double u);

// The coil current of that alone.
double CurrentNow(const Damper& d, const State& s, double u);

// Checks ranges and what the law needs; false and one line (without element name) on failure.
bool Check(const Damper& d, char* error, int error_size);

}  // namespace mrdamp

#endif  // MRDAMP_CORE_CHAIN_H_
