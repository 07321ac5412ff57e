// Bouc-Wen's z as a function of the path (Bouc 1967; Wen 1976, doi:10.1061/JMCEA3.0002106).
//
// z' = -gamma |v| z |z|^(n-1) - beta v |z|^n + A v is free of time: dz/dx = A - |z|^n (beta + gamma sgn(z dx)).
// With u = z sgn(dx) and s = |x|'s path:  du/ds = A - |u|^n (beta + gamma sgn u), solved in closed form for
// n = 1 and n = 2, so that no step is too long; other exponents take short implicit steps. An exponent within kExact of
// these two is taken as such: a fit that ends at a bound stops just beside it.
#ifndef MRDAMP_LAWS_HYSTERESIS_H_
#define MRDAMP_LAWS_HYSTERESIS_H_

#include "core/real.h"

namespace mrdamp {

constexpr double kExact = 1e-6;  // changes z by as much, relative to its largest value

inline bool Exponent(Real n, double exact) { return std::fabs(Head(n) - exact) < kExact; }

// x^n and x^(1/n) of x >= 0
inline Real Power(Real x, Real n) { return Exponent(n, 2) ? x * x : Exponent(n, 1) ? x : pow(x, n); }
inline Real Root(Real x, Real n) { return Exponent(n, 2) ? sqrt(x) : Exponent(n, 1) ? x : pow(x, 1 / n); }

// u after the path s of u' = A - B u^2, and the remaining path when u reaches zero from below (0: it does not).
inline Real FollowSquare(Real u, Real A, Real B, Real s, Real* left) {
  *left = 0;
  const Real rate = sqrt(fabs(A * B)), c = A / rate;  // c: |u| at rest (B > 0)
  const Mask brief = rate * s < 1e-12, bounded = !brief && B > 0, growing = !brief && !(B > 0);
  Real next = u + (A - B * u * u) * s;
  if (Any(bounded)) {
    const Real t = tanh(rate * s);
    next = Select(bounded, c * (u + c * t) / (c + u * t), next);
  }
  Mask over = !growing && u < 0 && next > 0;
  if (Any(over)) *left = Select(over, Select(brief, next / A, s - atanh(-u / c) / rate), 0);
  if (Any(growing)) {
    // tan(atan(w) + rate s) by the addition theorem, up to near the limit that bounds the law.
    const Real w = u / c, turn = Select(rate * s < 1.5, tan(rate * s), 0), rest = 1 - w * turn;
    const Mask sum = turn > 0 && rest > 0 && w + turn < 14 * rest && !(u < 0 && w + turn > 0);
    Real grown = c * (w + turn) / rest;
    if (Any(growing && !sum)) {
      const Real angle = atan(w) + rate * s;
      const Mask ends = growing && !sum && u < 0 && angle > 0;
      *left = Select(ends, angle / rate, *left);
      over = over || ends;
      grown = Select(sum, grown, c * tan(min(angle, 1.5)));
    }
    next = Select(growing, grown, next);
  }
  return Select(over, 0, next);
}

// Same for u' = A - B |u| (n = 1): sign is that of u on this part.
inline Real FollowLinear(Real u, Real A, Real B, Real s, Real* left) {
  *left = 0;
  const Real k = Select(u < 0, -B, B);  // u' = A - k u
  const Mask brief = fabs(k * s) < 1e-12;
  const Real next = u + (A - k * u) * Select(brief, s, -expm1(-k * s) / k);
  const Mask over = u < 0 && next > 0;
  if (!Any(over)) return next;
  const Real reach = Select(fabs(k) < 1e-300, -u / A, log1p(-u * k / A) / k);
  *left = Select(over && s > reach, s - reach, 0);
  return Select(over, 0, next);
}

// Any n: exponential Rosenbrock steps of a twelfth of the path over which u builds up, and longer ones near a stable rest:
// the error of a step goes with u'^2 and the cube of its length. The rest at u < 0 with beta > gamma is unstable.
inline Real FollowGeneral(Real u, Real A, Real beta, Real gamma, Real n, Real s) {
  const Real sum = beta + gamma;
  // Most paths are shorter than that step: n is at least 1, and the smaller of A / sum and 1 not above the root of A / sum.
  const bool brief = All(sum > 0 && s * A < 0.0799 * min(A / sum, 1.0));
  const Real reach = brief ? s : Select(sum > 0, Root(A / sum, n) / A, s);
  const Real step = brief ? s : Select(reach > 0, 0.08 * reach, s);  // A may give no such path
  Mask open = s > 0;
  for (int i = 0; i < 200 && Any(open); i++) {
    const Real k = beta + Select(u < 0, -gamma, gamma);
    const Real a = fabs(u);
    const Real power = pow(a, n - 1);
    const Real f = A - k * power * a;
    const Real slope = -k * n * power * Select(u < 0, -1, 1);
    Real ds = s;
    if (Any(open && s > step)) {
      const Real rate = fmin(fabs(f / A), 1);
      const Real most = Select(rate * s < 1e-6 * reach, s, step * pow(rate, -2.0 / 3));
      ds = fmin(s, Select(slope > 0, step, most));
    }
    const Real x = slope * ds;
    u = Select(open, u + ds * f * Select(fabs(x) < 1e-8, 1 + 0.5 * x, expm1(x) / x), u);
    s -= ds;
    open = open && s > 0;
  }
  return u;
}

// z after a monotone path dx (m, signed).
inline Real Hysteresis(Real z, Real dx, Real A, Real beta, Real gamma, Real n) {
  const Mask still = dx == 0;
  if (All(still)) return z;
  const Real sign = Select(dx > 0, 1, -1), s = fabs(dx);
  Real u = z * sign, left = 0;
  const Mask back = u < 0, far = back && Power(fabs(u), n) * (beta - gamma) > (1 - 1e-9) * A;
  // A decreasing field may leave z at or beyond the equilibrium on the far side, where the law would diverge.
  if (Any(far)) u = Select(far, -(1 - 1e-9) * Root(A / (beta - gamma), n), u);
  // A path that passes zero goes on from there with the other slope.
  const auto follow = [&](auto part) {
    u = part(u, A, beta + Select(back, -gamma, gamma), s, &left);
    Real none;
    if (Any(left > 0)) u = Select(left > 0, part(0, A, beta + gamma, left, &none), u);
  };
  if (Exponent(n, 2)) {
    follow(FollowSquare);
  } else if (Exponent(n, 1)) {
    follow(FollowLinear);
  } else {
    u = FollowGeneral(u, A, beta, gamma, n, s);
  }
  return Select(still, z, u * sign);
}

// dz/dx in the direction `sign`.
inline Real HysteresisSlope(Real z, Real sign, Real A, Real beta, Real gamma, Real n) {
  return A - Power(fabs(z), n) * (beta + Select(z * sign < 0, -gamma, gamma));
}

}  // namespace mrdamp

#endif  // MRDAMP_LAWS_HYSTERESIS_H_
