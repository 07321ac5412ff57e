// Bingham: F = c0 v + fy tanh(v / v_ref); v_ref -> 0 is the sign function (Stanway, Sproston, Stevens 1987).
#ifndef MRDAMP_LAWS_BINGHAM_H_
#define MRDAMP_LAWS_BINGHAM_H_

#include "laws/coefficients.h"

namespace mrdamp {

struct Bingham : PlainLaw {
  // A very steep tanh in place of the sign function: at rest a step requires a force that depends on the velocity.
  static constexpr double kSharpest = 1e-9;  // m/s

  static void Fill(const Params& p, const Fluid& f, Real, Coefficients* k) {
    k->yield = Follow(p.fya, p.fyb, p.fyc, p.fye, p.fyr, f.b) * f.yield;
  }

  static LawForce Force(const Params& p, const Coefficients& k, Real, Real, Real, Real v) {
    const Real width = max(p.v_ref, kSharpest);
    const Real turn = tanh(v / width);
    return {k.c0 * v + k.yield * turn, 0, k.c0 + k.yield * (1 - turn * turn) / width};
  }
};

}  // namespace mrdamp

#endif  // MRDAMP_LAWS_BINGHAM_H_
