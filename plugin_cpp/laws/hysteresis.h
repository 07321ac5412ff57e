// Bouc-Wen's z as a function of the path (Bouc 1967; Wen 1976, doi:10.1061/JMCEA3.0002106).
//
// z' = -gamma |v| z |z|^(n-1) - beta v |z|^n + A v is free of time: dz/dx = A - |z|^n (beta + gamma sgn(z dx)).
// With u = z sgn(dx) and s = |x|'s path:  du/ds = A - |u|^n (beta + gamma sgn u), solved in closed form for
// n = 1 and n = 2, so that no step is too long; other exponents take short implicit steps. An exponent within kExact of
// these two is taken as such: a fit that ends at a bound stops just beside it.
#ifndef MRDAMP_LAWS_HYSTERESIS_H_
#define MRDAMP_LAWS_HYSTERESIS_H_

#include <algorithm>
#include <cmath>

#include "core/tanh.h"

namespace mrdamp {

constexpr double kExact = 1e-6;  // changes z by as much, relative to its largest value

inline bool Exponent(double n, double exact) { return std::fabs(n - exact) < kExact; }

// u after the path s of u' = A - B u^2, and the remaining path when u reaches zero from below (0: it does not).
inline double Square(double u, double A, double B, double s, double* left) {
  *left = 0;
  const double rate = std::sqrt(std::fabs(A * B));
  if (rate * s < 1e-12) {
    const double next = u + (A - B * u * u) * s;
    if (u < 0 && next > 0) *left = next / A;
    return u < 0 && next > 0 ? 0 : next;
  }
  const double c = std::sqrt(std::fabs(A / B));  // |u| at rest (B > 0)
  if (B > 0) {
    const double t = Tanh(rate * s);
    const double next = c * (u + c * t) / (c + u * t);
    if (u >= 0 || next <= 0) return next;
    *left = s - std::atanh(-u / c) / rate;
    return 0;
  }
  // tan(atan(w) + rate s) by the addition theorem, up to near the limit that bounds the law.
  const double w = u / c, turn = rate * s < 1.5 ? std::tan(rate * s) : 0, over = 1 - w * turn;
  if (turn > 0 && over > 0 && w + turn < 14 * over && !(u < 0 && w + turn > 0)) return c * (w + turn) / over;
  const double angle = std::atan(w) + rate * s;
  if (u < 0 && angle > 0) {
    *left = angle / rate;
    return 0;
  }
  return angle > 1.5 ? c * std::tan(1.5) : c * std::tan(angle);
}

// Same for u' = A - B |u| (n = 1): sign is that of u on this part.
inline double Linear(double u, double A, double B, double s, double* left) {
  *left = 0;
  const double k = u < 0 ? -B : B;  // u' = A - k u
  const double next = std::fabs(k * s) < 1e-12 ? u + (A - k * u) * s : u + (A - k * u) * (-std::expm1(-k * s)) / k;
  if (u < 0 && next > 0) {
    const double reach = std::fabs(k) < 1e-300 ? -u / A : std::log1p(-u * k / A) / k;
    *left = s > reach ? s - reach : 0;
    return 0;
  }
  return next;
}

// Any n: exponential Rosenbrock steps of a twelfth of the path over which u builds up, and longer ones near a stable rest:
// the error of a step goes with u'^2 and the cube of its length. The rest at u < 0 with beta > gamma is unstable.
inline double General(double u, double A, double beta, double gamma, double n, double s) {
  const double sum = beta + gamma;
  const double reach = sum > 0 ? std::pow(A / sum, 1 / n) / A : s;
  const double step = reach > 0 ? 0.08 * reach : s;  // A may give no such path
  for (int i = 0; i < 200 && s > 0; i++) {
    const double k = beta + (u < 0 ? -gamma : gamma);
    const double a = std::fabs(u);
    const double power = std::pow(a, n - 1);
    const double f = A - k * power * a;
    const double slope = -k * n * power * (u < 0 ? -1 : 1);
    const double rate = std::fmin(std::fabs(f / A), 1);
    const double most = rate * s < 1e-6 * reach ? s : step / std::cbrt(rate * rate);
    const double ds = std::fmin(s, slope > 0 ? step : most);
    const double x = slope * ds;
    u += ds * f * (std::fabs(x) < 1e-8 ? 1 + 0.5 * x : std::expm1(x) / x);
    s -= ds;
  }
  return u;
}

// z after a monotone path dx (m, signed).
inline double Hysteresis(double z, double dx, double A, double beta, double gamma, double n) {
  if (dx == 0) return z;
  const double sign = dx > 0 ? 1 : -1;
  double s = std::fabs(dx), u = z * sign, left = 0;
  if (u < 0 && beta > gamma) {
    // A decreasing field may leave z beyond the equilibrium on the far side, where the law would diverge.
    const double far = std::pow(A / (beta - gamma), 1 / n) * (1 - 1e-9);
    if (u < -far) u = -far;
  }
  if (Exponent(n, 2)) {
    if (u < 0) {
      u = Square(u, A, beta - gamma, s, &left);
      if (left > 0) u = Square(0, A, beta + gamma, left, &left);
    } else {
      u = Square(u, A, beta + gamma, s, &left);
    }
  } else if (Exponent(n, 1)) {
    if (u < 0) {
      u = Linear(u, A, beta - gamma, s, &left);
      if (left > 0) u = Linear(0, A, beta + gamma, left, &left);
    } else {
      u = Linear(u, A, beta + gamma, s, &left);
    }
  } else {
    u = General(u, A, beta, gamma, n, s);
  }
  return u * sign;
}

// dz/dx in the direction `sign`.
inline double HysteresisSlope(double z, double sign, double A, double beta, double gamma, double n) {
  const double k = beta + (z * sign < 0 ? -gamma : gamma);
  if (n == 2) return A - z * z * k;
  const double a = std::fabs(z);
  return A - k * (n == 1 ? a : std::pow(a, n));
}

}  // namespace mrdamp

#endif  // MRDAMP_LAWS_HYSTERESIS_H_
