// Bouc-Wen: F = c0 v + alpha z + k0 (x - x0) (Spencer et al. 1997, doi:10.1061/(ASCE)0733-9399(1997)123:3(230)).
#ifndef MRDAMP_LAWS_BOUC_WEN_H_
#define MRDAMP_LAWS_BOUC_WEN_H_

#include <cstdio>

#include "laws/coefficients.h"
#include "laws/hysteresis.h"

namespace mrdamp {

struct BoucWen : PlainLaw {
  static constexpr LawKind kIs{true, false, false};

  static void Fill(const Params& p, const Fluid& f, Real, Coefficients* k) {
    k->yield = Follow(p.alpha_a, p.alpha_b, p.alpha_c, p.alpha_e, p.alpha_r, f.b) * f.yield;
    k->k0 = p.k0;
    k->gamma = p.gamma;
    k->beta = p.beta;
    if (Head(p.hysteresis_rate) != 0) {
      const Real fall = p.hysteresis_floor + (1 - p.hysteresis_floor) * exp(-p.hysteresis_rate * max(f.b, 0.0));
      k->gamma *= fall;
      k->beta *= fall;
    }
  }

  static bool Check(const Params& p, char* error, int size) {
    const double sum = Head(p.beta + p.gamma), gamma = Head(p.gamma);
    if (sum <= 0) std::snprintf(error, size, "beta + gamma = %g; it must be above 0, or z grows without bound", sum);
    else if (gamma < 0) std::snprintf(error, size, "gamma = %g; it must be at least 0, or z grows without bound after a turn", gamma);
    return sum > 0 && gamma >= 0;
  }

  // z over a step from velocity va to vb (linear, of mean dx / dt): split where the path turns.
  static void Step(const Params& p, const Coefficients& k, Real* z, Real*, const LawStep& m) {
    const auto follow = [&](Real path) { *z = Hysteresis(*z, path, p.A, k.beta, k.gamma, p.n); };
    const Mask turns = m.va * m.vb < 0;
    if (!Any(turns)) return follow(0.5 * (m.va + m.vb) * m.dt);
    const Real turn = Select(turns, m.dt * m.va / (m.va - m.vb), m.dt);
    follow(0.5 * Select(turns, m.va, m.va + m.vb) * turn);
    follow(Select(turns, 0.5 * m.vb * (m.dt - turn), 0));
  }

  static LawForce Force(const Params& p, const Coefficients& k, Real z, Real, Real x, Real v) {
    return {k.c0 * v + k.yield * z, k.k0 * (x - p.x0), k.c0};
  }
};

}  // namespace mrdamp

#endif  // MRDAMP_LAWS_BOUC_WEN_H_
