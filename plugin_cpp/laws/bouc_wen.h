// Bouc-Wen: F = c0 v + alpha z + k0 (x - x0) (Spencer et al. 1997, doi:10.1061/(ASCE)0733-9399(1997)123:3(230)).
#ifndef MRDAMP_LAWS_BOUC_WEN_H_
#define MRDAMP_LAWS_BOUC_WEN_H_

#include "laws/coefficients.h"
#include "laws/hysteresis.h"

namespace mrdamp {

struct BoucWen {
  // z over a step from velocity va to vb (linear, of mean dx / dt): split where the path turns.
  static double Step(const Params& p, const Coefficients& k, double z, double va, double vb, double dt) {
    if (va * vb < 0) {
      const double turn = dt * va / (va - vb);
      z = Hysteresis(z, 0.5 * va * turn, p.A, k.beta, k.gamma, p.n);
      return Hysteresis(z, 0.5 * vb * (dt - turn), p.A, k.beta, k.gamma, p.n);
    }
    return Hysteresis(z, 0.5 * (va + vb) * dt, p.A, k.beta, k.gamma, p.n);
  }

  static LawForce Force(const Params& p, const Coefficients& k, double z, double x, double v) {
    return {k.c0 * v + k.yield * z, k.k0 * (x - p.x0), k.c0};
  }
};

}  // namespace mrdamp

#endif  // MRDAMP_LAWS_BOUC_WEN_H_
