// Root of an increasing scalar function by secant steps within a bracket. A part that is cheap to evaluate and
// strongly curved is solved for in every step.
#ifndef MRDAMP_CORE_SOLVE_H_
#define MRDAMP_CORE_SOLVE_H_

#include <cmath>

namespace mrdamp {

// slow(x) + quick(x) increasing, `tolerance` on the sum; *slope: a positive estimate of slow', then the last secant.
// step(x, y, sum, slope): root of y + slope (x' - x) + quick(x'), as x' - x; y of slow alone, sum of both. A jump
// through zero (dry friction) ends at the jump. The number of calls of slow is bounded.
template <class Slow, class Quick, class Step>
double SolveSum(Slow&& slow, Quick&& quick, Step&& step, double x, double* slope, double tolerance) {
  double lo = 0, hi = 0;
  bool has_lo = false, has_hi = false;
  double part = slow(x), y = part + quick(x), x_old = x, part_old = part, y_old = y;
  for (int i = 0; i < 80; i++) {
    if (!(std::fabs(y) > tolerance)) return x;
    if (y < 0) {
      lo = x;
      has_lo = true;
    } else {
      hi = x;
      has_hi = true;
    }
    if (i > 0 && x != x_old) {
      const double secant = (part - part_old) / (x - x_old);
      if (secant > 0) *slope = secant;
    }
    const double move = step(x, part, y, *slope);
    double next = x + move;
    if (has_lo && has_hi) {
      const double width = hi - lo;
      if (!(width > 1e-15 * (std::fabs(lo) + std::fabs(hi)))) return 0.5 * (lo + hi);
      // Every third step bisects the bracket, so that a kink cannot stall the secant; the first only if it does.
      const bool halve = i == 2 ? !(std::fabs(y) < 0.1 * std::fabs(y_old)) : i % 3 == 2;
      if (halve || !(next > lo && next < hi)) next = lo + 0.5 * width;
    } else if (i > 2) {
      next = x + 4 * move;  // no bracket yet: the estimated slope was too large
    }
    x_old = x;
    part_old = part;
    y_old = y;
    x = next;
    part = slow(x);
    y = part + quick(x);
  }
  return x;
}

// f(x) increasing, `slope` a positive estimate of f', `tolerance` on |f|; as above.
template <class F>
double SolveIncreasing(F&& f, double x, double slope, double tolerance) {
  const auto nothing = [](double) { return 0.0; };
  const auto along = [](double, double, double y, double rise) { return -y / rise; };
  return SolveSum(f, nothing, along, x, &slope, tolerance);
}

// Root of the increasing f, y0 at 0, which is steepest at `turn` and flattens to both sides of it, as friction does:
// Newton's steps from there do not overshoot. rise(aside): slope where f was last evaluated, or first before it, at
// the distance at which a slope at a turn is taken. NaN if they do not converge.
template <class F, class Slope>
double FrictionBalance(F&& f, Slope&& rise, double y0, double turn, double aside, double tolerance) {
  const double first = rise(0.0), toward = rise(y0 < 0 ? aside : -aside);
  double at = -y0 / first, y = f(at);
  if (std::fabs(y) <= tolerance) return at;
  at = 0;
  y = y0;
  bool anew = true;  // f was last evaluated elsewhere
  if (turn * y0 < 0) {
    y = f(at = turn);
    anew = false;
  }
  for (int i = 0; i < 30; i++) {
    if (std::fabs(y) <= tolerance) return at;
    at -= y / (anew ? toward : rise(y < 0 ? aside : -aside));
    y = f(at);
    anew = false;
  }
  return std::nan("");
}

}  // namespace mrdamp

#endif  // MRDAMP_CORE_SOLVE_H_
