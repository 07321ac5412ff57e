// Stage `driver`: the coil current lags the command.
#ifndef MRDAMP_EFFECTS_DRIVER_H_
#define MRDAMP_EFFECTS_DRIVER_H_

#include <cmath>

#include "core/params.h"
#include "effects/oscillator.h"

namespace mrdamp {

// driver_lag: tau i' = u - i, exact for a command that is linear from u0 to u1 in dt.
inline Real Lag(Real i, Real u0, Real u1, Real tau, Real dt) {
  if (!(Head(tau) > 0)) return u1;
  const Real trail = (u1 - u0) / dt * tau;
  return u1 - trail + (i - u0 + trail) * exp(-dt / tau);
}

inline bool HasFirstPole(const Params& p) {
  return Head(p.driver_lag_tau) > 0 || Head(p.driver_lag_fall) > 0 || Head(p.driver_lag_rate) > 0;
}

inline bool HasLag(const Params& p) { return HasFirstPole(p) || Head(p.driver_lag_tau2) > 0; }

// State of driver_lag. Plain doubles.
struct Coil {
  Oscillator first;    // output of the first pole, the pair, or a controller, whose integral is then `rate`
  Real second = 0;   // output of the second pole
  Real current = 0;  // magnetising current

  void Start(const Params& p, Real u) {
    first = {u, Head(p.driver_lag_gain) > 0 ? u : 0};
    second = current = u;
  }
  // Step with a command that is linear from u0 to u1 in dt. Returns the mean of the current in it, by the integral of
  // each pole's equation.
  Real Step(const Params& p, Real u0, Real u1, double dt) {
    const Real from = HasFirstPole(p) ? first.y : u0, behind = second, tau2 = p.driver_lag_tau2;
    Real mean = 0.5 * (u0 + u1), curved = 0;  // what the first pole's path adds to the second beside a straight one
    if (Head(p.driver_lag_gain) > 0 && Head(p.driver_lag_tau) > 0) {
      mean = Control(p, &first, u0, u1, dt);
    } else if (Head(p.driver_lag_ratio) > 0 && Head(p.driver_lag_tau) > 0) {
      const Real w = 2 * p.driver_lag_ratio / p.driver_lag_tau, rate = first.rate;
      first.Step(w, p.driver_lag_ratio, u0, u1, dt);
      mean -= (p.driver_lag_tau * (first.y - from) + (first.rate - rate) / (w * w)) / dt;
    } else {
      Real tau = p.driver_lag_tau;
      first.y = Lag(from, u0, u1, tau, dt);
      if (Head(p.driver_lag_fall) > 0) {
        const Mask falls = fabs(mean) < fabs(from);
        first.y = Select(falls, Lag(from, u0, u1, p.driver_lag_fall, dt), first.y);
        tau = Select(falls, p.driver_lag_fall, tau);
      }
      const Real most = p.driver_lag_rate * dt, way = first.y - from;
      const Mask held = p.driver_lag_rate > 0 && fabs(way) > most, lags = !held && tau > 0;
      first.y = Select(held, from + copysign(most, way), first.y);
      mean = Select(held, 0.5 * (from + first.y), mean - tau * (way / dt));
      if (Head(tau2) > 0 && Any(lags)) curved = Select(lags, Curved(from - u0 + tau * (u1 - u0) / dt, tau, tau2, dt), 0);
    }
    second = Lag(second, from, first.y, tau2, dt) + curved;
    const Real share = Head(tau2) > 0 ? p.driver_lag_share : 1;
    current = Select(share < 1, first.y + share * (second - first.y), second);
    return Head(tau2) > 0 ? mean - share * tau2 * (second - behind) / dt : mean;
  }

 private:
  // A pole of tau2 behind one of tau whose transient is e exp(-t / tau): its end less that behind the transient's chord.
  static Real Curved(Real e, Real tau, Real tau2, double dt) {
    const Real a = dt / tau, b = dt / tau2, apart = b - a, decay = exp(-a);
    // (exp(-a) - exp(-b)) / (b - a)
    const Real near = Select(apart > 0, decay, exp(-b)), gap = fabs(apart);
    const Real divided = Select(gap > 0, near * (-expm1(-gap) / gap), decay);
    return e * (b * divided - Lag(0, 1, decay, tau2, dt));
  }
  // tau i' = v - i with v = gain e + I, I' = gain e / integral, e = u - i, and |v| limited; the integral is frozen at
  // the limit. Steps are short compared with the closed loop, by the midpoint rule. Returns the mean of i.
  static Real Control(const Params& p, Oscillator* c, Real u0, Real u1, double dt) {
    const Real gain = p.driver_lag_gain, tau = p.driver_lag_tau, reset = p.driver_lag_integral;
    const Real limit = Select(p.driver_lag_limit > 0, p.driver_lag_limit, kInf);
    const Real n = Each(std::ceil, 4 * dt * ((1 + gain) / tau + 1 / reset)), h = dt / n;
    Real sum = 0;
    const auto slope = [&](Real i, Real integral, Real u, Real* d_integral) {
      const Real e = u - i, asked = gain * e + integral, given = fmin(fmax(asked, -limit), limit);
      *d_integral = Select(asked != given && asked * e > 0, 0, gain * e / reset);
      return (given - i) / tau;
    };
    Mask open = n > 0;
    for (int k = 0; Any(open); k++, open = k < n) {
      Real d_integral;
      const Real at = u0 + (u1 - u0) * k / n, middle = u0 + (u1 - u0) * (k + 0.5) / n;
      const Real d = slope(c->y, c->rate, at, &d_integral);
      const Real i = c->y + 0.5 * h * d, integral = c->rate + 0.5 * h * d_integral;
      sum += Select(open, i, 0);
      c->y += Select(open, h * slope(i, integral, middle, &d_integral), 0);
      c->rate += Select(open, h * d_integral, 0);
    }
    return sum / n;
  }
};

// command_delay: u(t - d) from a store of the latest commands. Plain doubles, stored in MuJoCo's plugin state.
// Commands closer together than d / (kCapacity - 2) share a slot: the delay is then accurate to 1 %.
struct DelayLine {
  static constexpr int kCapacity = 128;
  double count = 0, head = 0;  // number of stored knots; index of the newest
  double time[kCapacity] = {};
  double value[kCapacity] = {};

