#include "core/rows.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <type_traits>
#include <utility>

#include "core/random.h"

namespace mrdamp {

namespace {

constexpr int kPiece = 2;  // rows that a thread takes at a time: some us of work

// The stores are plain doubles, as their sizes assert.
template <class Store>
constexpr int Doubles() {
  static_assert(std::is_trivially_copyable_v<Store> && sizeof(Store) % sizeof(double) == 0);
  return sizeof(Store) / sizeof(double);
}
template <class Store>
const double* Take(const double* from, Store* to) {
  std::memcpy(static_cast<void*>(to), from, sizeof(Store));
  return from + Doubles<Store>();
}
template <class Store>
double* Give(const Store& from, double* to) {
  std::memcpy(to, static_cast<const void*>(&from), sizeof(Store));
  return to + Doubles<Store>();
}

bool IsIdeal(const SensorParams& p) {
  return p.gain == 1 && p.offset == 0 && !(p.leakage > 0) && !(p.lag > 0) && !(p.lag2 > 0) && !(p.share > 0) && p.settle == 0;
}

}  // namespace

Rows::Rows(RowsPlan plan)
    : plan_(std::move(plan)), linear_(plan_.system, plan_.period / plan_.steps), place_(plan_.place), drift_(plan_.drift) {
  for (Damper& d : plan_.dampers) {
    d.p.substep = std::max(d.p.substep, linear_.h());
    readings_.push_back(SensorParams::Of(d.p));
  }
  ideal_ = std::all_of(plan_.accelerometers.begin(), plan_.accelerometers.end(), IsIdeal);
  const int elements = linear_.elements();
  size_ = kHeader + 2 * linear_.n() + 2 * elements + static_cast<int>(plan_.storeys.size() + plan_.sections.size() / 5 * 2);
  for (const Damper& d : plan_.dampers) {
    size_ += 1 + Doubles<ChainState>() + Doubles<Sensor>() + (HasDelay(d.p) ? Doubles<DelayLine>() : 0) +
             (d.law == Law::kNarx ? Doubles<NarxHistory>() : 0);
  }
  if (!ideal_) size_ += Doubles<Sensor>() * plan_.place.n;
  measurements_ = 3 * plan_.place.n + plan_.drift.n + 5 * dampers();
}

Rows::Desk Rows::MakeDesk() const {
  const auto loads = static_cast<std::size_t>(linear_.loads()), n = static_cast<std::size_t>(linear_.n());
  return {Assembly(linear_, plan_.dampers, plan_.storeys, true), std::vector<Sensor>(plan_.dampers.size()),
          std::vector<Sensor>(ideal_ ? 0 : plan_.place.n), std::vector<double>(loads), std::vector<double>(loads),
          std::vector<double>(linear_.elements()), std::vector<double>(n), std::vector<double>(n),
          std::vector<double>(2 * n), std::vector<double>(plan_.dampers.size()),
          std::vector<double>(plan_.sections.size() / 5 * 2)};
}

void Rows::Load(const double* state, Desk* w) const {
  Assembly& a = w->assembly;
  const double* at = state + kHeader;
  for (double& q : a.q) q = *at++;
  for (Assembly::Element& e : a.elements) {
    e.force = *at++;
    e.rise = *at++;
  }
  for (double& b : a.bristle) b = *at++;
  for (double& f : w->filter) f = *at++;
  for (std::size_t k = 0; k < a.sites.size(); k++) {
    Assembly::Site& site = a.sites[k];
    site.acceleration = *at++;
    at = Take(at, &site.state.s.c);
    at = Take(at, &w->sensors[k]);
    if (site.state.s.line) at = Take(at, site.state.s.line);
    if (site.state.s.past) at = Take(at, site.state.s.past);
  }
  for (Sensor& s : w->accelerometers) at = Take(at, &s);
}

void Rows::Store(const Desk& w, double* state) const {
  const Assembly& a = w.assembly;
  double* at = state + kHeader;
  for (const double q : a.q) *at++ = q;
  for (const Assembly::Element& e : a.elements) {
    *at++ = e.force;
    *at++ = e.rise;
  }
  for (const double b : a.bristle) *at++ = b;
  for (const double f : w.filter) *at++ = f;
  for (std::size_t k = 0; k < a.sites.size(); k++) {
    const Assembly::Site& site = a.sites[k];
    *at++ = site.acceleration;
    at = Give(site.state.s.c, at);
    at = Give(w.sensors[k], at);
    if (site.state.s.line) at = Give(*site.state.s.line, at);
    if (site.state.s.past) at = Give(*site.state.s.past, at);
  }
  for (const Sensor& s : w.accelerometers) at = Give(s, at);
}

// Straight between the load's samples, held behind the last one; none from its last step on.
void Rows::LoadAt(const mrdamp_load& load, double step, double* out) const {
  const int many = linear_.loads();
  if (!(step < load.steps)) {
    std::fill(out, out + many, 0.0);
    return;
  }
  const double at = std::min(step * linear_.h() / load.sample_time, load.samples - 1.0);
  const int k = std::min(static_cast<int>(at), std::max(load.samples - 2, 0));
  const double w = at - k;
  const double* from = load.values + static_cast<std::size_t>(k) * many;
  const double* to = load.samples > 1 ? from + many : from;
  for (int i = 0; i < many; i++) out[i] = from[i] + w * (to[i] - from[i]);
}

// Rates of the coordinates' velocities at present; load0 holds the load.
void Rows::Rates(Desk* w) const {
  const Assembly& a = w->assembly;
  for (std::size_t j = 0; j < a.elements.size(); j++) w->forces[j] = a.elements[j].force;
  linear_.Rates(a.q.data(), w->forces.data(), plan_.loaded ? w->load0.data() : nullptr, w->rate.data());
}

// Adds the step's start: square of the filtered acceleration, of the load on the tyre over that at rest less one, of the
// stroke; the largest |stroke|; whether the tyre is off the road.
void Rows::Ride(double* sums, Desk* w) const {
  double y = place_.Row(1, w->before.data());
  for (std::size_t k = 0; k < plan_.sections.size() / 5; k++) {
    const double* c = &plan_.sections[5 * k];
    double* past = &w->filter[2 * k];
    const double x = y;
    y = c[0] * x + past[0];
    past[0] = c[1] * x - c[3] * y + past[1];
    past[1] = c[2] * x - c[4] * y;
  }
  const Storey& tyre = plan_.storeys[0];
  const double* from = w->from.data();
  const double pull = tyre.stiffness * drift_.Row(0, from) + tyre.damping * drift_.Row(0, from + linear_.n());
  const double load = std::max(tyre.lift - pull, 0.0), dynamic = load / tyre.lift - 1, stroke = drift_.Row(1, from);
  sums[0] += y * y;
  sums[1] += dynamic * dynamic;
  sums[2] += stroke * stroke;
  sums[3] = std::max(sums[3], std::fabs(stroke));
  sums[4] += load == 0;
}

// A drift at a share s of the last step, by its values and velocities at both ends.
double Rows::DriftWithin(int j, double s, const Desk& w) const {
  const int n = linear_.n();
  const double x0 = drift_.Row(j, w.from.data());
  if (s == 0) return x0;
  const double x1 = drift_.Row(j, w.assembly.q.data()), h = linear_.h();
  const double v0 = h * drift_.Row(j, w.from.data() + n), v1 = h * drift_.Row(j, w.assembly.q.data() + n);
  return x0 + s * (v0 + s * (3 * (x1 - x0) - 2 * v0 - v1 + s * (2 * (x0 - x1) + v0 + v1)));
}

void Rows::Measure(const double* header, const double* command, const Desk& w, double* out) const {
  const Assembly& a = w.assembly;
  const int n = linear_.n(), places = plan_.place.n, many = dampers();
  const double* q = a.q.data();
  double* at = out;
  for (int i = 0; i < places; i++) *at++ = place_.Row(i, w.rate.data());
  for (int i = 0; i < places; i++) *at++ = place_.Row(i, q);
  for (int i = 0; i < places; i++) *at++ = place_.Row(i, q + n);
  for (int i = 0; i < plan_.drift.n; i++) *at++ = drift_.Row(i, q);
  for (int k = 0; k < many; k++) {
    const Damper& d = plan_.dampers[k];
    const double v = a.Velocity(k), shift = d.p.channel_shift_d;
    double acceleration = 0;
    if (shift != 0) {
      for (int i = 0; i < n; i++) acceleration += plan_.system.stroke(k, i) * w.rate[i];
      // A frame's coordinates are relative to the ground, its accelerometers are not.
      if (!plan_.loaded) {
        for (int i = 0; i < n; i++) {
          for (int l = 0; l < linear_.loads(); l++) acceleration += plan_.system.stroke(k, i) * plan_.system.load(i, l) * w.load0[l];
        }
      }
    }
    at[k] = w.sensors[k].Read(readings_[k]);
    at[many + k] = a.elements[k].force;
    at[2 * many + k] = a.Stroke(k) - shift * (v - 0.5 * shift * acceleration);  // x(t - d), to second order
    at[3 * many + k] = v;
    at[4 * many + k] = CurrentNow(d, a.sites[k].state.s, command[k]);
  }
  if (noise_.empty()) return;
  const std::uint64_t key = Mix(static_cast<std::uint64_t>(header[kSeed]));
  const auto drawn = static_cast<std::uint64_t>(header[kDrawn]);
  for (int i = 0; i < measurements_; i++) {
    if (noise_[i] > 0) out[i] += noise_[i] * Normal(key, drawn * static_cast<std::uint64_t>(measurements_) + i);
  }
}

void Rows::Start(double seed, const mrdamp_load& load, double* state, double* out) const {
  std::fill(state, state + size_, 0.0);
  state[kSeed] = seed;
  Desk w = MakeDesk();
  const std::vector<double> none(dampers(), 0.0);
  w.assembly.Start(none.data());
  LoadAt(load, 0, w.load0.data());
  for (int k = 0; k < dampers(); k++) w.sensors[k].Start(readings_[k], w.assembly.elements[k].force);
  Rates(&w);
  Measure(state, none.data(), w, out);
  for (std::size_t i = 0; i < w.accelerometers.size(); i++) {
    const double noise = out[i] - place_.Row(static_cast<int>(i), w.rate.data());
    w.accelerometers[i].Start(plan_.accelerometers[i], out[i] - noise);
    out[i] = w.accelerometers[i].Read(plan_.accelerometers[i]) + noise;
  }
  Store(w, state);
  state[kDrawn] = 1;
}

void Rows::StepOne(double* state, const mrdamp_load& load, const double* command, double* criteria, double* out,
                   Desk* w) const {
  Assembly& a = w->assembly;
  const int n = linear_.n(), many = dampers(), places = plan_.place.n;
  const double h = linear_.h(), begin = state[kStep];
  Load(state, w);
  for (int k = 0; k < many; k++) {
    Assembly::Site& site = a.sites[k];
    State& s = site.state.s;
    if (s.line) {
      s.line->Push(s.c.time, site.d->Clamp(command[k]), Reach(site.d->p));
      site.trial.line = *s.line;
    }
    Settle(*site.d, &s, a.Stroke(k), a.Velocity(k), command[k]);
    a.Command(k, command[k]);
    w->sensors[k].Step(readings_[k], a.elements[k].force, 0);
  }
  double first = 0, second = 0, share = 0, power = 0, current = 0, energy = 0, ride[5] = {};
  const bool rides = !plan_.sections.empty();
  LoadAt(load, begin, w->load0.data());
  Rates(w);
  for (int step = 0; step < plan_.steps; step++) {
    w->before = w->rate;
    w->from = a.q;
    for (int k = 0; k < many; k++) w->current[k] = std::fabs(CurrentNow(*a.sites[k].d, a.sites[k].state.s, command[k]));
    LoadAt(load, begin + step + 1, w->load1.data());
    a.Step(w->load0.data(), w->load1.data(), command, command, command);
    for (int k = 0; k < many; k++) {
      w->sensors[k].Step(readings_[k], a.elements[k].force, h);
      if (a.Arrives(k, command[k])) w->sensors[k].Step(readings_[k], a.elements[k].force, 0);
    }
    w->load0.swap(w->load1);
    Rates(w);
    if (rides) Ride(ride, w);
    else if (!plan_.peaks) {
      for (int i = 0; i < n; i++) second += w->before[i] * w->before[i];
      for (int i = 0; i < n; i++) first += a.q[i] * a.q[i];
    }
    for (int k = 0; k < many; k++) {
      const double end = std::fabs(CurrentNow(*a.sites[k].d, a.sites[k].state.s, command[k]));
      for (int i = 0; i < plan_.instants; i++) {
        const double size = w->current[k] + (end - w->current[k]) * i / plan_.instants, part = size / plan_.command_max[k];
        share += part;
        power += part * part;
        current += size;
      }
      energy += a.sites[k].work;
    }
    for (int i = 0; plan_.peaks && i < plan_.instants; i++) {
      const double s = static_cast<double>(i) / plan_.instants;
      for (int j = 0; j < plan_.drift.n; j++) first = std::max(first, std::fabs(DriftWithin(j, s, *w)));
      for (int j = 0; j < places; j++) {
        const double x0 = place_.Row(j, w->before.data()), x1 = i > 0 ? place_.Row(j, w->rate.data()) : x0;
        second = std::max(second, std::fabs(x0 + s * (x1 - x0)));
      }
    }
  }
  const double of_steps = 1.0 / plan_.steps, of_dampers = of_steps / (plan_.instants * many);
  if (!plan_.peaks) {
    first *= plan_.square * of_steps;
    second *= plan_.square * of_steps;
  }
  // std::max passes over what is no number.
  if (!std::isfinite(a.q[0] + a.q[n])) first = second = kUnset;
  double* at = criteria;
  if (rides) {
    for (const int i : {0, 1, 2}) *at++ = ride[i] * of_steps;
    *at++ = ride[3];
    *at++ = ride[4] * of_steps;
  } else {
    *at++ = first;
    *at++ = second;
  }
  for (const double each : {share * of_dampers, power * of_dampers, current * of_dampers, energy}) *at++ = each;
  state[kStep] = begin + plan_.steps;
  Measure(state, command, *w, out);
  for (int i = 0; i < static_cast<int>(w->accelerometers.size()); i++) {
    const double ideal = place_.Row(i, w->rate.data()), noise = out[i] - ideal;
    w->accelerometers[i].Step(plan_.accelerometers[i], ideal, plan_.period);
    out[i] = w->accelerometers[i].Read(plan_.accelerometers[i]) + noise;
  }
  Store(*w, state);
  state[kDrawn] += 1;
}

void Rows::Step(int n, double* state, const mrdamp_load* loads, const double* commands, double* criteria, double* out,
                int threads) {
  desks_.resize(std::max<std::size_t>(desks_.size(), std::clamp(threads, 1, Pool::kMost)));
  pool_.For(n, threads, kPiece, [&](int first, int last, int worker) {
    // Made by the thread that works in it, so that no two threads write into one line of the cache.
    std::unique_ptr<Desk>& desk = desks_[worker];
    if (!desk) desk = std::make_unique<Desk>(MakeDesk());
    for (int row = first; row < last; row++) {
      const auto at = static_cast<std::size_t>(row);
      StepOne(state + at * size_, loads[at], commands + at * dampers(), criteria + at * this->criteria(),
              out + at * measurements_, desk.get());
    }
  });
}

}  // namespace mrdamp
