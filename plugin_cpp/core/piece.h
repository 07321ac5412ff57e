// A piece of a step: piston or rod motion through fluid, mechanics and mount.
#ifndef MRDAMP_CORE_PIECE_H_
#define MRDAMP_CORE_PIECE_H_

#include "core/chain.h"
#include "core/forces.h"

namespace mrdamp {

// A piece of piston motion: velocities at its ends with a path of their mean.
struct Piece {
  Real x, va, vb;
  double dt;
  Pace pace = {};
  Real path() const { return 0.5 * (va + vb) * dt; }
};

// Steps the chain behind its magnetics over a piece of rod motion while the field runs straight. What is in series is
// stepped in shorter ones where its error asks for them.
void StepPiece(const Damper& d, State* s, const Piece& m, Real field0, Real field1);

// Where the piston rests while the rod stands at x: its springs may be preloaded.
Real Rest(const Damper& d, const State& s, Real x);

// The piston's velocity just after a jump of the field, while all states are as they were: where it may begin to slip.
// Where `here`.
void Release(const Damper& d, State* s, Real rod, Real field, Mask here);

}  // namespace mrdamp

#endif  // MRDAMP_CORE_PIECE_H_
