// Root of an increasing scalar function by secant steps within a bracket. A part that is cheap to evaluate and
// strongly curved is solved for in every step.
//
// A lane of a pack that has its root waits for the others: functions are told in which lanes they are asked (`here`), and
// leave alone what they hold of the rest.
#ifndef MRDAMP_CORE_SOLVE_H_
#define MRDAMP_CORE_SOLVE_H_

#include <type_traits>

#include "core/real.h"

namespace mrdamp {

// slow(x, here) + quick(x, here) increasing, `tolerance` on the sum; *slope: a positive estimate of slow', then the last
// secant. step(x, y, sum, slope, here): root of y + slope (x' - x) + quick(x'), as x' - x; y of slow alone, sum of both.
// A jump through zero (dry friction) ends at the jump. The number of calls of slow is bounded.
template <class Slow, class Quick, class Step>
Real SolveSum(Slow&& slow, Quick&& quick, Step&& step, Real x, Real* slope, Real tolerance, Mask here = true) {
  Real lo = -kInf, hi = kInf;
  Real part = slow(x, here), y = part + quick(x, here), x_old = x, part_old = part, y_old = y;
  for (int i = 0; i < 80; i++) {
    here = here && fabs(y) > tolerance;
    if (!Any(here)) break;
    lo = Select(here && y < 0, x, lo);
    hi = Select(here && !(y < 0), x, hi);
    if (i > 0) {
      const Real secant = (part - part_old) / (x - x_old);
      *slope = Select(here && x != x_old && secant > 0, secant, *slope);
    }
    const Real move = step(x, part, y, *slope, here), width = hi - lo, middle = lo + 0.5 * width;
    const Mask both = width < kInf, tight = both && !(width > 1e-15 * (fabs(lo) + fabs(hi)));
    // Every third step bisects the bracket, so that a kink cannot stall the secant; the first only if it does. Without a
    // bracket yet the estimated slope was too large.
    const Mask halve = i == 2 ? !(fabs(y) < 0.1 * fabs(y_old)) : Mask(i % 3 == 2);
    Real next = x + move;
    next = Select(both, Select(tight || halve || !(next > lo && next < hi), middle, next), i > 2 ? x + 4 * move : next);
    x_old = x;
    part_old = part;
    y_old = y;
    x = Select(here, next, x);
    here = here && !tight;
    if (!Any(here)) break;
    part = Select(here, slow(x, here), part);
    y = Select(here, part + quick(x, here), y);
  }
  return x;
}

// f(x, here), or f(x), increasing, `slope` a positive estimate of f', `tolerance` on |f|; as above.
template <class F>
Real SolveIncreasing(F&& f, Real x, Real slope, Real tolerance, Mask here = true) {
  const auto each = [&](Real at, Mask where) {
    if constexpr (std::is_invocable_v<F, Real, Mask>) return f(at, where);
    else return f(at);
  };
  const auto nothing = [](Real, Mask) { return Real(0); };
  const auto along = [](Real, Real, Real y, Real rise, Mask) { return -y / rise; };
  return SolveSum(each, nothing, along, x, &slope, tolerance, here);
}

// Root of the increasing f, y0 at 0, which is steepest at `turn` and flattens to both sides of it, as friction does:
// Newton's steps from there do not overshoot. rise(aside): slope where f was last evaluated, or first before it, at
// the distance at which a slope at a turn is taken. NaN if they do not converge.
template <class F, class Slope>
Real FrictionBalance(F&& f, Slope&& rise, Real y0, Real turn, Real aside, Real tolerance, Mask here = true) {
  const Real first = rise(0), toward = rise(Select(y0 < 0, aside, -aside));
  Real at = -y0 / first, y = f(at, here);
  here = here && !(fabs(y) <= tolerance);
  const Mask turns = here && turn * y0 < 0;
  at = Select(here, Select(turns, turn, 0), at);
  y = Select(here, y0, y);
  if (Any(turns)) y = Select(turns, f(at, turns), y);
  Mask anew = !turns;  // f was last evaluated elsewhere
  for (int i = 0; i < 30; i++) {
    here = here && !(fabs(y) <= tolerance);
    if (!Any(here)) return at;
    at = Select(here, at - y / Select(anew, toward, rise(Select(y < 0, aside, -aside))), at);
    y = Select(here, f(at, here), y);
    anew = anew && !here;
  }
  return Select(here, kUnset, at);
}

}  // namespace mrdamp

#endif  // MRDAMP_CORE_SOLVE_H_
