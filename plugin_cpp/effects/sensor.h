// Stage `sensor`: from a true signal (force, or a floor's acceleration) to its reading.
#ifndef MRDAMP_EFFECTS_SENSOR_H_
#define MRDAMP_EFFECTS_SENSOR_H_

#include <cmath>

#include "effects/driver.h"

namespace mrdamp {

struct SensorParams {
  double gain = 1, offset = 0;
  double leakage = 0;        // s, high-pass of the charge; 0: none
  double lag = 0, lag2 = 0;  // s, low-pass; 0: none

  static SensorParams Of(const Params& p) {
    return {p.sensor_gain_g, p.sensor_offset_f, p.sensor_leakage_tau, p.sensor_lag_tau, p.sensor_lag_tau2};
  }
};

// gain -> leakage (y' = F' - y / tau) -> lag -> offset; exact for a signal that runs straight between samples.
struct Sensor {
  double in = 0;       // last true signal
  double charge = 0;   // behind the leakage
  double first = 0, second = 0;

  void Start(const SensorParams& p, double f) {
    in = f;
    charge = first = second = p.gain * f;
  }
  void Step(const SensorParams& p, double f, double dt) {
    double from = charge;
    if (!(p.leakage > 0)) {
      charge = p.gain * f;
    } else if (dt > 0) {
      const double decay = std::exp(-dt / p.leakage);
      charge = charge * decay + p.gain * (f - in) / dt * p.leakage * (1 - decay);
    }
    in = f;
    double to = first;
    first = dt > 0 ? Lag(first, from, charge, p.lag, dt) : (p.lag > 0 ? first : charge);
    second = dt > 0 ? Lag(second, to, first, p.lag2, dt) : (p.lag2 > 0 ? second : first);
  }
  double Read(const SensorParams& p) const { return second + p.offset; }
};

}  // namespace mrdamp

#endif  // MRDAMP_EFFECTS_SENSOR_H_
