// The mean force of a damper over a step of the engine, balanced with the motion that it causes.
#ifndef MRDAMP_CORE_BALANCE_H_
#define MRDAMP_CORE_BALANCE_H_

#include "core/solve.h"
#include "core/weight.h"

namespace mrdamp {

// The engine's Euler step is a leapfrog: velocities stand half a step before positions, so the force that it takes
// belongs to the position at the start of the step and the mean of both velocities. Where the damper is soft against
// the mass (q = h w dF/dv small) that is the accurate answer:
//     smooth:  F = (1 - weight) F0 + weight F(present state, v1), weight = EndWeight(q).
// Where it is stiff or has a kink (dry friction, a gap that closes, hysteresis that turns) only
//     firm:    F = F(state at the end of the step, v1)
// neither rings nor gains energy. Between the two the answer is blended; a stiff but straight dashpot needs no
// firm step, since EndWeight makes its smooth one exact. Beside damping of the structure's own, which the engine takes
// at the end of the step, q is that of the mass alone: a smaller weight would overshoot the steady speed under a load.
struct Blend {
  double weight;  // of the force at the end, in the smooth answer
  double firm;    // share of the firm answer
};

inline Blend BlendOf(double q, double bare, double slope, double chord, double present) {
  const double most = max(max(slope, chord), 1e-300);
  const double bent = fabs(slope - chord) / most;
  const double inner = max(0.0, most - present) / most;  // share of the slope that is no dashpot
  const double t = min(max((q - 0.5) / 1.0, 0.0), 1.0);
  const double soft = max(0.0, max(bent, inner) - 1e-3);  // less is the differences' own error
  return {EndWeight(q * bare), t * t * (3 - 2 * t) * min(1.0, 5 * soft)};
}

// Local slope of a trial around v, over a small part of what the step may change.
template <class OneDamper>
double LocalSlope(const OneDamper& d, double v, double at, double h, double span) {
  const double dv = 1e-3 * span + 1e-12;
  return max(max((d.trial(v + dv, h) - at) / dv, (at - d.trial(v - dv, h)) / dv), 0.0);
}

// Mean force over a step of h of a damper alone, with mobility w (1/kg): the velocity ends at free - h w F. For the
// members of d see mujoco/step.h.
template <class OneDamper>
double SolveOne(double h, const OneDamper& d, double w) {
  const double q = h * w;
  if (!(q > 0)) return d.force;
  // A moving mass makes the body heavier for all other forces.
  const double lighter = 1 / (1 + w * d.mass);
  const double free = d.velocity + (d.free - d.velocity) * lighter, qm = q * lighter;
  const double fa = d.trial(free, h), vb = free - qm * fa, fb = d.trial(vb, h);
  const double present = max(d.slope, 0.0);
  const double scale = fabs(d.force) + fabs(fa);
  const double tolerance = 1e-10 * scale + 1e-12;
  Blend blend{0.5, 0};
  double firm = free;
  const double change = fabs(fb - fa);
  if (change < 0.1 * fabs(fa)) {
    blend.weight = EndWeight(change / fabs(fa) * d.bare);
  } else if (change > 0) {
    double end = fb;
    const auto residual = [&](double v) { return (v - free) / qm + (end = d.trial(v, h)); };
    firm = SolveIncreasing(residual, vb, 1 / qm + max(present, (fb - fa) / (vb - free)), tolerance);
    const double chord = free != firm ? max(0.0, (fa - end) / (free - firm)) : present;
    const double slope = LocalSlope(d, firm, end, h, fabs(free - firm));
    // Networks know no slope of their own: the present state's is measured too.
    const double dashpot = LocalSlope(d, firm, d.trial(firm, 0), 0, fabs(free - firm));
    blend = BlendOf(qm * max(slope, chord), d.bare, slope, chord, dashpot);
  }
  double v1 = firm;
  if (blend.firm < 1) {
    const auto residual = [&](double v) {
      return (v - free) / qm + (1 - blend.weight) * d.force + blend.weight * d.trial(v, 0);
    };
    const double smooth = SolveIncreasing(residual, vb, 1 / qm + blend.weight * present, tolerance);
    v1 = smooth + blend.firm * (firm - smooth);
  }
  return (d.free - v1) / q;
}

}  // namespace mrdamp

#endif  // MRDAMP_CORE_BALANCE_H_
