// Bingham: F = c0 v + fy tanh(v / v_ref); v_ref -> 0 is the sign function (Stanway, Sproston, Stevens 1987).
#ifndef MRDAMP_LAWS_BINGHAM_H_
#define MRDAMP_LAWS_BINGHAM_H_

#include "laws/coefficients.h"

namespace mrdamp {

struct Bingham {
  static LawForce Force(const Params& p, const Coefficients& k, double v) {
    double turn = v > 0 ? 1 : (v < 0 ? -1 : 0), slope = k.c0;
    if (p.v_ref > 0) {
      turn = std::tanh(v / p.v_ref);
      slope += k.yield * (1 - turn * turn) / p.v_ref;
    }
    return {k.c0 * v + k.yield * turn, 0, slope};
  }
};

}  // namespace mrdamp

#endif  // MRDAMP_LAWS_BINGHAM_H_
