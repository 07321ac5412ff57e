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

}  // namespace

void RunRecord(const Damper& d, const RecordView& record, int ncol, const int* columns, double* out) {
  RecordView r = record;
  if (d.p.channel_shift_d != 0) {
    const Shifted shifted(record, d.p.channel_shift_d);
    r.x = shifted.x.data();
    r.v = shifted.v.data();
    r.a = shifted.a.data();
    Damper plain = d;
    plain.p.channel_shift_d = 0;
    RunRecord(plain, r, ncol, columns, out);
    return;
  }
  OwnedState state(d);
  State& s = state.s;
  const SensorParams reading = SensorParams::Of(d.p);
  Sensor sensor;
  Start(d, &s, r.x[0], r.v[0], r.u[0]);
  for (int i = 0; i < r.n; i++) {
    if (i > 0) {
      const double before = r.u[i - 1], now = d.hold ? before : r.u[i];
      if (s.line) s.line->Push((d.hold ? i - 1 : i) * r.dt, d.Clamp(now), Reach(d.p));
      Advance(d, &s, {r.x[i - 1], r.v[i - 1], r.x[i], r.v[i], r.dt}, before, now);
      if (s.line && d.hold) s.line->Push(i * r.dt, d.Clamp(r.u[i]), Reach(d.p));
      Settle(d, &s, r.x[i], r.v[i], r.u[i]);
    }
    const Observation o = Observe(d, s, r.x[i], r.v[i], r.a[i], r.u[i]);
    if (i == 0) sensor.Start(reading, o.force);
    else sensor.Step(reading, o.force, r.dt);
    for (int c = 0; c < ncol; c++) out[static_cast<std::size_t>(c) * r.n + i] = Column(o, sensor, reading, columns[c]);
  }
}

}  // namespace mrdamp
