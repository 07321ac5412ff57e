#include "core/chain.h"

#include <algorithm>

#include "core/forces.h"
#include "core/piece.h"
#include "effects/magnetics.h"
#include "effects/mechanics.h"

namespace mrdamp {

Real Damper::Clamp(Real u) const {
  const Real least = AnySign() ? -p.command_max : p.command_min;
  u = Select(u < least, least, u);  // not where unset (NaN)
  return Select(u > p.command_max, p.command_max, u);
}

namespace {

// Pieces of a step, none longer than asked for.
int Pieces(const Damper& d, double dt) {
  const double n = dt / Head(d.p.substep);
  return n > 1 ? static_cast<int>(min(std::ceil(n - 1e-9), 1e6)) : 1;
}

// How much an inner rate that is fast against dt changes with a jump of the field.
Real InnerJump(const Damper& d, const ChainState& c, Real x, Real v, Real field0, Real field1, double dt) {
  if (!Is(d.law).inner || All(field0 == field1)) return 0;
  const auto rate = [&](Real field) {
    const Coefficients k = Evaluate(d.p, d.law, FluidAt(d, c, field), v);
    return OfLaw(d.law, [&](auto law) { return law.Rate(d.p, k, c.z, c.r, x, v, dt); });
  };
  return rate(field1) - rate(field0);
}

}  // namespace

void Start(const Damper& d, State* s, Real x, Real v, Real u) {
  ChainState& c = s->c;
  c = ChainState();
  u = Either(d.p.command_start, u);
  c.coil.Start(d.p, d.Clamp(u));
  c.magnet.Start(d.p, d.Acting(d.Clamp(u)));
  c.field = FieldNow(d, c);
  c.heat = c.body = d.p.heating_start;
  if (Is(d.law).slow) c.r = d.p.start_r;
  c.piston = x;
  if (HasMount(d.p)) x = c.piston = Rest(d, *s, x);
  if (Is(d.law).inner) c.z = x;
  c.stroke.extreme = c.stroke.turn = c.stroke.last = x;
  c.stroke.pocket = Select(d.p.trapped_gas_direction < 0, PocketReach(d.p), 0);
  c.piston_velocity = HasMount(d.p) ? 0 : v;
  c.gas.flow = c.piston_velocity;
  if (s->line) {
    *s->line = DelayLine();
    const double reach = Reach(d.p), first = Head(d.Clamp(u));
    s->line->Push(-DelayLine::Spacing(reach), first, reach);  // before the command at 0, which may be another
    s->line->Push(0, first, reach);
  }
  if (d.law == Law::kNarx) Narx::Start(*d.net, s->past, Head(x), Head(c.piston_velocity), Head(c.field));
}

void Advance(const Damper& d, State* s, const Motion& m, Real u0, Real u1) {
  if (!(m.dt > 0)) return;
  const Params& p = d.p;
  const Real shift = (m.x1 - m.x0) / m.dt - 0.5 * (m.v0 + m.v1);
  const int pieces = Pieces(d, m.dt);
  const bool delayed = HasDelay(p) && s->line, mount = HasMount(p);
  const bool jumps = delayed ? Jumps(p, d.hold) : d.hold;
  const double begin = Head(s->c.time);
  u0 = d.Clamp(u0);
  u1 = d.Clamp(u1);
  Real x = m.x0;
  double from = 0, to;  // s of the step
  for (int k = 0; k < pieces; from = to) {
    const double grid = m.dt * (k + 1) / pieces;
    Real first = u0 + (u1 - u0) * (from / m.dt), last;
    to = grid;
    if (delayed && jumps) {  // a piece ends where the command jumps
      first = last = Arrived(*s->line, p, begin + from, d.hold);
      const double jump = NextJump(*s->line, p, begin + from) - begin;
      if (jump < grid - kSame) to = jump;
    } else if (delayed) {
      first = Arrived(*s->line, p, begin + from, d.hold);
      last = Arrived(*s->line, p, begin + to, d.hold);
    } else {
      last = u0 + (u1 - u0) * (to / m.dt);
    }
    k += to == grid;
    ChainState& c = s->c;
    const double dt = to - from;
    const Real before = d.Acting(c.coil.current), field0 = c.field;
    const Real mean = d.Acting(c.coil.Step(p, first, last, dt)), after = d.Acting(c.coil.current);
    Magnet middle = c.magnet;
    if (Head(p.remanence_b) > 0) {
      middle.Follow(p, before, mean);
      c.magnet.Follow(p, before, after);
    }
    if (!All(after == before)) c.field = FieldNow(d, c);
    const Real field1 = c.field;
    // A straight field of the same mean and end: a fast lag bends it, without one it jumps at the piece's start.
    const Real start = All(mean == after) ? field1 : 2 * FieldOf(p, mean, middle.branch) - field1;
    const Real va = m.v0 + shift + (m.v1 - m.v0) * (from / m.dt), vb = m.v0 + shift + (m.v1 - m.v0) * (to / m.dt);
    const Piece piece{x, va, vb, dt};
    if (jumps && !HasLag(p) && !mount && !HasPocket(p)) c.r += InnerJump(d, c, x, piece.va, field0, field1, dt);
    if (jumps && !HasLag(p) && Any(field0 != start)) Release(d, s, x, start, field0 != start);
    StepPiece(d, s, piece, start, field1);
    if (HasRinging(p)) Ring(p, &c.sprung, (piece.vb - piece.va) / dt, dt);
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
  Real current, field;
};
Magnetised Commanded(const Damper& d, const State& s, Real u, Side side) {
  const Params& p = d.p;
  const ChainState& c = s.c;
  if (HasLag(p)) return {c.coil.current, c.field};
  Real now = d.Clamp(u);
  if (HasDelay(p) && s.line) now = Arrived(*s.line, p, Head(c.time) - (side == kBefore ? 2 * kSame : 0), d.hold);
  if (All(now == c.coil.current)) return {now, c.field};
  const Real acting = d.Acting(now);
  if (!(Head(p.remanence_b) > 0)) return {now, FieldOf(p, acting, c.magnet.branch)};
  Magnet magnet = c.magnet;
  magnet.Follow(p, d.Acting(c.coil.current), acting);
  return {now, FieldOf(p, acting, magnet.branch)};
}

// The force on the rod, by what the damper or its mount carries.
Real OnRod(const Params& p, const State& s, Real carried, Real a) {
  return carried + RodMass(p, HasMount(p)) * a + RingingForce(p, s.c.sprung);
}

}  // namespace

void Settle(const Damper& d, State* s, Real x, Real v, Real u) {
  if (d.law != Law::kNarx) return;
  if (HasMount(d.p)) {
    x = s->c.piston;
    v = s->c.piston_velocity;
  }
  if (HasPocket(d.p)) v = s->c.gas.flow;
  if (fabs(Head(s->c.time) - s->past->count * d.net->sample_time) > 1e-9 * d.net->sample_time) return;
  Narx::Amend(*d.net, s->past, Head(x), Head(v), Head(Commanded(d, *s, u, kAfter).field));
}

Observation Observe(const Damper& d, const State& s, Real x, Real v, Real a, Real u, Side side) {
  const Params& p = d.p;
  Observation o{};
  const ChainState& c = s.c;
  const Magnetised now = Commanded(d, s, u, side);
  o.current = now.current;
  o.field = now.field;
  o.temperature = c.heat;
  if (HasMount(p)) {
    o.force = OnRod(p, s, c.elastomer.Force(p, x - c.piston), a);
    o.damper = PistonForce(d, s, o.field, c.piston, c.piston_velocity, &o.slope, {v, kUnset});
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

Real RateJump(const Damper& d, const State& s, Real x, Real v, Real u0, Real u1, double dt) {
  if (All(u0 == u1) || HasMount(d.p) || HasPocket(d.p)) return 0;
  return InnerJump(d, s.c, x, v, Commanded(d, s, u0, kBefore).field, Commanded(d, s, u1, kAfter).field, dt);
}

Real CurrentNow(const Damper& d, const State& s, Real u) {
  return HasLag(d.p) ? s.c.coil.current : Commanded(d, s, u, kAfter).current;
}

Real RodForce(const Damper& d, const State& s, Real x, Real v, Real a, Real u) {
  if (!HasMount(d.p)) return Observe(d, s, x, v, a, u, kBefore).force;
  return OnRod(d.p, s, s.c.elastomer.Force(d.p, x - s.c.piston), a);
}

}  // namespace mrdamp
