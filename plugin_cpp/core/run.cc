#include "core/run.h"

#include "effects/sensor.h"
#include "mrdamp.h"

namespace mrdamp {

namespace {

Real Column(const Observation& o, const Sensor& sensor, const SensorParams& reading, int column) {
  switch (column) {
    case MRDAMP_FORCE: return sensor.Read(reading);
    case MRDAMP_REFERENCE: return o.force;
    case MRDAMP_TRUE: return o.damper;
    case MRDAMP_CURRENT: return o.current;
    case MRDAMP_FIELD: return o.field;
    case MRDAMP_TEMPERATURE: return o.temperature;
    case MRDAMP_PISTON: return o.piston;
    default: return o.inner;
  }
}

// The state at the end of a run-in as that of a start: its clock begins anew, the piston stands dx further on, and what
// heats and settles from the start on begins.
void Rebase(const Damper& d, Real dx, State* s) {
  ChainState& c = s->c;
  if (s->line) {
    for (double& t : s->line->time) t -= Head(c.time);
  }
  if (s->past) {
    s->past->count = 0;
    for (double& x : s->past->value[NarxNet::kX]) x += Head(dx);
  }
  c.time = 0;
  c.heat = c.body = d.p.heating_start;
  if (Is(d.law).inner) c.z += dx;
  for (Real* x : {&c.piston, &c.stroke.extreme, &c.stroke.turn, &c.stroke.last}) *x += dx;
}

struct Inputs {
  Real x, v, a, u;

  Inputs(const MrdampLane* lane, const int* at)
      : x(Gather([&](int l) { return lane[l].x[at[l]]; })), v(Gather([&](int l) { return lane[l].v[at[l]]; })),
        a(Gather([&](int l) { return lane[l].a[at[l]]; })), u(Gather([&](int l) { return lane[l].u[at[l]]; })) {}
};

}  // namespace

void Run(const Damper& d, const MrdampLane* lanes, int count, double dt, int ncol, const int* columns) {
  MrdampLane lane[kLanes];
  int lead[kLanes], begin = 0, end = 0;
  for (int l = 0; l < kLanes; l++) {
    lane[l] = lanes[l < count ? l : 0];
    lead[l] = lane[l].to - lane[l].from;
    if (lead[l] > begin) begin = lead[l];
    if (lane[l].n > end) end = lane[l].n;
  }
  // Samples of the run-ins end at 0, where the records begin. Before and after its own ones a lane stands still.
  int at[kLanes];
  const auto before = [&](int i) {
    for (int l = 0; l < kLanes; l++) at[l] = i > -lead[l] ? lane[l].to + i : lane[l].from;
    return Inputs(lane, at);
  };
  const auto sample = [&](int i) {
    for (int l = 0; l < kLanes; l++) at[l] = i < lane[l].n ? i : lane[l].n - 1;
    return Inputs(lane, at);
  };
  OwnedState state(d);
  State& s = state.s;
  const SensorParams reading = SensorParams::Of(d.p);
  Sensor sensor;
  const bool jumps = CurrentJumps(d);
  const auto observe = [&](const Inputs& in) { return Observe(d, s, in.x, in.v, in.a, in.u); };
  // A step from the inputs `from`, `ticks` after the chain's clock was 0, to `to`.
  const auto step = [&](const Inputs& from, const Inputs& to, int ticks) {
    const Real first = from.u, now = d.hold ? first : to.u;
    if (s.line) s.line->Push((d.hold ? ticks : ticks + 1) * dt, Head(d.Clamp(now)), Reach(d.p));
    Motion m{from.x, from.v, to.x, to.v, dt};
    Real a = from.a;
    if (jumps && s.line) {  // the sensor sees a jump where it arrives
      for (double way; (way = NextJump(*s.line, d.p, Head(s.c.time)) - Head(s.c.time)) < m.dt - kSame;) {
        const double w = way / m.dt;
        const Real shift = (m.x1 - m.x0) / m.dt - 0.5 * (m.v0 + m.v1);
        const Real v0 = m.v0 + shift, v = v0 + w * (m.v1 - m.v0), x = m.x0 + 0.5 * (v0 + v) * way;
        a += w * (to.a - a);
        Advance(d, &s, {m.x0, v0, x, v, way}, first, now);
        sensor.Step(reading, Observe(d, s, x, v, a, now, kBefore).force, way);
        sensor.Step(reading, Observe(d, s, x, v, a, now).force, 0);
        m = {x, v, m.x1, m.v1 + shift, m.dt - way};
      }
    }
    Advance(d, &s, m, first, now);
    if (jumps) sensor.Step(reading, Observe(d, s, to.x, to.v, to.a, now, kBefore).force, m.dt);
    if (s.line && d.hold) s.line->Push((ticks + 1) * dt, Head(d.Clamp(to.u)), Reach(d.p));
    Settle(d, &s, to.x, to.v, to.u);
  };
  Inputs from = before(-begin);
  if (begin == 0) from = sample(0);
  Start(d, &s, from.x, from.v, from.u);
  sensor.Start(reading, observe(from).force);
  for (int i = -begin; begin > 0 && i <= 0; i++) {
    const Inputs to = before(i);
    if (i > -begin) {
      step(from, to, i - 1 + begin);
      sensor.Step(reading, observe(to).force, jumps ? 0 : dt);
    }
    const Mask starts = Gather([&](int l) { return i == -lead[l]; }) > 0;
    if (Any(starts)) {
      const Sensor shown = sensor;
      const State others = s;
      Start(d, &s, to.x, to.v, to.u);
      // A slow state would take longer than the run-in to come from its end to the middle of the motion.
      if (Is(d.law).slow) {
        s.c.r = to.x - Gather([&](int l) {
          double sum = 0;
          for (int k = lane[l].from; k <= lane[l].to; k++) sum += lane[l].x[k];
          return sum / (lead[l] + 1);
        });
      }
      sensor.Start(reading, observe(to).force);
      Keep(!starts, &s.c, others.c);
      Keep(!starts, &sensor, shown);
    }
    from = to;
  }
  if (begin > 0) {
    const Inputs first = sample(0);
    Rebase(d, first.x - from.x, &s);
    if (Is(d.law).slow) s.c.r += d.p.start_r;
    sensor.unsettled = 1;
    from = first;
  }
  for (int i = 0; i < end; i++) {
    const Inputs to = sample(i);
    if (i > 0) step(from, to, i - 1);
    const Observation o = observe(to);
    if (i > 0 || begin > 0) sensor.Step(reading, o.force, jumps ? 0 : dt);
    for (int c = 0; c < ncol; c++) {
      const Real value = Column(o, sensor, reading, columns[c]);
      Scatter(value, count, [&](int l, double one) {
        if (i < lane[l].n) lane[l].out[static_cast<std::size_t>(c) * lane[l].n + i] = one;
      });
    }
    from = to;
  }
}

}  // namespace mrdamp
