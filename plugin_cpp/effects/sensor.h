// Stage `sensor`: from a true signal (force, or a floor's acceleration) to its reading.
#ifndef MRDAMP_EFFECTS_SENSOR_H_
#define MRDAMP_EFFECTS_SENSOR_H_


#include "effects/driver.h"
#include "effects/oscillator.h"

namespace mrdamp {

struct SensorParams {
  Real gain = 1, offset = 0;
  Real leakage = 0;        // s, high-pass of the charge; 0: none
  Real lag = 0, lag2 = 0;  // s, low-pass; 0: none
  Real share = 0, leakage2 = 0;  // share of the charge with another time constant, and that (s; 0: no leakage)
  Real ratio = 0;                // damping of a second-order low-pass in place of the first pole; 0: first order
  Real settle = 0, settle_time = 1;  // additional offset that decays from the start, and its time constant, s

  static SensorParams Of(const Params& p) {
    return {p.sensor_gain_g, p.sensor_offset_f, p.sensor_leakage_tau, p.sensor_lag_tau, p.sensor_lag_tau2,
            p.sensor_leakage_share, p.sensor_leakage_tau2, p.sensor_lag_ratio, p.sensor_offset_settle, p.sensor_offset_time};
  }
};

// gain -> leakage (y' = F' - y / tau) -> lag -> offset; exact for a signal that is linear between samples.
struct Sensor {
  Real in = 0;       // last true signal
  Real charge = 0;   // after the leakage
  Real charge2 = 0;  // the same of the part with the other time constant
  Real first = 0, second = 0;
  Real unsettled = 1;  // remaining share of the decaying offset
  Oscillator filter;

  void Start(const SensorParams& p, Real f) {
    in = f;
    charge = charge2 = first = second = filter.y = p.gain * f;
    filter.rate = 0;
    unsettled = 1;
  }
  // dt 0: the signal jumps.
  void Step(const SensorParams& p, Real f, double dt) {
    const Real from = Charge(p);
    charge = Leak(charge, p.leakage, p, f, dt);
    if (Head(p.share) > 0) charge2 = Leak(charge2, p.leakage2, p, f, dt);
    in = f;
    if (Head(p.settle) != 0) unsettled *= exp(-dt / p.settle_time);
    const Real now = Charge(p);
    if (Head(p.ratio) > 0 && Head(p.lag) > 0) {
      const Real to = filter.y;
      if (dt > 0) filter.Step(2 * p.ratio / p.lag, p.ratio, from, now, dt);
      second = dt > 0 ? Lag(second, to, filter.y, p.lag2, dt) : (Head(p.lag2) > 0 ? second : filter.y);
      return;
    }
    const Real to = first;
    first = dt > 0 ? Lag(first, from, now, p.lag, dt) : (Head(p.lag) > 0 ? first : now);
    second = dt > 0 ? Lag(second, to, first, p.lag2, dt) : (Head(p.lag2) > 0 ? second : first);
  }
  Real Read(const SensorParams& p) const { return second + p.offset + p.settle * unsettled; }

 private:
  Real Charge(const SensorParams& p) const { return Head(p.share) > 0 ? charge + p.share * (charge2 - charge) : charge; }
  Real Leak(Real q, Real tau, const SensorParams& p, Real f, double dt) const {
    if (!(Head(tau) > 0)) return p.gain * f;
    if (!(dt > 0)) return q + p.gain * (f - in);
    const Real decay = exp(-dt / tau);
    return q * decay + p.gain * (f - in) / dt * tau * (1 - decay);
  }
};

}  // namespace mrdamp

#endif  // MRDAMP_EFFECTS_SENSOR_H_