  static double Spacing(double delay) { return delay / (kCapacity - 4); }

  void Push(double t, double u, double delay) {
    int h = static_cast<int>(head), n = static_cast<int>(count);
    const double spacing = Spacing(delay);
    const int before = (h + kCapacity - 1) % kCapacity;
    if (n >= 1 && t <= time[h]) {
      value[h] = u;
      return;
    }
    if (n < 2 || time[h] - time[before] >= spacing) {
      h = n == 0 ? 0 : (h + 1) % kCapacity;
      if (n < kCapacity) count = n + 1;
      head = h;
    }
    time[h] = t;
    value[h] = u;
  }

  // Command at time t; constant from knot to knot, or linear between them.
  double At(double t, bool hold) const {
    const int n = static_cast<int>(count);
    if (n == 0) return 0;
    const int k = Behind(t), j = Index(k), newer = Index(k - 1);
    if (k == 0 || k == n || hold) return value[k == n ? newer : j];
    return value[j] + (t - time[j]) / (time[newer] - time[j]) * (value[newer] - value[j]);
  }

  // The first knot after time t, infinite if there is none.
  double After(double t) const {
    const int k = count > 0 ? Behind(t) : 0;
    return k > 0 ? time[Index(k - 1)] : kInf;
  }

  // Its mean from time a to b > a.
  double Mean(double a, double b, bool hold) const {
    const int h = static_cast<int>(head), n = static_cast<int>(count);
    if (n == 0) return 0;
    double sum = b > time[h] ? (b - std::fmax(a, time[h])) * value[h] : 0;
    int k = Behind(b) > 0 ? Behind(b) : 1, newer = Index(k - 1);
    for (; k < n && time[newer] > a; k++) {
      const int j = Index(k);
      if (time[j] >= a && time[newer] <= b) {
        sum += (time[newer] - time[j]) * (hold ? value[j] : 0.5 * (value[j] + value[newer]));
      } else {
        const double from = std::fmax(a, time[j]), to = std::fmin(b, time[newer]);
        const double rise = hold ? 0 : (value[newer] - value[j]) / (time[newer] - time[j]);
        if (to > from) sum += (to - from) * (value[j] + rise * (0.5 * (from + to) - time[j]));
      }
      newer = j;
    }
    if (time[newer] > a) sum += (std::fmin(b, time[newer]) - a) * value[newer];
    return sum / (b - a);
  }

 private:
  // The k-th knot from the newest.
  int Index(int k) const { return (static_cast<int>(head) + kCapacity - k) % kCapacity; }

  // Number of knots after time t. They are nearly equidistant, so that the search is short.
  int Behind(double t) const {
    const int n = static_cast<int>(count);
    const double newest = time[Index(0)], span = newest - time[Index(n - 1)];
    if (t >= newest) return 0;
    if (t < newest - span) return n;
    int k = static_cast<int>((newest - t) / span * (n - 1));
    while (k < n && time[Index(k)] > t) k++;
    while (time[Index(k - 1)] <= t) k--;
    return k;
  }
};

// s: delays are uniformly distributed from d - spread to d + spread.
inline double Spread(const Params& p) { return Head(p.command_delay_spread) * Head(p.command_delay_d); }

// Length of the store.
inline double Reach(const Params& p) { return Head(p.command_delay_d) + Spread(p) + Head(p.command_delay_period); }

inline bool HasDelay(const Params& p) { return Reach(p) > 0; }

// True if what arrives changes in jumps: a held command, or one that a clock samples.
inline bool Jumps(const Params& p, bool hold) { return Head(p.command_delay_period) > 0 || (hold && !(Spread(p) > 0)); }

// Times that are sums of steps differ from those of a clock by rounding: in an hour of steps of 1 ms by up to this.
constexpr double kSame = 1e-6;  // s

// Number of the clock's last tick at or before the time t after which a delay has passed.
inline double Tick(const Params& p, double t) { return std::floor((t - Head(p.command_delay_d)) / Head(p.command_delay_period) - Head(p.command_delay_phase)); }

// Command that has arrived at time t. Jumps at t count as past, so that rounding cannot undo them.
inline double Arrived(const DelayLine& line, const Params& p, double t, bool hold) {
  if (Head(p.command_delay_period) > 0) {
    return line.At((Tick(p, t + kSame) + Head(p.command_delay_phase)) * Head(p.command_delay_period) + kSame, hold);
  }
  const double spread = Spread(p), sent = t - Head(p.command_delay_d);
  return spread > 0 ? line.Mean(sent - spread, sent + spread, hold) : line.At(hold ? sent + kSame : sent, hold);
}

// Time of the first jump of what arrives after t.
inline double NextJump(const DelayLine& line, const Params& p, double t) {
  t += kSame;
  const double delay = Head(p.command_delay_d), period = Head(p.command_delay_period);
  return delay + (period > 0 ? (Tick(p, t) + 1 + Head(p.command_delay_phase)) * period : line.After(t - delay));
}

}  // namespace mrdamp

#endif  // MRDAMP_EFFECTS_DRIVER_H_
