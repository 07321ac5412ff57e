#include "core/record.h"

#include <algorithm>
#include <cmath>

#include "effects/sensor.h"
#include "mrdamp.h"

namespace mrdamp {

std::vector<double> Differentiate(const double* x, int n, double dt) {
  std::vector<double> v(n);
  for (int i = 1; i + 1 < n; i++) v[i] = (x[i + 1] - x[i - 1]) / (2 * dt);
  if (n > 2) {
    v[0] = (-3 * x[0] + 4 * x[1] - x[2]) / (2 * dt);
    v[n - 1] = (3 * x[n - 1] - 4 * x[n - 2] + x[n - 3]) / (2 * dt);
  }
  return v;
}

namespace {

// A record begins in motion where the mean speed of its first kStart (s) is more than kMoving of its RMS; not within
// kMiddle of the middle of its range, from where a machine's program begins, and a cut record seldom does. A sample is
// like the start up to a sum of squares of kNear, of displacement over range, velocity over RMS, command over range.
// The run-in is kPath times the range long: two cycles, in which a hysteresis forgets.
constexpr double kStart = 0.02, kMoving = 0.05, kMiddle = 0.02, kNear = 0.1, kPath = 4;

// channel_shift: the true motion x_true(t) = x_read(t + d), by cubic Hermite pieces. Beyond its ends the motion
// goes on at its velocity: to stand still there would be a jump.
struct Shifted {
  std::vector<double> x, v, a;

