// Bouc-Wen: F = c0 v + alpha z + k0 (x - x0) (Spencer et al. 1997, doi:10.1061/(ASCE)0733-9399(1997)123:3(230)).
#ifndef MRDAMP_LAWS_BOUC_WEN_H_
#define MRDAMP_LAWS_BOUC_WEN_H_

#include "laws/coefficients.h"
#include "laws/hysteresis.h"

namespace mrdamp {

struct BoucWen {
  // z over a step from velocity va to vb (linear, of mean dx / dt): split where the path turns.
  static Real Step(const Params& p, const Coefficients& k, Real z, Real va, Real vb, double dt) {
    const Mask turns = va * vb < 0;
    if (!Any(turns)) return Hysteresis(z, 0.5 * (va + vb) * dt, p.A, k.beta, k.gamma, p.n);
    const Real turn = Select(turns, dt * va / (va - vb), dt);
    z = Hysteresis(z, 0.5 * Select(turns, va, va + vb) * turn, p.A, k.beta, k.gamma, p.n);
    return Hysteresis(z, Select(turns, 0.5 * vb * (dt - turn), 0), p.A, k.beta, k.gamma, p.n);
  }

  static LawForce Force(const Params& p, const Coefficients& k, Real z, Real x, Real v) {
    return {k.c0 * v + k.yield * z, k.k0 * (x - p.x0), k.c0};
  }
};

}  // namespace mrdamp

#endif  // MRDAMP_LAWS_BOUC_WEN_H_
