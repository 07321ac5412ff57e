// Stage `mount`: a spring and a clearance in series with the damper; the piston moves less than the rod end.
#ifndef MRDAMP_EFFECTS_MOUNT_H_
#define MRDAMP_EFFECTS_MOUNT_H_


#include "core/params.h"
#include "core/solve.h"

namespace mrdamp {

inline bool HasMountFriction(const Params& p) { return Head(p.mount_compliance_friction) > 0; }
inline bool HasMountLoss(const Params& p) { return Head(p.mount_compliance_loss) > 0; }
inline bool HasMount(const Params& p) { return Head(p.mount_compliance_k) > 0 || Head(p.backlash_gap) > 0; }

// True if the mount has a state.
inline bool HasElastomer(const Params& p) { return HasMountFriction(p) || HasMountLoss(p); }

inline Real MountStiffness(const Params& p) {
  return Head(p.mount_compliance_k) > 0 ? p.mount_compliance_k : p.backlash_k;
}

// Part of a deflection d beyond `least` in either direction.
inline Real Beyond(Real least, Real d) { return Select(d > least, d - least, Select(d < -least, d + least, 0)); }

// Part of a stretch d = x - x_piston beyond the clearance.
inline Real BeyondGap(const Params& p, Real d) { return Beyond(0.5 * p.backlash_gap, d); }

// Force (N) of the mount at a stretch d: k d (1 + k3 d^2) beyond the clearance, and an additional `stiffer` k (|d| -
// stop) beyond the stop.
inline Real MountForce(const Params& p, Real d) {
  d = BeyondGap(p, d);
  const Real more = p.mount_compliance_stiffer;
  const Real stopped = Head(more) > 0 ? more * Beyond(p.mount_compliance_stop, d) : 0;
  return MountStiffness(p) * (d * (1 + p.mount_compliance_k3 * d * d) + stopped);
}

// For a uniform path over some time: what a relaxing spring retains of its stretch, and of the path.
struct Easing {
  Real keep = 1, take = 1;
};

// The same for the mount's second spring over dt (s).
inline Easing Ease(const Params& p, double dt) {
  if (!HasMountLoss(p)) return {};
  const Real part = dt / p.mount_compliance_time;
  return {exp(-part), Select(part > 0, -expm1(-part) / part, 1)};
}

// Friction inside the mount relative to its largest value, held' = (d' - abs(d') held) / slide (Dahl 1968; parallel
// to the spring, as in rubber by Berg, Vehicle System Dynamics 30 (1998)): a function of the stretch's path alone. A
// second parallel spring relaxes, eased' = d' - eased / time (Zener 1948, the standard linear solid): rubber is
// stiffer for fast motions than for slow ones.
struct Elastomer {
  Real stretch = 0;  // m, beyond the clearance
  Real held = 0;     // -1 to 1
  Real eased = 0;    // m, of the second spring

  Real Eased(const Params& p, Real d, const Easing& over) const {
    return over.keep * eased + over.take * (BeyondGap(p, d) - stretch);
  }

  Real Held(const Params& p, Real d) const {
    const Real path = BeyondGap(p, d) - stretch;
    const Real end = Select(path > 0, 1, -1);
    return Select(path == 0, held, end + (held - end) * exp(-fabs(path) / p.mount_compliance_slide));
  }
  void Follow(const Params& p, Real d, const Easing& over) {
    if (HasMountFriction(p)) held = Held(p, d);
    if (HasMountLoss(p)) eased = Eased(p, d, over);
    stretch = BeyondGap(p, d);
  }
  // Force (N) of spring and friction at a stretch, with the terms of its slope; both need one exponential.
  struct View {
    Real beyond, held, force;
  };
  View Look(const Params& p, Real d, const Easing& over = {}) const {
    Real spring = MountForce(p, d);
    if (HasMountLoss(p)) spring += MountStiffness(p) * p.mount_compliance_loss * Eased(p, d, over);
    if (!HasMountFriction(p)) return {BeyondGap(p, d), held, spring};
    const Real share = Held(p, d);
    return {BeyondGap(p, d), share, spring + p.mount_compliance_friction * share};
  }
  // The slope (N/m) there (within the clearance that at its ends); for friction in the direction of `aside` (m).
  Real Slope(const Params& p, const View& at, Real aside, const Easing& over = {}) const {
    const Real stopped = Select(fabs(at.beyond) > p.mount_compliance_stop, p.mount_compliance_stiffer, 0);
    const Real grown = 1 + 3 * p.mount_compliance_k3 * at.beyond * at.beyond + stopped;
    const Real spring = MountStiffness(p) * (grown + p.mount_compliance_loss * over.take);
    if (!HasMountFriction(p)) return spring;
    const Real end = Select(at.beyond + aside < stretch, -1, 1);
    return spring + p.mount_compliance_friction / p.mount_compliance_slide * (1 - end * at.held);
  }
  Real Force(const Params& p, Real d) const { return Look(p, d).force; }
  Real Slope(const Params& p, Real d) const { return Slope(p, Look(p, d), 0); }
};

// The stretch at which the friction inside the mount last turned or rests.
inline Real Turn(const Params& p, const Elastomer& elastomer) {
  const Real half = 0.5 * p.backlash_gap;
  return Select(elastomer.stretch > 0, elastomer.stretch + half, Select(elastomer.stretch < 0, elastomer.stretch - half, 0));
}

// A damper before a balance: its force (N), the same minus the mount's, its slope (N s/m) with its velocity.
struct Pushed {
  Real force, sum, slope;
};

// Increase (m/s) of the piston's velocity that balances damper and mount; h (s) of it reduces the stretch whose force
// is in `view`. The mount is cheap to evaluate and strongly curved at the ends of its clearance, where its friction
// turns.
inline Real MountBalance(const Params& p, const Elastomer& elastomer, const Easing& over, const Elastomer::View& view,
                           Real stretch, double h, const Pushed& damper, Real tolerance, Mask here) {
  Elastomer::View seen = view;
  const auto both = [&](Real move, Mask here) {
    const Elastomer::View at = elastomer.Look(p, stretch - h * move, over);
    seen = {Select(here, at.beyond, seen.beyond), Select(here, at.held, seen.held), Select(here, at.force, seen.force)};
    return damper.force + damper.slope * move - at.force;
  };
  // A forward move reduces the stretch.
  const auto rise = [&](Real aside) { return damper.slope + h * elastomer.Slope(p, seen, -h * aside, over); };
  if (!HasMountFriction(p)) return SolveIncreasing(both, 0, rise(0), tolerance, here);
  const Real move = FrictionBalance(both, rise, damper.sum, (stretch - Turn(p, elastomer)) / h,
                                    1e-3 * p.mount_compliance_slide / h, tolerance, here);
  const Mask lost = here && !isfinite(move);
  if (!Any(lost)) return move;
  seen = view;
  return Select(lost, SolveIncreasing(both, 0, rise(0), tolerance, lost), move);
}

}  // namespace mrdamp

#endif  // MRDAMP_EFFECTS_MOUNT_H_
