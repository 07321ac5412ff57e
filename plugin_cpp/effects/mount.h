// Stage `mount`: a spring and a clearance in series with the damper; the piston moves less than the rod end.
#ifndef MRDAMP_EFFECTS_MOUNT_H_
#define MRDAMP_EFFECTS_MOUNT_H_

#include <cmath>

#include "core/params.h"
#include "core/solve.h"

namespace mrdamp {

inline bool HasMount(const Params& p) { return p.mount_compliance_k > 0 || p.backlash_gap > 0; }

// True if the mount has a state.
inline bool HasRubber(const Params& p) { return p.mount_compliance_friction > 0 || p.mount_compliance_loss > 0; }

inline double MountStiffness(const Params& p) {
  return p.mount_compliance_k > 0 ? p.mount_compliance_k : p.backlash_k;
}

// Part of a deflection d beyond `least` in either direction.
inline double Beyond(double least, double d) { return d > least ? d - least : d < -least ? d + least : 0; }

// Part of a stretch d = x - x_piston beyond the clearance.
inline double BeyondGap(const Params& p, double d) { return Beyond(0.5 * p.backlash_gap, d); }

// Force (N) of the mount at a stretch d: k d (1 + k3 d^2) beyond the clearance, and an additional `stiffer` k (|d| -
// stop) beyond the stop.
inline double MountForce(const Params& p, double d) {
  d = BeyondGap(p, d);
  const double more = p.mount_compliance_stiffer;
  const double stopped = more > 0 ? more * Beyond(p.mount_compliance_stop, d) : 0;
  return MountStiffness(p) * (d * (1 + p.mount_compliance_k3 * d * d) + stopped);
}

// For a uniform path over some time: what a relaxing spring retains of its stretch, and of the path.
struct Easing {
  double keep = 1, take = 1;
};

// The same for the mount's second spring over dt (s).
inline Easing Ease(const Params& p, double dt) {
  if (!(p.mount_compliance_loss > 0)) return {};
  const double part = dt / p.mount_compliance_time;
  return {std::exp(-part), part > 0 ? -std::expm1(-part) / part : 1};
}

// Friction inside the mount relative to its largest value, held' = (d' - abs(d') held) / slide (Dahl 1968; parallel
// to the spring, as in rubber by Berg, Vehicle System Dynamics 30 (1998)): a function of the stretch's path alone. A
// second parallel spring relaxes, eased' = d' - eased / time (Zener 1948, the standard linear solid): rubber is
// stiffer for fast motions than for slow ones.
struct Rubber {
  double stretch = 0;  // m, beyond the clearance
  double held = 0;     // -1 to 1
  double eased = 0;    // m, of the second spring

  double Eased(const Params& p, double d, const Easing& over) const {
    return over.keep * eased + over.take * (BeyondGap(p, d) - stretch);
  }

  double Held(const Params& p, double d) const {
    const double path = BeyondGap(p, d) - stretch;
    if (path == 0) return held;
    const double end = path > 0 ? 1 : -1;
    return end + (held - end) * std::exp(-std::fabs(path) / p.mount_compliance_slide);
  }
  void Follow(const Params& p, double d, const Easing& over) {
    if (p.mount_compliance_friction > 0) held = Held(p, d);
    if (p.mount_compliance_loss > 0) eased = Eased(p, d, over);
    stretch = BeyondGap(p, d);
  }
  // Force (N) of spring and friction at a stretch, with the terms of its slope; both need one exponential.
  struct View {
    double beyond, held, force;
  };
  View Look(const Params& p, double d, const Easing& over = {}) const {
    double spring = MountForce(p, d);
    if (p.mount_compliance_loss > 0) spring += MountStiffness(p) * p.mount_compliance_loss * Eased(p, d, over);
    if (!(p.mount_compliance_friction > 0)) return {BeyondGap(p, d), held, spring};
    const double share = Held(p, d);
    return {BeyondGap(p, d), share, spring + p.mount_compliance_friction * share};
  }
  // The slope (N/m) there (within the clearance that at its ends); for friction in the direction of `aside` (m).
  double Slope(const Params& p, const View& at, double aside, const Easing& over = {}) const {
    const double stopped = std::fabs(at.beyond) > p.mount_compliance_stop ? p.mount_compliance_stiffer : 0;
    const double grown = 1 + 3 * p.mount_compliance_k3 * at.beyond * at.beyond + stopped;
    const double spring = MountStiffness(p) * (grown + p.mount_compliance_loss * over.take);
    if (!(p.mount_compliance_friction > 0)) return spring;
    const double end = at.beyond + aside < stretch ? -1 : 1;
    return spring + p.mount_compliance_friction / p.mount_compliance_slide * (1 - end * at.held);
  }
  double Force(const Params& p, double d) const { return Look(p, d).force; }
  double Slope(const Params& p, double d) const { return Slope(p, Look(p, d), 0); }
};

// The stretch at which the friction inside the mount last turned or rests.
inline double Turn(const Params& p, const Rubber& rubber) {
  const double half = 0.5 * p.backlash_gap;
  return rubber.stretch > 0 ? rubber.stretch + half : rubber.stretch < 0 ? rubber.stretch - half : 0;
}

// A damper before a balance: its force (N), the same minus the mount's, its slope (N s/m) with its velocity.
struct Pushed {
  double force, sum, slope;
};

// Increase (m/s) of the piston's velocity that balances damper and mount; h (s) of it reduces the stretch whose force
// is in `view`. The mount is cheap to evaluate and strongly curved at the ends of its clearance, where its friction
// turns.
inline double MountBalance(const Params& p, const Rubber& rubber, const Easing& over, const Rubber::View& view,
                           double stretch, double h, const Pushed& damper, double tolerance) {
  Rubber::View seen = view;
  const auto both = [&](double move) {
    seen = rubber.Look(p, stretch - h * move, over);
    return damper.force + damper.slope * move - seen.force;
  };
  // A forward move reduces the stretch.
  const auto rise = [&](double aside) { return damper.slope + h * rubber.Slope(p, seen, -h * aside, over); };
  if (p.mount_compliance_friction > 0) {
    const double move = FrictionBalance(both, rise, damper.sum, (stretch - Turn(p, rubber)) / h,
                                        1e-3 * p.mount_compliance_slide / h, tolerance);
    if (std::isfinite(move)) return move;
    seen = view;
  }
  return SolveIncreasing(both, 0, rise(0), tolerance);
}

}  // namespace mrdamp

#endif  // MRDAMP_EFFECTS_MOUNT_H_
