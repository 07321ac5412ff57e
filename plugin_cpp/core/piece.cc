// A piece of piston or rod motion through fluid, mechanics and mount; in series parts are solved together.
#include "core/piece.h"

#include <algorithm>

#include "core/forces.h"
#include "core/solve.h"
#include "effects/mechanics.h"
#include "effects/mount.h"
#include "laws/hysteresis.h"

namespace mrdamp {

namespace {

// The fluid over a piece of its motion; field0 and field1 at its ends. near: where the law's own solve for its state r
// begins.
void FluidPiece(const Damper& d, State* s, const Piece& m, Real field0, Real field1, Real near) {
  ChainState& c = s->c;
  const Params& p = d.p;
  const Real path = m.path(), mean = 0.5 * (m.va + m.vb);
  const auto rest = [&](Real field, Real x, Real v) {
    return PlateRest(p, Head(p.asymmetry_force) > 0 ? ForceOfLaw(d, *s, field, x, v).fluid : 0, Either(m.pace.turned, v));
  };
  const Real plate = HasTimedPlate(p) ? rest(field0, m.x, m.va) : 0;
  if (d.law == Law::kNarx) {
    const double time = Head(c.time), end = time + m.dt, sample = d.net->sample_time;
    for (double k = s->past->count + 1; k * sample <= end + 1e-9 * sample; k += 1) {
      const double t = min(k * sample - time, m.dt), w = t / m.dt;
      const double v = Head(m.va + (m.vb - m.va) * w);
      Narx::Push(*d.net, s->past, Head(m.x + 0.5 * (m.va + v) * t), v, Head(field0 + (field1 - field0) * w));
    }
  } else {
    // Where a step solves for the rate at its end, the coefficients are those of the end.
    const bool end = Is(d.law).inner;
    const Coefficients k = Evaluate(p, d.law, FluidAt(d, c, end ? field1 : 0.5 * (field0 + field1)), end ? m.vb : mean, m.pace.turned);
    OfLaw(d.law, [&](auto law) { law.Step(p, k, &c.z, &c.r, {m.x, m.va, m.vb, m.dt, near}); });
  }
  c.time += m.dt;
  if (Head(p.asymmetry_travel) > 0) c.plate = FollowPlate(p, c.plate, path);
  if (HasTimedPlate(p)) c.plate = Lag(c.plate, plate, rest(field1, m.x + path, m.vb), p.asymmetry_time, m.dt);
  if (HasTrappedGas(p)) c.stroke.Follow(m.x + path, p, m.dt);
  if (Head(p.heating_kappa) != 0 || Head(p.heating_kappa_yield) != 0) {
    Real slope, spring;
    const Real fluid = FluidForce(d, *s, field1, m.x + path, m.vb, &slope, &spring, m.pace);
    const Rise rise = Heat(p, {c.heat, c.body}, fabs(fluid * m.vb), m.dt);
    c.heat = rise.fluid;
    c.body = rise.body;
  }
}

// The three-stage SDIRK of third order (Alexander 1977, doi:10.1137/0714068) steps what is in series: each stage is an
// implicit Euler step of kGamma dt. Rows: the weights of the stages before; kNode: times of the stages.
constexpr int kStages = 3;
constexpr double kGamma = 0.43586652150845967;
constexpr double kNode[kStages] = {kGamma, 0.5 * (1 + kGamma), 1};
constexpr double kWeight[kStages][2] = {
    {0, 0}, {0.5 * (1 - kGamma), 0}, {-0.25 * (6 * kGamma * kGamma - 16 * kGamma + 1), 0.25 * (6 * kGamma * kGamma - 20 * kGamma + 5)}};

// A value whose rates are those of the stages: without the implicit part of the stage k.
Real Known(Real start, const Real* rate, int k, double dt) {
  for (int j = 0; j < k; j++) start += dt * kWeight[k][j] * rate[j];
  return start;
}

// The error of a stiffness' force in a step whose rates bend by `off`: against the rule of second order. What stands against
// the stiffness takes most of it back at once where it is soft (slope: N s/m): an implicit Euler step of the error.
// Source: Hairer & Wanner (1996), Solving Ordinary Differential Equations II, eq. IV.8.20.
Real Doubt(Real off, double dt, Real stiffness, Real slope) {
  const double step = kGamma * dt;
  return stiffness * step * fabs(off) / (1 + stiffness * step / fmax(slope, 1e-9));
}

Real Bend(const Real* rate) { return rate[0] - 2 * rate[1] + rate[2]; }

// A stage of that: dt from the last one to this one, h the implicit part of it, `gas` the pocket's stretch without that.
struct Stage {
  double dt, h;
  Real gas;
  Pace pace;
};

// The fluid behind a pocket of gas over a stage of piston motion that ends at x with velocity v: where the gas carries
// the fluid's force. Solved for the rate at which it is pressed together.
void PocketStage(const Damper& d, State* s, Real x, Real v, const Stage& g, Real from, Real to, Mask here) {
  const Params& p = d.p;
  const ChainState start = s->c;
  NarxHistory past;
  if (s->past) past = *s->past;
  const Real share = PocketShare(p, Either(g.pace.turned, v));
  Real tried = 0, wanted = 0, left = 0, own = 0;
  const auto residual = [&](Real rate, Mask here) {
    const Held held(s, here);
    const Real near = s->c.r;
    s->c = start;
    if (s->past) *s->past = past;
    GasPocket& gas = s->c.gas;
    gas.rate = rate;
    tried = Select(here, rate, tried);
    gas.flow = v - share * rate;
    const Piece piece{0, start.gas.flow, gas.flow, g.dt};
    FluidPiece(d, s, {x - piece.path(), piece.va, piece.vb, g.dt, g.pace}, from, to, near);
    Real spring, slope;
    const Real lead = PocketStretch(p, FluidForce(d, *s, to, x, gas.flow, &slope, &spring, g.pace));
    const Real off = g.gas + g.h * rate - lead;
    own = Select(here, slope, own);
    wanted = Select(here, lead, wanted);
    left = Select(here, off, left);
    return off;
  };
  const Real tolerance = 1e-7 * fmax(p.trapped_gas_s_g - fabs(start.gas.stretch), 1e-6 * p.trapped_gas_s_g);
  const Real slope = g.h + share * PocketGive(p, start.gas.stretch) * start.gas.slope;
  const Real rate = SolveIncreasing(residual, start.gas.rate, slope, tolerance, here);
  const Mask anew = here && rate != tried;
  if (Any(anew)) residual(rate, anew);
  // To its stop exactly; where the fluid's force jumps, by the motion.
  s->c.gas.stretch = Select(fabs(left) > tolerance, g.gas + g.h * rate, wanted);
  s->c.gas.slope = own;
}

void FollowMechanics(const Params& p, ChainState* c, const Piece& m) {
  c->mechanics.Follow(p, m.path(), Either(m.pace.slip, 0.5 * (m.va + m.vb)));
}

// True if friction falls with the velocity behind a mount: a jump of the damper's force may then make it slip.
bool MaySlip(const Params& p) { return HasSeal(p) && Head(p.seal_friction_breakaway) > 1 && !(Head(PistonMass(p)) > 0); }

// Fluid and mechanics over a piece of piston motion.
void Through(const Damper& d, State* s, const Piece& m, Real field0, Real field1, Real near) {
  FluidPiece(d, s, m, field0, field1, near);
  FollowMechanics(d.p, &s->c, m);
}

// A measure of a damper's force (N) at a velocity.
Real Size(const Damper& d, const ChainState& c, Real field, Real v) {
  if (d.law == Law::kNarx) return d.net->force_scale;
  const Coefficients k = Evaluate(d.p, d.law, FluidAt(d, c, field), 0);
  const Real yield = k.yield * (Is(d.law).hysteresis ? Root(d.p.A / (k.beta + k.gamma), d.p.n) : 1);
  return fmax(yield + d.p.seal_friction_coulomb, k.c0 * fabs(v)) + 1e-6;
}

// What is in series is stepped again in halves where the error of a piece is above kAllowed of the damper's force. Friction
// that falls with the velocity and rattling masses go on from an error: kStrict of that. A mass on its mount turns by kTurn
// (rad) a piece at most. Set on the draws of benchmarks/convergence.py and on mounts of five measured sets, where kAllowed
// gives a third of the largest error of two fixed pieces in 1.2 times their time.
constexpr double kAllowed = 3e-2, kStrict = 0.03, kTurn = 0.1;
constexpr int kDeepest = 7, kDeepestSlip = 10;  // halvings

// Steps over a piece, or over both halves of it where its error is above what is allowed, and so on.
template <class Step>
void Refine(const Damper& d, State* s, const Piece& m, Real field0, Real field1, int depth, Mask here, Step&& step) {
  const ChainState start = s->c;
  NarxHistory past;
  if (s->past) past = *s->past;
  const Real error = step(m, field0, field1, here);
  const double allowed = kAllowed * (MaySlip(d.p) || HasPocket(d.p) || Head(PistonMass(d.p)) > 0 ? kStrict : 1);
  here = here && error > allowed * Size(d, start, field1, fmax(fabs(m.va), fabs(m.vb)));
  if (depth == 0 || !Any(here)) return;
  const Held held(s, here);
  s->c = start;
  if (s->past) *s->past = past;
  const Real v = 0.5 * (m.va + m.vb), field = 0.5 * (field0 + field1);
  const double half = 0.5 * m.dt;
  const Piece first{m.x, m.va, v, half};
  Refine(d, s, first, field0, field, depth - 1, here, step);
  Refine(d, s, {m.x + first.path(), v, m.vb, half}, field, field1, depth - 1, here, step);
}

Real PocketPiece(const Damper& d, State* s, const Piece& m, Real field0, Real field1, Mask here) {
  const Real before = s->c.gas.stretch, rise = (m.vb - m.va) / m.dt;
  Real rate[kStages];
  double from = 0;
  for (int k = 0; k < kStages; k++) {
    const double to = kNode[k] * m.dt;
    const Real v = m.va + rise * to, field = field0 + (field1 - field0) * from / m.dt;
    const Stage stage{to - from, kGamma * m.dt, Known(before, rate, k, m.dt), {v, kUnset}};
    PocketStage(d, s, m.x + (m.va + 0.5 * rise * to) * to, v, stage, field, field0 + (field1 - field0) * kNode[k], here);
    rate[k] = s->c.gas.rate;
    from = to;
  }
  FollowMechanics(d.p, &s->c, m);
  return Doubt(Bend(rate), m.dt, 1 / PocketGive(d.p, s->c.gas.stretch), s->c.gas.slope);
}

// The piston behind the mount over a piece of rod motion: its position by the rule above, each stage the balance of the
// damper with the mount's spring. The law is stepped from stage to stage. Returns the error, N.
Real MountPiece(const Damper& d, State* s, const Piece& m, Real field0, Real field1, Mask here) {
  const Params& p = d.p;
  const Real x0 = s->c.piston, v0 = s->c.piston_velocity, gas0 = s->c.gas.stretch;
  const double h = kGamma * m.dt;
  const Real mass = PistonMass(p), rise_of_rod = (m.vb - m.va) / m.dt;
  Real velocity[kStages], acceleration[kStages], gas_rate[kStages], stiffest = 0;
  double node = 0;
  NarxHistory past;
  for (int k = 0; k < kStages; k++) {
    // Leaves in s the state at the stage, where the piston stands at base + h v with the velocity v that balances the mount.
    const ChainState start = s->c;
    if (s->past) past = *s->past;
    const double at = kNode[k] * m.dt, dt = at - node;
    const Real x_from = start.piston;
    const Real rod = m.x + (m.va + 0.5 * rise_of_rod * at) * at;
    const Real base = Known(x0, velocity, k, m.dt), base_velocity = Known(v0, acceleration, k, m.dt);
    const Real gas = Known(gas0, gas_rate, k, m.dt);
    const Real from = field0 + (field1 - field0) * node / m.dt, to = field0 + (field1 - field0) * kNode[k];
    const Easing over = Ease(p, dt);
    const Real tolerance = 1e-6 * fabs(start.elastomer.Force(p, rod - x_from)) + 1e-7;
    const Real guess = k == 0 ? v0 + kGamma * (m.vb - m.va) : 2 * velocity[k - 1] - (k == 1 ? v0 : velocity[0]);
    const Real before = start.piston_velocity;
    const Pace pace{m.va + rise_of_rod * at, Select(guess * before > 0, guess, before)};
    Real tried = guess, own = start.piston_slope;  // where the state in s stands; d(force)/dv
    const auto attempt = [&](Real v, Mask here) {
      const Held held(s, here);
      const Real near = s->c.r;
      s->c = start;
      if (s->past) *s->past = past;
      const Real x = base + h * v;
      const Piece piece{x_from, 2 * (x - x_from) / dt - v, v, dt, pace};
      if (HasPocket(p)) {
        PocketStage(d, s, x, v, {dt, h, gas, pace}, from, to, here);
        FollowMechanics(p, &s->c, piece);
      } else {
        Through(d, s, piece, from, to, near);
      }
      return x;
    };
    const auto damper = [&](Real v, Mask here) {
      const Real x = attempt(v, here);
      Real slope;
      // No secant: where the force jumps (trapped gas at a turn) that is a slope the next solve would not get away from.
      const Real force = PistonForce(d, *s, to, x, v, &slope, pace);
      own = Select(here, slope, own);
      tried = Select(here, v, tried);
      return force + mass * (v - base_velocity) / h;
    };
    Elastomer::View view{};
    const auto mount = [&](Real v, Mask here) {
      const Elastomer::View seen = start.elastomer.Look(p, rod - base - h * v, over);
      view = {Select(here, seen.beyond, view.beyond), Select(here, seen.held, view.held), Select(here, seen.force, view.force)};
      return -seen.force;
    };
    const auto balance = [&](Real v, Real force, Real sum, Real slope, Mask here) {
      return MountBalance(p, start.elastomer, over, view, rod - base - h * v, h, {force, sum, slope}, tolerance, here);
    };
    if (Any(!(own > 0))) {
      Real slope;
      PistonForce(d, *s, from, x_from, guess, &slope, pace);
      own = Select(own > 0, own, slope);
    }
    Real rise = fmax(own, 0.0) + mass / h;
    const Real v = SolveSum(damper, mount, balance, guess, &rise, tolerance, here);
    const Mask anew = here && v != tried;
    if (Any(anew)) attempt(v, anew);
    s->c.piston = base + h * v;
    s->c.piston_velocity = v;
    // A hysteresis bends within a step: the secant over it is the better guess for the next one.
    s->c.piston_slope = Is(d.law).hysteresis ? fmin(fmax(rise - mass / h, own), 1e3 * own) : own;
    stiffest = fmax(stiffest, start.elastomer.Slope(p, view, 0, over));
    if (HasElastomer(p)) s->c.elastomer.Follow(p, rod - s->c.piston, over);
    velocity[k] = v;
    acceleration[k] = (v - base_velocity) / h;
    gas_rate[k] = s->c.gas.rate;
    node = at;
  }
  const Real slope = s->c.piston_slope + mass / h;
  Real error = Doubt(Bend(velocity), m.dt, stiffest, slope);
  if (Head(mass) > 0) {
    const auto side = [&](Real stretch) { return Select(stretch > 0, 1, Select(stretch < 0, -1, 0)); };
    const Real from = BeyondGap(p, m.x - x0), to = BeyondGap(p, m.x + m.path() - s->c.piston);
    const Mask meets = p.backlash_gap > 0 && side(from) != side(to);
    const Mask rings = s->c.piston_slope * s->c.piston_slope < stiffest * mass;
    error = Select(meets || (rings && stiffest * m.dt * m.dt > kTurn * kTurn * mass), kInf, error);
  }
  if (MaySlip(p)) {
    const Real back = velocity[0] + (velocity[0] - velocity[1]) * kNode[0] / (kNode[1] - kNode[0]);
    const Real stiff = MountStiffness(p) + SealSigma(p);
    error = fmax(error, Doubt(fmax(fabs(Bend(velocity)), fabs(v0 - back)), m.dt, stiff, kInf));
  }
  return HasPocket(p) ? fmax(error, Doubt(Bend(gas_rate), m.dt, 1 / PocketGive(p, s->c.gas.stretch), s->c.gas.slope)) : error;
}

}  // namespace

Real Rest(const Damper& d, const State& s, Real x) {
  if (d.law == Law::kNarx) return x;
  State at = s;
  const auto left = [&](Real piston, Mask) {
    Real slope;
    if (Is(d.law).inner) at.c.z = piston;
    at.c.stroke.turn = at.c.stroke.extreme = at.c.stroke.last = piston;
    return PistonForce(d, at, s.c.field, piston, 0, &slope) - s.c.elastomer.Force(d.p, x - piston);
  };
  return SolveIncreasing(left, x, MountStiffness(d.p), 1e-9 * fabs(left(x, true)) + 1e-12);
}

void Release(const Damper& d, State* s, Real rod, Real field, Mask here) {
  ChainState& c = s->c;
  if (!HasMount(d.p) || !MaySlip(d.p)) return;
  const Real mount = c.elastomer.Force(d.p, rod - c.piston), tolerance = 1e-6 * fabs(mount) + 1e-7;
  Real slope;
  const auto left = [&](Real v, Mask) { return PistonForce(d, *s, field, c.piston, v, &slope, {v, c.piston_velocity}) - mount; };
  left(c.piston_velocity, here);
  c.piston_velocity = SolveIncreasing(left, c.piston_velocity, fmax(slope, 1e-3), tolerance, here);
}

void StepPiece(const Damper& d, State* s, const Piece& m, Real field0, Real field1) {
  const bool mount = HasMount(d.p);
  if (!mount && !HasPocket(d.p)) {
    Through(d, s, m, field0, field1, s->c.r);
    return;
  }
  Refine(d, s, m, field0, field1, MaySlip(d.p) ? kDeepestSlip : kDeepest, true, [&](const Piece& each, Real from, Real to, Mask here) {
    return mount ? MountPiece(d, s, each, from, to, here) : PocketPiece(d, s, each, from, to, here);
  });
}

}  // namespace mrdamp
