#include <cstdio>

#include "core/chain.h"

namespace mrdamp {

bool Check(const Damper& d, char* error, int error_size) {
  const double* value = d.p.data();
  for (int i = 0; i < kParamCount; i++) {
    const Attribute& a = kAttributes[i];
    const double v = value[i];
    const bool unset = std::isnan(a.def) && std::isnan(v);
    if (unset) continue;
    if (!std::isfinite(v)) {
      std::snprintf(error, error_size, "%s = %g is not a finite number", a.name, v);
      return false;
    }
    if (v < a.min || v > a.max) {
      std::snprintf(error, error_size, "%s = %.9g is outside [%g, %g] %s", a.name, v, a.min, a.max, a.unit);
      return false;
    }
  }
  const Params& p = d.p;
  if (p.command_min > p.command_max) {
    std::snprintf(error, error_size, "command_min = %g is above command_max = %g", p.command_min, p.command_max);
    return false;
  }
  if (p.command_delay_period > 0 && p.command_delay_period < 1e-5) {
    std::snprintf(error, error_size, "command_delay_period = %g s; allowed: 0, or from 1e-05", p.command_delay_period);
    return false;
  }
  if (p.driver_lag_ratio > 0 && (p.driver_lag_fall > 0 || p.driver_lag_rate > 0)) {
    std::snprintf(error, error_size, "driver_lag_ratio with %s; a pair of poles has neither a fall nor a rate of its own",
                  p.driver_lag_fall > 0 ? "driver_lag_fall" : "driver_lag_rate");
    return false;
  }
  if (p.driver_lag_gain > 0 && (p.driver_lag_ratio > 0 || p.driver_lag_fall > 0 || p.driver_lag_rate > 0)) {
    std::snprintf(error, error_size, "driver_lag_gain with %s; a controller has a lag and a limit of its own",
                  p.driver_lag_ratio > 0  ? "driver_lag_ratio"
                  : p.driver_lag_fall > 0 ? "driver_lag_fall"
                                          : "driver_lag_rate");
    return false;
  }
  if (p.driver_lag_gain > 0 && !(p.driver_lag_tau > 0)) {
    std::snprintf(error, error_size, "driver_lag_gain without driver_lag_tau; the coil's time constant must be above 0");
    return false;
  }
  if (p.driver_lag_gain > 0 && p.driver_lag_tau < 1e-5 * (1 + p.driver_lag_gain)) {
    std::snprintf(error, error_size, "driver_lag_gain = %g makes the loop as fast as %g s; allowed: from 1e-05 s",
                  p.driver_lag_gain, p.driver_lag_tau / (1 + p.driver_lag_gain));
    return false;
  }
  if (!OfLaw(d.law, [&](auto law) { return law.Check(p, error, error_size); })) return false;
  if (d.law == Law::kNarx && (p.asymmetry_yield != 0 || p.asymmetry_viscous != 0)) {
    std::snprintf(error, error_size, "%s: a narx law has no part of its own to act on; use asymmetry_a",
                  p.asymmetry_yield != 0 ? "asymmetry_yield" : "asymmetry_viscous");
    return false;
  }
  if (d.law == Law::kNarx && (p.shear_thinning_m != 1 || p.heating_kappa != 0)) {
    std::snprintf(error, error_size, "%s: a narx law has no viscous coefficient to act on; use heating_kappa_yield for heat",
                  p.heating_kappa != 0 ? "heating_kappa" : "shear_thinning_m");
    return false;
  }
  if (p.trapped_gas_time > 0 && p.trapped_gas_direction == 0) {
    std::snprintf(error, error_size, "trapped_gas_time = %g needs a trapped_gas_direction: the pocket is of one side", p.trapped_gas_time);
    return false;
  }
  if (d.law == Law::kNarx && !d.net) {
    std::snprintf(error, error_size, "law narx needs `weights`: a file, or text:NAME of a <custom><text>");
    return false;
  }
  return true;
}

}  // namespace mrdamp
