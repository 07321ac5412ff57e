#include "core/chain.h"

#include <algorithm>
#include <cmath>

#include "core/forces.h"
#include "core/solve.h"
#include "effects/magnetics.h"
#include "effects/mechanics.h"
#include "laws/bouc_wen.h"
#include "laws/hyperbolic_tangent.h"
#include "laws/modified_bouc_wen.h"

namespace mrdamp {

double Damper::Clamp(double u) const {
  const double least = AnySign() ? -p.command_max : p.command_min;
  if (u < least) u = least;  // false where unset (NaN)
  if (u > p.command_max) u = p.command_max;
  return u;
}

namespace {

// A piece of piston motion: velocities at its ends with a path of their mean.
struct Piece {
  double x, va, vb, dt;
  double path() const { return 0.5 * (va + vb) * dt; }
};

// Pieces of a step, none longer than asked for; behind a mount the piston's own motion asks for shorter ones.
int Pieces(const Damper& d, double dt) {
  const double n = dt / d.p.substep * (HasMount(d.p) ? 2 : 1);
  return n > 1 ? static_cast<int>(std::min(std::ceil(n - 1e-9), 1e6)) : 1;
}

// The fluid over a piece of its motion; field0 and field1 at its ends. near: where the law's own solve for its state r
// begins.
void FluidPiece(const Damper& d, State* s, const Piece& m, double field0, double field1, double near) {
  ChainState& c = s->c;
  const Params& p = d.p;
  const double path = m.path(), mean = 0.5 * (m.va + m.vb);
  const auto rest = [&](double field, double x, double v) {
    return PlateRest(p, p.asymmetry_force > 0 ? ForceOfLaw(d, *s, field, x, v).fluid : 0, v);
  };
  const double plate = HasTimedPlate(p) ? rest(field0, m.x, m.va) : 0;
  double slope, spring;
  const double flow = HasSecantPocket(p) ? FlowForce(d, *s, field0, m.x, m.va, &slope, &spring) : 0;
  if (d.law == Law::kNarx) {
    const double end = c.time + m.dt, sample = d.net->sample_time;
    for (double k = s->past->count + 1; k * sample <= end + 1e-9 * sample; k += 1) {
      const double t = std::min(k * sample - c.time, m.dt), w = t / m.dt;
      const double v = m.va + (m.vb - m.va) * w;
      Narx::Push(*d.net, s->past, m.x + 0.5 * (m.va + v) * t, v, field0 + (field1 - field0) * w);
    }
  } else if (d.law != Law::kBingham) {
    // Where a step solves for the rate at its end, the coefficients are those of the end.
    const bool end = d.law == Law::kHyperbolicTangent;
    const Coefficients k = Evaluate(p, d.law, FluidAt(d, c, end ? field1 : 0.5 * (field0 + field1)), end ? m.vb : mean);
    if (d.law == Law::kBoucWen) {
      c.z = BoucWen::Step(p, k, c.z, m.va, m.vb, m.dt);
    } else if (d.law == Law::kHyperbolicTangent) {
      HyperbolicTangent::Step(p, k, &c.z, &c.r, m.x, m.va, m.vb, m.dt, near);
    } else {
      ModifiedBoucWen::Step(p, k, &c.z, &c.r, m.va, m.vb, m.dt);
    }
  }
  c.time += m.dt;
  if (p.asymmetry_travel > 0) c.plate = FollowPlate(p, c.plate, path);
  if (HasTimedPlate(p)) c.plate = Lag(c.plate, plate, rest(field1, m.x + path, m.vb), p.asymmetry_time, m.dt);
  if (HasTrappedGas(p)) c.stroke.Follow(m.x + path, p, m.dt);
  if (HasSecantPocket(p)) {
    const double to = FlowForce(d, *s, field1, m.x + path, m.vb, &slope, &spring);
    c.gas.Press(p, flow * to > 0 ? 0.5 * (flow + to) : to, path);
  }
  if (p.heating_kappa != 0 || p.heating_kappa_yield != 0) {
    const double fluid = FluidForce(d, *s, field1, m.x + path, m.vb, &slope, &spring);
    const Rise rise = Heat(p, {c.heat, c.body}, std::fabs(fluid * m.vb), m.dt);
    c.heat = rise.fluid;
    c.body = rise.body;
  }
}

// Nodes of the two-stage SDIRK that steps what is in series: each stage is an implicit Euler step of kGamma dt.
constexpr double kGamma = 0.29289321881345248;  // 1 - 1/sqrt(2)

// A stage of that: dt from the last one to this one, h the implicit part of it, `gas` the pocket's stretch without that.
struct Stage {
  double dt, h, gas;
};

// The fluid behind a pocket of gas over a stage of piston motion that ends at x with velocity v: where the gas carries
// the fluid's force. Solved for the rate at which it is pressed together.
void PocketStage(const Damper& d, State* s, double x, double v, const Stage& g, double from, double to) {
  const Params& p = d.p;
  const ChainState start = s->c;
  NarxHistory past;
  if (s->past) past = *s->past;
  const double share = PocketShare(p, v);
  double tried = 0, wanted = 0, left = 0, own = 0;
  const auto residual = [&](double rate) {
    const double near = s->c.r;
    s->c = start;
    if (s->past) *s->past = past;
    Pocket& gas = s->c.gas;
    gas.rate = tried = rate;
    gas.flow = v - share * rate;
    const Piece piece{0, start.gas.flow, gas.flow, g.dt};
    FluidPiece(d, s, {x - piece.path(), piece.va, piece.vb, g.dt}, from, to, near);
    double spring;
    wanted = PocketStretch(p, FluidForce(d, *s, to, x, gas.flow, &own, &spring));
    return left = g.gas + g.h * rate - wanted;
  };
  const double tolerance = 1e-7 * std::fmax(p.trapped_gas_s_g - std::fabs(start.gas.stretch), 1e-6 * p.trapped_gas_s_g);
  const double slope = g.h + share * PocketGive(p, start.gas.stretch) * start.gas.slope;
  const double rate = SolveIncreasing(residual, start.gas.rate, slope, tolerance);
  if (rate != tried) residual(rate);
  // To its stop exactly; where the fluid's force jumps, by the motion.
  s->c.gas.stretch = std::fabs(left) > tolerance ? g.gas + g.h * rate : wanted;
  s->c.gas.slope = own;
}

// How much an inner rate that is fast against dt changes with a jump of the field: the tanh law's g' alone.
double InnerJump(const Damper& d, const ChainState& c, double x, double v, double field0, double field1, double dt) {
  if (d.law != Law::kHyperbolicTangent || field0 == field1) return 0;
  const auto rate = [&](double field) {
    return HyperbolicTangent::Rate(d.p, Evaluate(d.p, d.law, FluidAt(d, c, field), v), c.z, c.r, x, v, dt);
  };
  return rate(field1) - rate(field0);
}

void FollowSeal(const Params& p, ChainState* c, const Piece& m) {
  if (!(p.seal_friction_coulomb > 0)) return;
  c->bristle = SealFriction::Follow(c->bristle, m.path(), SealLimit(p, 0.5 * (m.va + m.vb)), SealSigma(p));
}

// Fluid and mechanics over a piece of piston motion, without and with a pocket of gas between them.
void PistonPiece(const Damper& d, State* s, const Piece& m, double field0, double field1, double near) {
  FluidPiece(d, s, m, field0, field1, near);
  FollowSeal(d.p, &s->c, m);
}

void PocketPiece(const Damper& d, State* s, const Piece& m, double field0, double field1) {
  const double h = kGamma * m.dt, v_mid = m.va + kGamma * (m.vb - m.va), x_mid = m.x + 0.5 * (m.va + v_mid) * h;
  const double field_mid = field0 + kGamma * (field1 - field0), before = s->c.gas.stretch;
  PocketStage(d, s, x_mid, v_mid, {h, h, before}, field0, field_mid);
  const double base = before + (m.dt - h) * (s->c.gas.stretch - before) / h;
  PocketStage(d, s, m.x + m.path(), m.vb, {m.dt - h, h, base}, field_mid, field1);
  FollowSeal(d.p, &s->c, m);
}

// The piston behind the mount over a piece of rod motion: two-stage SDIRK for its position, each stage the balance
// of the damper with the mount's spring. The law is stepped from stage to stage.
void MountPiece(const Damper& d, State* s, const Piece& m, double field0, double field1) {
  const Params& p = d.p;
  const double x0 = s->c.piston, v0 = s->c.piston_velocity, h = kGamma * m.dt;
  const double mass = PistonMass(p);
  const double field_mid = field0 + kGamma * (field1 - field0);
  NarxHistory past;

  // Leaves in s the state after dt of piston motion from x_from, at whose end the piston stands at base + h v with
  // the velocity v that balances the mount at `rod`; returns v.
  const auto stage = [&](double x_from, double dt, double base, double base_velocity, double rod, double from,
                         double to, double guess, double gas) {
    const ChainState start = s->c;
    if (s->past) past = *s->past;
    const Easing over = Ease(p, dt);
    const double tolerance = 1e-6 * std::fabs(start.rubber.Force(p, rod - x_from)) + 1e-7;
    double tried = guess, own = start.piston_slope;  // where the state in s stands; d(force)/dv
    const auto attempt = [&](double v) {
      const double near = s->c.r;
      s->c = start;
      if (s->past) *s->past = past;
      const double x = base + h * v;
      const Piece piece{x_from, 2 * (x - x_from) / dt - v, v, dt};
      if (HasPocket(p)) {
        PocketStage(d, s, x, v, {dt, h, gas}, from, to);
        FollowSeal(p, &s->c, piece);
      } else {
        PistonPiece(d, s, piece, from, to, near);
      }
      return x;
    };
    const auto damper = [&](double v) {
      const double x = attempt(v);
      // No secant: where the force jumps (trapped gas at a turn) that is a slope the next solve would not get away from.
      const double force = PistonForce(d, *s, to, x, v, &own);
      tried = v;
      return force + mass * (v - base_velocity) / h;
    };
    Rubber::View view{};
    const auto mount = [&](double v) {
      view = start.rubber.Look(p, rod - base - h * v, over);
      return -view.force;
    };
    const auto balance = [&](double v, double force, double sum, double slope) {
      return MountBalance(p, start.rubber, over, view, rod - base - h * v, h, {force, sum, slope}, tolerance);
    };
    if (!(own > 0)) PistonForce(d, *s, from, x_from, guess, &own);
    double rise = own + mass / h;
    const double v = SolveSum(damper, mount, balance, guess, &rise, tolerance);
    s->c.piston = v == tried ? base + h * v : attempt(v);
    s->c.piston_velocity = v;
    // A hysteresis bends within a step: the secant over it is the better guess for the next one.
    const bool bends = d.law == Law::kBoucWen || d.law == Law::kModifiedBoucWen;
    s->c.piston_slope = bends ? std::fmin(std::fmax(rise - mass / h, own), 1e3 * own) : own;
    if (HasRubber(p)) s->c.rubber.Follow(p, rod - s->c.piston, over);
    return v;
  };
  const double rod_mid = m.x + m.va * h + 0.5 * (m.vb - m.va) * kGamma * h, rod_end = m.x + m.path();
  const double gas0 = s->c.gas.stretch;
  const double v1 = stage(x0, h, x0, v0, rod_mid, field0, field_mid, v0 + kGamma * (m.vb - m.va), gas0);
  const double x1 = s->c.piston, base = x0 + (m.dt - h) * v1;
  const double base_velocity = v0 + (m.dt - h) * (v1 - v0) / h;
  const double gas = gas0 + (m.dt - h) * (s->c.gas.stretch - gas0) / h;
  stage(x1, m.dt - h, base, base_velocity, rod_end, field_mid, field1, v1 + (m.dt - h) * (v1 - v0) / h, gas);
}

}  // namespace

void Start(const Damper& d, State* s, double x, double v, double u) {
  ChainState& c = s->c;
  c = ChainState();
  if (!std::isnan(d.p.command_start)) u = d.p.command_start;
  c.coil.Start(d.p, d.Clamp(u));
  c.magnet.Start(d.p, d.Acting(d.Clamp(u)));
  c.heat = c.body = d.p.heating_start;
  c.z = d.law == Law::kHyperbolicTangent ? x : 0;
  if (d.law == Law::kModifiedBoucWen) c.r = d.p.start_r;
  c.piston = c.stroke.extreme = c.stroke.turn = c.stroke.last = x;
  if (d.p.trapped_gas_direction < 0) c.stroke.pocket = PocketReach(d.p);
  c.piston_velocity = HasMount(d.p) ? 0 : v;
  c.gas.flow = c.piston_velocity;
  if (s->line) {
    *s->line = DelayLine();
    s->line->Push(-DelayLine::Spacing(Reach(d.p)), d.Clamp(u), Reach(d.p));  // before the command at 0, which may be another
    s->line->Push(0, d.Clamp(u), Reach(d.p));
  }
  if (d.law == Law::kNarx) Narx::Start(*d.net, s->past, x, c.piston_velocity, FieldNow(d, c));
}

void Advance(const Damper& d, State* s, const Motion& m, double u0, double u1) {
  if (!(m.dt > 0)) return;
  const Params& p = d.p;
  const double shift = (m.x1 - m.x0) / m.dt - 0.5 * (m.v0 + m.v1);
  const int pieces = Pieces(d, m.dt);
  const bool delayed = HasDelay(p) && s->line, mount = HasMount(p);
  const double dt = m.dt / pieces, begin = s->c.time;
  u0 = d.Clamp(u0);
  u1 = d.Clamp(u1);
  double x = m.x0;
  for (int k = 0; k < pieces; k++) {
    const double a = static_cast<double>(k) / pieces, b = static_cast<double>(k + 1) / pieces;
    double from = u0 + (u1 - u0) * a, to = u0 + (u1 - u0) * b;
    if (delayed && p.command_delay_period > 0) {
      from = to = Held(*s->line, p, begin + a * m.dt, begin + b * m.dt, d.hold);
    } else if (delayed) {
      from = Arrived(*s->line, p, begin + a * m.dt, d.hold);
      to = Arrived(*s->line, p, begin + b * m.dt, d.hold);
    }
    ChainState& c = s->c;
    const double field0 = FieldNow(d, c);
    const auto drive = [&](double first, double last, double over) {
      const double before = d.Acting(c.coil.current);
      c.coil.Step(p, first, last, over);
      if (p.remanence_b > 0) c.magnet.Follow(p, before, d.Acting(c.coil.current));
    };
    if (delayed && d.hold && !(Spread(p) > 0) && !(p.command_delay_period > 0)) {
      // A held command may change within the piece.
      const double late = p.command_delay_d, end = begin + b * m.dt;
      for (double t = begin + a * m.dt, next; t < end; t = next) {
        next = std::fmin(late + s->line->After(t - late), end);
        if (!(next > t)) next = end;
        const double u = s->line->At(0.5 * (t + next) - late, true);
        drive(u, u, next - t);
      }
    } else {
      drive(from, to, dt);
    }
    const double field1 = FieldNow(d, c);
    // Without a lag the current jumps with a held command at the start of the piece, not over it.
    const bool jump = ((d.hold && !(Spread(p) > 0)) || p.command_delay_period > 0) && !HasLag(p);
    const Piece piece{x, m.v0 + shift + (m.v1 - m.v0) * a, m.v0 + shift + (m.v1 - m.v0) * b, dt};
    if (jump && !mount && !HasPocket(p)) c.r += InnerJump(d, c, x, piece.va, field0, field1, dt);
    if (mount) MountPiece(d, s, piece, jump ? field1 : field0, field1);
    else if (HasPocket(p)) PocketPiece(d, s, piece, jump ? field1 : field0, field1);
    else PistonPiece(d, s, piece, jump ? field1 : field0, field1, c.r);
    Ring(p, &c.felt, (piece.vb - piece.va) / dt, dt);
    x += piece.path();
  }
  if (!mount) {
    s->c.piston = m.x1;
    s->c.piston_velocity = m.v1;
  }
}

namespace {

// Current and field with the command u: a chain without lag or delay acts at once.
struct Magnetised {
  double current, field;
};
Magnetised Commanded(const Damper& d, const State& s, double u) {
  const Params& p = d.p;
  const ChainState& c = s.c;
  if (HasLag(p)) return {c.coil.current, FieldNow(d, c)};
  double now = d.Clamp(u);
  if (p.command_delay_period > 0 && s.line) {
    now = Held(*s.line, p, c.time - 0.5 * p.substep, c.time + 0.5 * p.substep, d.hold);
  } else if (p.command_delay_d > 0 && s.line) {
    now = Arrived(*s.line, p, c.time, d.hold);
  }
  const double acting = d.Acting(now);
  if (!(p.remanence_b > 0)) return {now, FieldOf(p, acting, c.magnet.branch)};
  Magnet magnet = c.magnet;
  magnet.Follow(p, d.Acting(c.coil.current), acting);
  return {now, FieldOf(p, acting, magnet.branch)};
}

// The force on the rod, by what the damper or its mount carries.
double OnRod(const Params& p, const State& s, double carried, double a) {
  return carried + RodMass(p, HasMount(p)) * a + RingingForce(p, s.c.felt);
}

}  // namespace

void Settle(const Damper& d, State* s, double x, double v, double u) {
  if (d.law != Law::kNarx) return;
  if (HasMount(d.p)) {
    x = s->c.piston;
    v = s->c.piston_velocity;
  }
  if (HasPocket(d.p)) v = s->c.gas.flow;
  if (std::fabs(s->c.time - s->past->count * d.net->sample_time) > 1e-9 * d.net->sample_time) return;
  Narx::Amend(*d.net, s->past, x, v, Commanded(d, *s, u).field);
}

Observation Observe(const Damper& d, const State& s, double x, double v, double a, double u) {
  const Params& p = d.p;
  Observation o{};
  const ChainState& c = s.c;
  const Magnetised now = Commanded(d, s, u);
  o.current = now.current;
  o.field = now.field;
  o.temperature = c.heat;
  if (HasMount(p)) {
    o.force = OnRod(p, s, c.rubber.Force(p, x - c.piston), a);
    o.damper = PistonForce(d, s, o.field, c.piston, c.piston_velocity, &o.slope);
    o.piston = c.piston;
    o.slope = 0;
  } else {
    o.damper = PistonForce(d, s, o.field, x, v, &o.slope);
    o.force = OnRod(p, s, o.damper, a);
    o.piston = x;
  }
  o.inner = c.z;
  return o;
}

double RateJump(const Damper& d, const State& s, double x, double v, double u0, double u1, double dt) {
  if (u0 == u1 || HasMount(d.p) || HasPocket(d.p)) return 0;
  return InnerJump(d, s.c, x, v, Commanded(d, s, u0).field, Commanded(d, s, u1).field, dt);
}

double CurrentNow(const Damper& d, const State& s, double u) {
  return HasLag(d.p) ? s.c.coil.current : Commanded(d, s, u).current;
}

double RodForce(const Damper& d, const State& s, double x, double v, double a, double u) {
  if (!HasMount(d.p)) return Observe(d, s, x, v, a, u).force;
  return OnRod(d.p, s, s.c.rubber.Force(d.p, x - s.c.piston), a);
}

}  // namespace mrdamp
