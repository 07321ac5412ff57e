#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <new>
#include <string>
#include <vector>

#include "capi/make.h"
#include "core/chain.h"
#include "core/frame.h"
#include "core/packs.h"
#include "core/record.h"
#include "core/shift.h"
#include "effects/sensor.h"
#include "mrdamp.h"

using namespace mrdamp;

struct mrdamp_damper {
  Damper d;
  OwnedState state;
  SensorParams reading;
  Sensor sensor;
  Observation seen{};
  double x = 0, v = 0;
  bool started = false;
};

namespace {

bool Finite(const char* name, const double* a, int n, char* err, int size) {
  for (int i = 0; i < n; i++) {
    if (!std::isfinite(a[i])) {
      Fail(err, size, std::string(name) + ": sample " + std::to_string(i) + " is not a finite number");
      return false;
    }
  }
  return true;
}

}  // namespace

extern "C" {

int mrdamp_abi(void) { return 14; }
int mrdamp_attribute_count(void) { return kParamCount; }
const char* mrdamp_attribute_name(int i) { return kAttributes[i].name; }
const char* mrdamp_attribute_group(int i) { return kAttributes[i].group; }
const char* mrdamp_attribute_unit(int i) { return kAttributes[i].unit; }
const char* mrdamp_attribute_meaning(int i) { return kAttributes[i].meaning; }
double mrdamp_attribute_default(int i) { return kAttributes[i].def; }
double mrdamp_attribute_min(int i) { return kAttributes[i].min; }
double mrdamp_attribute_max(int i) { return kAttributes[i].max; }
int mrdamp_law_count(void) { return kLawCount; }
const char* mrdamp_law_name(int law) { return kLawNames[law]; }
int mrdamp_law_find(const char* name) { return FindLaw(name); }
int mrdamp_law_uses(int law, int i) { return LawUses(static_cast<Law>(law), i); }
const char* mrdamp_law_equations(int law) { return kLawRows[law].equations; }
const char* mrdamp_law_parameters(int law) { return kLawRows[law].parameters; }
const char* mrdamp_law_search(int law) { return kLawRows[law].search; }
const char* mrdamp_law_sources(int law) { return kLawRows[law].sources; }

const char* mrdamp_source(int i) {
  static const char* const kSources[] = {
#define MRDAMP_SOURCE(key, authors, title, journal, year, volume, pages, doi) \
  #key "\t" authors "\t" title "\t" journal "\t" year "\t" volume "\t" pages "\t" doi,
#include "core/attributes.def"
      nullptr};
  return kSources[i];
}

const char* mrdamp_effect(int i) {
  static const char* const kEffects[] = {
#define MRDAMP_CAUSE(name, stage, words, equations) #name "\t" #stage "\t" words "\t" equations,
#include "core/attributes.def"
      nullptr};
  return kEffects[i];
}

void mrdamp_defaults(double* params) {
  const Params p;
  std::memcpy(params, p.data(), sizeof(Params));
}

int mrdamp_check(int law, const double* params, char* err, int err_size) {
  Damper d;
  if (law == static_cast<int>(Law::kNarx)) {
    static const NarxNet kAny;
    d.net = &kAny;
  }
  if (law < 0 || law >= kLawCount) return Fail(err, err_size, "law number " + std::to_string(law) + " is unknown");
  d.law = static_cast<Law>(law);
  std::memcpy(d.p.data(), params, sizeof(Params));
  return Check(d, err, err_size) ? 0 : 1;
}

mrdamp_narx* mrdamp_narx_parse(const char* text, char* err, int err_size) {
  std::string error;
  std::unique_ptr<NarxNet> net = ParseNarx(text, &error);
  if (!net) {
    Fail(err, err_size, error);
    return nullptr;
  }
  return new (std::nothrow) mrdamp_narx{std::move(net)};
}
void mrdamp_narx_free(mrdamp_narx* net) { delete net; }
double mrdamp_narx_sample_time(const mrdamp_narx* net) { return net->net->sample_time; }
int mrdamp_narx_inputs(const mrdamp_narx* net) { return static_cast<int>(net->net->inputs.size()); }
double mrdamp_narx_forward(const mrdamp_narx* net, const double* in) { return net->net->Forward(in); }

namespace {

// False and a line for a record that cannot be run.
bool CheckRecord(double dt, int n, const double* x, const double* v, const double* a, const double* u, char* err, int size) {
  if (n < 3) return !Fail(err, size, "a record needs at least 3 samples, got " + std::to_string(n));
  if (!(dt >= 1e-9) || !std::isfinite(dt)) return !Fail(err, size, "the sample time must be a finite number of at least 1e-9 s");
  return Finite("displacement", x, n, err, size) && Finite("command", u, n, err, size) &&
         (!v || Finite("velocity", v, n, err, size)) && (!a || Finite("acceleration", a, n, err, size));
}

}  // namespace

int mrdamp_run_records(int law, const mrdamp_narx* net, int nrecord, const mrdamp_record* records, int threads, int lanes,
                       int ncol, const int* columns, char* err, int err_size) {
  if (nrecord < 0 || ncol < 0) return Fail(err, err_size, "a number of records or columns is negative");
  for (int c = 0; c < ncol; c++) {
    if (columns[c] < 0 || columns[c] >= MRDAMP_COLUMNS) return Fail(err, err_size, "unknown column " + std::to_string(columns[c]));
  }
  if (!KnownLanes(lanes)) return Fail(err, err_size, "lanes is " + std::to_string(lanes) + "; allowed: 0, 1, 2, 4, 8");
  std::vector<std::vector<double>> differentiated;
  std::vector<std::vector<Damper>> dampers(nrecord);
  std::vector<RecordView> views;
  views.reserve(nrecord);
  std::vector<Job> jobs;
  for (int r = 0; r < nrecord; r++) {
    const mrdamp_record& m = records[r];
    if (!CheckRecord(m.dt, m.n, m.x, m.v, m.a, m.u, err, err_size)) return 1;
    if (m.nset < 0) return Fail(err, err_size, "a number of sets is negative");
    const auto given = [&](const double* known, const double* of) {
      return known ? known : differentiated.emplace_back(Differentiate(of, m.n, m.dt)).data();
    };
    const double* v = given(m.v, m.x);
    views.push_back({m.dt, m.n, m.x, v, given(m.a, v), m.u});
    const RunIn before = m.run_in ? FindRunIn(views.back()) : RunIn{};
    const mrdamp_options options{m.hold, 1, m.substep, m.run_in, lanes};
    dampers[r].resize(m.nset);
    for (int k = 0; k < m.nset; k++) {
      const std::size_t at = k;
      if (!Make(law, m.params + at * kParamCount, net, &options, &dampers[r][k], err, err_size)) {
        const std::string said = err && err_size > 0 ? err : "";
        return nrecord * m.nset > 1 ? Fail(err, err_size, "record " + std::to_string(r) + ", set " + std::to_string(k) + ": " + said) : 1;
      }
      jobs.push_back({&dampers[r][k], &views.back(), before, m.out + at * ncol * m.n});
    }
  }
  RunJobs(jobs, ncol, columns, threads, lanes);
  return 0;
}

int mrdamp_run(int law, const mrdamp_narx* net, int nset, const double* params, double dt, int n, const double* x,
               const double* v, const double* a, const double* u, const mrdamp_options* options, int ncol,
               const int* columns, double* out, char* err, int err_size) {
  const mrdamp_options o = options ? *options : mrdamp_options{1, 1, 0, 0, 0};
  const mrdamp_record record{nset, n, dt, o.substep, o.hold, o.run_in, params, x, v, a, u, out};
  return mrdamp_run_records(law, net, 1, &record, o.threads, o.lanes, ncol, columns, err, err_size);
}

int mrdamp_run_in(double dt, int n, const double* x, const double* v, const double* u, int* from, int* to, char* err,
                  int err_size) {
  if (!CheckRecord(dt, n, x, v, nullptr, u, err, err_size)) return 1;
  std::vector<double> velocity;
  if (!v) v = (velocity = Differentiate(x, n, dt)).data();
  const RunIn found = FindRunIn({dt, n, x, v, nullptr, u});
  *from = found.from;
  *to = found.to;
  return 0;
}

void mrdamp_true_motion(double shift_d, double lag_tau, double lag_width, double dt, int n, double* x, double* v, double* a) {
  std::vector<double> moved(kRoom * static_cast<std::size_t>(n));
  MrdampLane lane{nullptr, n, x, v, a, nullptr, 0, 0, nullptr};
  TakeBack(shift_d, lag_tau, lag_width, dt, moved.data(), &lane);
  std::copy(lane.x, lane.x + n, x);
  std::copy(lane.v, lane.v + n, v);
  std::copy(lane.a, lane.a + n, a);
}

int mrdamp_run_frame(int law, const mrdamp_narx* net, int nset, const double* params, const mrdamp_frame* frames,
                     double dt, int n, const double* ground_acceleration, const double* u,
                     const mrdamp_options* options, double* out, char* err, int err_size) {
  if (n < 2) return Fail(err, err_size, "a record needs at least 2 samples, got " + std::to_string(n));
  if (nset < 0) return Fail(err, err_size, "the number of sets is negative");
  if (!(dt > 0) || !std::isfinite(dt)) return Fail(err, err_size, "the sample time must be above 0");
  if (!Finite("ground_acceleration_m_s2", ground_acceleration, n, err, err_size)) return 1;
  if (!Finite("command", u, n, err, err_size)) return 1;
  std::vector<Damper> dampers(nset);
  std::vector<std::size_t> offset(nset, 0);
  for (int k = 0; k < nset; k++) {
    if (!Make(law, params + static_cast<std::size_t>(k) * kParamCount, net, options, &dampers[k], err, err_size)) return 1;
    if (!CheckFrame(frames[k], err, err_size)) return 1;
    if (k > 0) offset[k] = offset[k - 1] + static_cast<std::size_t>(FrameColumns(frames[k - 1].storeys)) * n;
  }
  ParallelFor(nset, options ? options->threads : 1, [&](int k) {
    RunFrame(dampers[k], frames[k], dt, n, ground_acceleration, u, out + offset[k]);
  });
  return 0;
}

mrdamp_damper* mrdamp_damper_new(int law, const double* params, const mrdamp_narx* net, char* err, int err_size) {
  Damper d;
  if (!Make(law, params, net, nullptr, &d, err, err_size)) return nullptr;
  return new (std::nothrow) mrdamp_damper{d, OwnedState(d), SensorParams::Of(d.p), {}};
}
void mrdamp_damper_free(mrdamp_damper* damper) { delete damper; }
void mrdamp_damper_reset(mrdamp_damper* damper) { damper->started = false; }

double mrdamp_damper_step(mrdamp_damper* m, double dt, double x, double v, double u) {
  State& s = m->state.s;
  double a = 0;
  if (!m->started) {
    Start(m->d, &s, x, v, u);
    m->started = true;
    m->seen = Observe(m->d, s, x, v, 0, u);
    m->sensor.Start(m->reading, m->seen.force);
  } else if (dt > 0) {
    if (s.line) s.line->Push(s.c.time, m->d.Clamp(u), Reach(m->d.p));
    Advance(m->d, &s, {m->x, m->v, x, v, dt}, u, u);
    Settle(m->d, &s, x, v, u);
    a = (v - m->v) / dt;
    m->seen = Observe(m->d, s, x, v, a, u);
    m->sensor.Step(m->reading, m->seen.force, dt);
  }
  m->x = x;
  m->v = v;
  return m->sensor.Read(m->reading);
}

double mrdamp_damper_value(const mrdamp_damper* m, int column) {
  switch (column) {
    case MRDAMP_FORCE: return m->sensor.Read(m->reading);
    case MRDAMP_REFERENCE: return m->seen.force;
    case MRDAMP_TRUE: return m->seen.damper;
    case MRDAMP_CURRENT: return m->seen.current;
    case MRDAMP_FIELD: return m->seen.field;
    case MRDAMP_TEMPERATURE: return m->seen.temperature;
    case MRDAMP_PISTON: return m->seen.piston;
    case MRDAMP_STATE: return m->seen.inner;
    default: return std::nan("");
  }
}

}  // extern "C"