  Shifted(const RecordView& r, double d) : x(r.n), v(r.n), a(r.n) {
    for (int i = 0; i < r.n; i++) {
      const double at = i + d / r.dt;
      const int k = static_cast<int>(std::clamp(std::floor(at), 0.0, r.n - 2.0));
      const double w = std::clamp(at - k, 0.0, 1.0), h = r.dt;
      const double x0 = r.x[k], x1 = r.x[k + 1], v0 = r.v[k] * h, v1 = r.v[k + 1] * h;
      const double b = 3 * (x1 - x0) - 2 * v0 - v1, c = 2 * (x0 - x1) + v0 + v1;
      x[i] = x0 + w * (v0 + w * (b + w * c));
      const double beyond = at - std::clamp(at, 0.0, r.n - 1.0);
      const bool outside = beyond != 0;
      v[i] = (v0 + w * (2 * b + 3 * w * c)) / h;
      if (outside) x[i] += beyond * h * v[i];
      a[i] = outside ? 0 : r.a[k] + w * (r.a[k + 1] - r.a[k]);
    }
  }
};

double Column(const Observation& o, const Sensor& sensor, const SensorParams& reading, int column) {
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
void Rebase(const Damper& d, double dx, State* s) {
  ChainState& c = s->c;
  if (s->line) {
    for (double& t : s->line->time) t -= c.time;
  }
  if (s->past) {
    s->past->count = 0;
    for (double& x : s->past->value[NarxNet::kX]) x += dx;
  }
  c.time = 0;
  c.heat = c.body = d.p.heating_start;
  if (d.law == Law::kHyperbolicTangent) c.z += dx;
  for (double* x : {&c.piston, &c.stroke.extreme, &c.stroke.turn, &c.stroke.last}) *x += dx;
}

}  // namespace

RunIn FindRunIn(const RecordView& r) {
  double low = r.x[0], high = r.x[0], mean = 0, fast = 0, least = r.u[0], most = r.u[0];
  for (int i = 0; i < r.n; i++) {
    low = std::min(low, r.x[i]);
    high = std::max(high, r.x[i]);
    least = std::min(least, r.u[i]);
    most = std::max(most, r.u[i]);
    fast += r.v[i] * r.v[i] / r.n;
  }
  const double range = high - low, speed = std::sqrt(fast), span = most > least ? most - least : 1;
  const int begin = std::min(std::max(3, static_cast<int>(std::lround(kStart / r.dt))), r.n / 4);
  for (int i = 0; i < begin; i++) mean += std::fabs(r.v[i]) / begin;
  if (!(mean > kMoving * speed)) return {};
  if (std::fabs(r.x[0] - 0.5 * (low + high)) < kMiddle * range) return {};
  double best = kNear;
  RunIn found;
  for (int i = r.n / 3; i + 1 < r.n; i++) {
    if (r.v[i] * r.v[0] < 0) continue;
    const double x = (r.x[i] - r.x[0]) / range, v = (r.v[i] - r.v[0]) / speed, u = (r.u[i] - r.u[0]) / span;
    const double off = x * x + v * v + u * u;
    if (off > best) continue;
    best = off;
    found.to = i;
  }
  double path = 0;
  for (found.from = found.to; found.from > 0 && path < kPath * range; found.from--) {
    path += std::fabs(r.x[found.from] - r.x[found.from - 1]);
  }
  return found;
}

void RunRecord(const Damper& d, const RecordView& record, const RunIn& before, int ncol, const int* columns, double* out) {
  RecordView r = record;
  if (d.p.channel_shift_d != 0) {
    const Shifted shifted(record, d.p.channel_shift_d);
    r.x = shifted.x.data();
    r.v = shifted.v.data();
    r.a = shifted.a.data();
    Damper plain = d;
    plain.p.channel_shift_d = 0;
    RunRecord(plain, r, before, ncol, columns, out);
    return;
  }
  OwnedState state(d);
  State& s = state.s;
  const SensorParams reading = SensorParams::Of(d.p);
  Sensor sensor;
  const bool jumps = CurrentJumps(d);
  // Steps from the sample i - 1 to i; t0: of the chain's clock, the sample at which it is 0.
  const auto step = [&](int i, int t0) {
    const double first = r.u[i - 1], now = d.hold ? first : r.u[i];
    if (s.line) s.line->Push(((d.hold ? i - 1 : i) - t0) * r.dt, d.Clamp(now), Reach(d.p));
    Motion m{r.x[i - 1], r.v[i - 1], r.x[i], r.v[i], r.dt};
    double a = r.a[i - 1];
    if (jumps && s.line) {  // the sensor sees a jump where it arrives
      for (double to; (to = NextJump(*s.line, d.p, s.c.time) - s.c.time) < m.dt - kSame;) {
        const double w = to / m.dt, shift = (m.x1 - m.x0) / m.dt - 0.5 * (m.v0 + m.v1);
        const double v0 = m.v0 + shift, v = v0 + w * (m.v1 - m.v0), x = m.x0 + 0.5 * (v0 + v) * to;
        a += w * (r.a[i] - a);
        Advance(d, &s, {m.x0, v0, x, v, to}, first, now);
        sensor.Step(reading, Observe(d, s, x, v, a, now, kBefore).force, to);
        sensor.Step(reading, Observe(d, s, x, v, a, now).force, 0);
        m = {x, v, m.x1, m.v1 + shift, m.dt - to};
      }
    }
    Advance(d, &s, m, first, now);
    if (jumps) sensor.Step(reading, Observe(d, s, r.x[i], r.v[i], r.a[i], now, kBefore).force, m.dt);
    if (s.line && d.hold) s.line->Push((i - t0) * r.dt, d.Clamp(r.u[i]), Reach(d.p));
    Settle(d, &s, r.x[i], r.v[i], r.u[i]);
  };
  const auto observe = [&](int i) { return Observe(d, s, r.x[i], r.v[i], r.a[i], r.u[i]); };
  const bool led = before.to > before.from;
  Start(d, &s, r.x[before.from], r.v[before.from], r.u[before.from]);
  if (led) {
    // A slow state (x - y) would take longer than the run-in to come from its end to the middle of the motion.
    if (d.law == Law::kModifiedBoucWen) {
      double sum = 0;
      for (int i = before.from; i <= before.to; i++) sum += r.x[i];
      s.c.r = r.x[before.from] - sum / (before.to - before.from + 1);
    }
    sensor.Start(reading, observe(before.from).force);
    for (int i = before.from + 1; i <= before.to; i++) {
      step(i, before.from);
      sensor.Step(reading, observe(i).force, jumps ? 0 : r.dt);
    }
    Rebase(d, r.x[0] - r.x[before.to], &s);
    if (d.law == Law::kModifiedBoucWen) s.c.r += d.p.start_r;
    sensor.unsettled = 1;
  }
  for (int i = 0; i < r.n; i++) {
    if (i > 0) step(i, 0);
    const Observation o = observe(i);
    if (i == 0 && !led) sensor.Start(reading, o.force);
    else sensor.Step(reading, o.force, jumps ? 0 : r.dt);
    for (int c = 0; c < ncol; c++) out[static_cast<std::size_t>(c) * r.n + i] = Column(o, sensor, reading, columns[c]);
  }
}

}  // namespace mrdamp
