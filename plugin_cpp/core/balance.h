// The mean force of a damper over a step of the engine, balanced with the motion that it causes.
#ifndef MRDAMP_CORE_BALANCE_H_
#define MRDAMP_CORE_BALANCE_H_

#include "core/solve.h"
#include "core/weight.h"

namespace mrdamp {

// One damper in a step: a class with the members
//   velocity   m/s, at the present
//   free       m/s at the end of the step, without any damper's force
//   force      N, at the present
//   slope      N s/m, derivative of the present state's force with the velocity
//   mass       kg, moving mass along the damper
//   bare       its mobility without the structure's implicit damping and closed contacts over that with them; at least 1
//   trial(v, part)   its force (without the moving mass) after the fraction `part` of the step at the velocity v; 0: the
//                    present state
// Numbers: n or n x n doubles, 0 to begin with, as std::vector<double>.

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

// Mean force over a step of h of a damper alone, with mobility w (1/kg): the velocity ends at free - h w F.
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

inline void Swap(double& a, double& b) {
  const double kept = a;
  a = b;
  b = kept;
}

// Solves a x = b in place by elimination with row exchange; a is n x n.
template <class Numbers>
void Eliminate(Numbers* a, Numbers* b) {
  const int n = static_cast<int>(b->size());
  for (int k = 0; k < n; k++) {
    int best = k;
    for (int i = k + 1; i < n; i++) {
      if (fabs((*a)[i * n + k]) > fabs((*a)[best * n + k])) best = i;
    }
    for (int j = 0; j < n; j++) Swap((*a)[k * n + j], (*a)[best * n + j]);
    Swap((*b)[k], (*b)[best]);
    const double pivot = (*a)[k * n + k];
    if (pivot == 0) continue;
    for (int i = k + 1; i < n; i++) {
      const double f = (*a)[i * n + k] / pivot;
      if (f == 0) continue;
      for (int j = k; j < n; j++) (*a)[i * n + j] -= f * (*a)[k * n + j];
      (*b)[i] -= f * (*b)[k];
    }
  }
  for (int k = n; k-- > 0;) {
    for (int j = k + 1; j < n; j++) (*b)[k] -= (*a)[k * n + j] * (*b)[j];
    const double pivot = (*a)[k * n + k];
    (*b)[k] = pivot != 0 ? (*b)[k] / pivot : 0;
  }
}

// Newton's method on the forces of dampers that act on each other: F_k = law_k(v_k(F)), with steps halved until the
// misfit falls. law(k, v, &slope) gives force and slope. False where it did not arrive.
template <class Dampers, class Numbers, class LawOf>
bool Newton(double h, const Dampers& d, const Numbers& w, LawOf&& law, Numbers* force) {
  const int n = static_cast<int>(d.size());
  Numbers v(n), f(n), slope(n), misfit(n), step(n), trial(n), matrix(n * n);
  const auto velocities = [&](const Numbers& forces) {
    for (int k = 0; k < n; k++) {
      v[k] = d[k].free;
      for (int j = 0; j < n; j++) v[k] -= h * w[k * n + j] * forces[j];
    }
  };
  const auto measure = [&](const Numbers& forces, bool slopes) {
    velocities(forces);
    double sum = 0;
    for (int k = 0; k < n; k++) {
      f[k] = law(k, v[k], slopes ? &slope[k] : nullptr);
      misfit[k] = forces[k] - f[k];
      sum += misfit[k] * misfit[k];
    }
    return sum;
  };
  double now = measure(*force, true);
  for (int i = 0; i < 40; i++) {
    double size = 0;
    for (int k = 0; k < n; k++) size += (*force)[k] * (*force)[k] + f[k] * f[k];
    if (!(now > 1e-22 * size + 1e-24)) return true;
    for (int k = 0; k < n; k++) {
      for (int j = 0; j < n; j++) matrix[k * n + j] = (k == j) + slope[k] * h * w[k * n + j];
      step[k] = -misfit[k];
    }
    Eliminate(&matrix, &step);
    double best = now, share = 1;
    for (int half = 0; half < 12; half++, share *= 0.5) {
      for (int k = 0; k < n; k++) trial[k] = (*force)[k] + share * step[k];
      best = measure(trial, false);
      if (best < now) break;
    }
    if (!(best < now)) return false;  // a kink holds it up
    *force = trial;
    now = measure(*force, true);
  }
  return false;
}

// The forces (n) at the present for Runge-Kutta's stages; of them the moving masses alone need the acceleration.
template <class Dampers, class Numbers>
void PresentForces(double h, const Dampers& d, const Numbers& w, Numbers* force) {
  const int n = static_cast<int>(d.size());
  Numbers matrix(n * n), a(n);
  for (int k = 0; k < n; k++) {
    a[k] = (d[k].free - d[k].velocity) / h;
    for (int j = 0; j < n; j++) {
      a[k] -= w[k * n + j] * d[j].force;
      matrix[k * n + j] = (k == j) + w[k * n + j] * d[j].mass;
    }
  }
  Eliminate(&matrix, &a);
  for (int k = 0; k < n; k++) (*force)[k] = d[k].force + d[k].mass * a[k];
}

// Mean forces (n) over a step of h with mobility w (n x n, 1/kg, row-major): velocities end at free - h w F.
template <class Dampers, class Numbers>
void SolveStep(double h, const Dampers& d, const Numbers& w, Numbers* force) {
  const int n = static_cast<int>(d.size());
  if (n == 1) {
    (*force)[0] = SolveOne(h, d[0], w[0]);
    return;
  }
  bool coupled = false;
  for (int k = 0; k < n; k++) {
    for (int j = 0; j < n; j++) coupled |= j != k && fabs(w[k * n + j]) > 1e-12 * fabs(w[k * n + k]);
  }
  if (!coupled) {
    for (int k = 0; k < n; k++) (*force)[k] = SolveOne(h, d[k], w[k * n + k]);
    return;
  }
  const auto difference = [&](int k, double v, double part, double at) {
    const double dv = 1e-6 * (fabs(v) + fabs(d[k].velocity)) + 1e-10;
    return max((d[k].trial(v + dv, part) - at) / dv, 0.0);
  };
  // The moving mass is a force of its own here: m (v1 - v0) / h.
  const auto inertia = [&](int k, double v, double* slope) {
    if (slope) *slope += d[k].mass / h;
    return d[k].mass * (v - d[k].velocity) / h;
  };
  Numbers firm(n), chord(n), q(n);
  for (int k = 0; k < n; k++) firm[k] = d[k].force;
  const bool arrived = Newton(h, d, w, [&](int k, double v, double* slope) {
    const double f = d[k].trial(v, h);
    if (slope) *slope = difference(k, v, h, f);
    return f + inertia(k, v, slope);
  }, &firm);
  // Kinks: one after the other, each exactly.
  for (int sweep = 0; !arrived && sweep < 200; sweep++) {
    double moved = 0, size = 0;
    for (int k = 0; k < n; k++) {
      double free = d[k].free;
      for (int j = 0; j < n; j++) free -= j == k ? 0 : h * w[k * n + j] * firm[j];
      const double qk = h * w[k * n + k];
      if (!(qk > 0)) continue;
      const auto residual = [&](double v) { return (v - free) / qk + d[k].trial(v, h) + inertia(k, v, nullptr); };
      const double v = SolveIncreasing(residual, free - qk * firm[k], 1 / qk, 1e-7 * fabs(firm[k]) + 1e-9);
      const double force = (free - v) / qk;
      moved = max(moved, fabs(force - firm[k]));
      size = max(size, fabs(force));
      firm[k] = force;
    }
    if (!(moved > 1e-6 * size)) break;
  }
  // How stiff each is: its slope and the chord over what all of them bring, against the mobility they share.
  Numbers slopes(n), present(n);
  for (int k = 0; k < n; k++) {
    double v = d[k].free;
    for (int j = 0; j < n; j++) v -= h * w[k * n + j] * firm[j];
    const double span = d[k].free - v, end = d[k].trial(v, h);
    chord[k] = span != 0 ? max(0.0, (d[k].trial(d[k].free, h) - end) / span) : max(0.0, d[k].slope);
    slopes[k] = LocalSlope(d[k], v, end, h, fabs(span));
    present[k] = LocalSlope(d[k], v, d[k].trial(v, 0), 0, fabs(span));
  }
  for (int k = 0; k < n; k++) {
    for (int j = 0; j < n; j++) q[k] += h * fabs(w[k * n + j]) * max(slopes[j], chord[j]);
  }
  Numbers weight(n);
  double most = 0;
  for (int k = 0; k < n; k++) {
    const Blend blend = BlendOf(q[k], d[k].bare, slopes[k], chord[k], present[k]);
    weight[k] = blend.weight;
    most = max(most, blend.firm);
  }
  Numbers smooth = firm;
  if (most < 1) {
    Newton(h, d, w, [&](int k, double v, double* slope) {
      const double f = d[k].trial(v, 0);
      if (slope) *slope = weight[k] * difference(k, v, 0, f);
      return (1 - weight[k]) * d[k].force + weight[k] * f + inertia(k, v, slope);
    }, &smooth);
  }
  // One share for all: forces that belong to one motion.
  for (int k = 0; k < n; k++) (*force)[k] = smooth[k] + most * (firm[k] - smooth[k]);
}

}  // namespace mrdamp

#endif  // MRDAMP_CORE_BALANCE_H_
