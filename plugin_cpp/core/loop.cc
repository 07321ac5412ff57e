#include "core/loop.h"

#include <algorithm>
#include <cmath>

#include "core/random.h"
#include "core/shift.h"

namespace mrdamp {

Loop::Loop(const Linear& linear, const RowsPlan& plan, const Sparse& place, const Sparse& drift, const std::vector<Damper>& dampers,
           const std::vector<SensorParams>& accelerometers)
    : linear_(linear), plan_(plan), dampers_(dampers), accelerometers_(accelerometers), place_(place), drift_(drift),
      assembly_(linear, dampers, plan.storeys, true), sensors_(dampers.size()), floors_(accelerometers.size()),
      load0_(linear.loads()), load1_(linear.loads()), felt_(linear.loads()), forces_(linear.elements()), rate_(linear.n()), before_(linear.n()),
      from_(2 * linear.n()), current_(dampers.size()), filter_(plan.sections.size() / 5 * 2), each_(plan.each ? 4 * plan.place.n : 0), command_(dampers.size()),
      measured_(measurements()) {
  for (const Damper& d : dampers) readings_.push_back(SensorParams::Of(d.p));
}

// f(number) of every number of a row's state behind its header, in the order in which they are stored.
template <class F>
void Loop::EachPart(F&& f) {
  const auto all = [&](auto& store) {
    static_assert(sizeof(store) % sizeof(Real) == 0 || kLanes > 1);
    Real* at = reinterpret_cast<Real*>(&store);
    for (std::size_t i = 0; i < sizeof(store) / sizeof(Real); i++) f(at[i]);
  };
  for (Real& x : assembly_.q) f(x);
  for (Assembly::Element& e : assembly_.elements) {
    f(e.force);
    f(e.rise);
  }
  for (Real& b : assembly_.bristle) f(b);
  for (Real& x : filter_) f(x);
  for (std::size_t k = 0; k < assembly_.sites.size(); k++) {
    Assembly::Site& site = assembly_.sites[k];
    f(site.acceleration);
    all(site.state.s.c);
    all(sensors_[k]);
    if (site.state.s.line) all(*site.state.s.line);
    if (site.state.s.past) all(*site.state.s.past);
  }
  for (Sensor& s : floors_) all(s);
}

int Loop::size() {
  int count = kHeader;
  EachPart([&](Real&) { count++; });
  return count;
}

// Straight between the load's samples, held behind the last one; none from its last step on. `step`: after the period's
// first one.
void Loop::LoadAt(const MrdampRow* rows, double step, Real* out) const {
  const int many = linear_.loads();
  for (int i = 0; i < many; i++) {
    out[i] = Gather([&](int l) {
      const mrdamp_load& load = *rows[l].load;
      const double now = rows[l].state[kStep] + step;
      if (!(now < load.steps)) return 0.0;
      const double at = std::min(now * linear_.h() / load.sample_time, load.samples - 1.0);
      const int k = std::min(static_cast<int>(at), std::max(load.samples - 2, 0));
      const double* from = load.values + static_cast<std::size_t>(k) * many + i;
      const double to = load.samples > 1 ? from[many] : from[0];
      return from[0] + (at - k) * (to - from[0]);
    });
  }
}

// Accelerations that accelerometers feel at present; load0 holds the load.
void Loop::Rates() {
  for (std::size_t j = 0; j < forces_.size(); j++) forces_[j] = assembly_.elements[j].force;
  for (int l = 0; l < linear_.loads(); l++) felt_[l] = l < plan_.grounds ? Real(0) : load0_[l];
  linear_.Rates<Real>(assembly_.q.data(), forces_.data(), felt_.data(), rate_.data());
}

// Adds the step's start: square of the filtered acceleration, of the load on the tyre over that at rest less one, of the
// stroke; the largest |stroke|; whether the tyre is off the road.
void Loop::Ride(Real* sums) {
  Real y = place_.Row(1, before_.data());
  for (std::size_t k = 0; k < plan_.sections.size() / 5; k++) {
    const double* c = &plan_.sections[5 * k];
    Real* past = &filter_[2 * k];
    const Real x = y;
    y = c[0] * x + past[0];
    past[0] = c[1] * x - c[3] * y + past[1];
    past[1] = c[2] * x - c[4] * y;
  }
  const Storey& tyre = plan_.storeys[0];
  const Real* from = from_.data();
  const Real pull = tyre.stiffness * drift_.Row(0, from) + tyre.damping * drift_.Row(0, from + linear_.n());
  const Real load = max(tyre.lift - pull, 0.0), dynamic = load / tyre.lift - 1, stroke = drift_.Row(1, from);
  sums[0] += y * y;
  sums[1] += dynamic * dynamic;
  sums[2] += stroke * stroke;
  sums[3] = max(sums[3], fabs(stroke));
  sums[4] += Select(load == 0, 1, 0);
}

// Adds the step's start at every place.
void Loop::Each() {
  const int places = plan_.place.n;
  for (int i = 0; i < places; i++) {
    const Real of[] = {place_.Row(i, before_.data()), place_.Row(i, from_.data())};
    for (const int k : {0, 1}) {
      Real* at = &each_[2 * k * places + i];
      at[0] += of[k] * of[k];
      at[places] = max(at[places], fabs(of[k]));
    }
  }
}

// A drift at a share s of the last step, by its values and velocities at both ends.
Real Loop::DriftWithin(int j, double s) const {
  const int n = linear_.n();
  const Real x0 = drift_.Row(j, from_.data());
  if (s == 0) return x0;
  const Real* q = assembly_.q.data();
  const double h = linear_.h();
  const Real x1 = drift_.Row(j, q), v0 = h * drift_.Row(j, from_.data() + n), v1 = h * drift_.Row(j, q + n);
  return x0 + s * (v0 + s * (3 * (x1 - x0) - 2 * v0 - v1 + s * (2 * (x0 - x1) + v0 + v1)));
}

// Fills measured_: without the accelerometers' errors.
void Loop::Measure(const MrdampRow* rows, const double* noise) {
  const Assembly& a = assembly_;
  const int n = linear_.n(), places = plan_.place.n, many = dampers();
  const Real* q = a.q.data();
  Real* at = measured_.data();
  for (int i = 0; i < places; i++) *at++ = place_.Row(i, rate_.data());
  for (int i = 0; i < places; i++) *at++ = place_.Row(i, q);
  for (int i = 0; i < places; i++) *at++ = place_.Row(i, q + n);
  for (int i = 0; i < plan_.drift.n; i++) *at++ = drift_.Row(i, q);
  for (int k = 0; k < many; k++) {
    const Damper& d = dampers_[k];
    const Real v = a.Velocity(k);
    Real acceleration = 0;
    if (Misread(d.p)) {
      for (int i = 0; i < n; i++) acceleration += plan_.system.stroke(k, i) * rate_[i];
      for (int i = 0; i < n; i++) {
        for (int l = 0; l < plan_.grounds; l++) acceleration += plan_.system.stroke(k, i) * plan_.system.load(i, l) * load0_[l];
      }
    }
    at[k] = sensors_[k].Read(readings_[k]);
    at[many + k] = a.elements[k].force;
    at[2 * many + k] = Recorded(d.p, a.Stroke(k), v, acceleration);
    at[3 * many + k] = v;
    at[4 * many + k] = CurrentNow(d, a.sites[k].state.s, command_[k]);
  }
  if (!noise) return;
  for (int i = 0; i < measurements(); i++) {
    if (!(noise[i] > 0)) continue;
    measured_[i] += noise[i] * Gather([&](int l) {
      const std::uint64_t key = Mix(static_cast<std::uint64_t>(rows[l].state[kSeed]));
      const auto drawn = static_cast<std::uint64_t>(rows[l].state[kDrawn]);
      return Normal(key, drawn * static_cast<std::uint64_t>(measurements()) + i);
    });
  }
}

void Loop::Start(double seed, const MrdampRow& row, const double* noise) {
  row.state[kStep] = row.state[kDrawn] = 0;
  row.state[kSeed] = seed;
  for (Real& u : command_) u = 0;
  assembly_.Start(command_.data());
  LoadAt(&row, 0, load0_.data());
  for (int k = 0; k < dampers(); k++) sensors_[k].Start(readings_[k], assembly_.elements[k].force);
  Rates();
  Measure(&row, noise);
  for (std::size_t i = 0; i < floors_.size(); i++) {
    const Real ideal = place_.Row(static_cast<int>(i), rate_.data()), disturbance = measured_[i] - ideal;
    floors_[i].Start(accelerometers_[i], measured_[i] - disturbance);
    measured_[i] = floors_[i].Read(accelerometers_[i]) + disturbance;
  }
  double* at = row.state + kHeader;
  EachPart([&](Real& x) { *at++ = Head(x); });
  for (int i = 0; i < measurements(); i++) row.measured[i] = Head(measured_[i]);
  row.state[kDrawn] = 1;
}

void Loop::Step(const MrdampRow* rows, int count, const double* noise) {
  Assembly& a = assembly_;
  const int n = linear_.n(), many = dampers(), places = plan_.place.n;
  const double h = linear_.h();
  MrdampRow each[kLanes];
  for (int l = 0; l < kLanes; l++) each[l] = rows[l < count ? l : 0];
  int at = kHeader;
  EachPart([&](Real& x) {
    x = Gather([&](int l) { return each[l].state[at]; });
    at++;
  });
  for (int k = 0; k < many; k++) {
    command_[k] = Gather([&](int l) { return each[l].command[k]; });
    Assembly::Site& site = a.sites[k];
    State& s = site.state.s;
    if (s.line) {
      s.line->Push(Head(s.c.time), Head(site.d->Clamp(command_[k])), Reach(site.d->p));
      site.trial.line = *s.line;
    }
    Settle(*site.d, &s, a.Stroke(k), a.Velocity(k), command_[k]);
    a.Command(k, command_[k]);
    sensors_[k].Step(readings_[k], a.elements[k].force, 0);
  }
  Real first = 0, second = 0, share = 0, power = 0, current = 0, energy = 0, ride[5] = {};
  const bool rides = !plan_.sections.empty();
  for (Real& x : each_) x = 0;
  const Real* command = command_.data();
  LoadAt(each, 0, load0_.data());
  Rates();
  for (int step = 0; step < plan_.steps; step++) {
    if (rows[0].within) {
      Measure(each, nullptr);
      for (int i = 0; i < measurements(); i++) {
        Scatter(measured_[i], count, [&](int l, double x) { rows[l].within[step * measurements() + i] = x; });
      }
    }
    before_ = rate_;
    from_ = a.q;
    for (int k = 0; k < many; k++) current_[k] = fabs(CurrentNow(*a.sites[k].d, a.sites[k].state.s, command[k]));
    LoadAt(each, step + 1, load1_.data());
    a.Step(load0_.data(), load1_.data(), command, command, command);
    for (int k = 0; k < many; k++) {
      sensors_[k].Step(readings_[k], a.elements[k].force, h);
      if (a.Arrives(k, command[k])) sensors_[k].Step(readings_[k], a.elements[k].force, 0);
    }
    load0_.swap(load1_);
    Rates();
    if (rides) Ride(ride);
    else if (plan_.each) Each();
    else if (!plan_.peaks) {
      for (int i = 0; i < n; i++) second += before_[i] * before_[i];
      for (int i = 0; i < n; i++) first += a.q[i] * a.q[i];
    }
    for (int k = 0; k < many; k++) {
      const Real end = fabs(CurrentNow(*a.sites[k].d, a.sites[k].state.s, command[k]));
      for (int i = 0; i < plan_.instants; i++) {
        const Real size = current_[k] + (end - current_[k]) * i / plan_.instants, part = size / plan_.command_max[k];
        share += part;
        power += part * part;
        current += size;
      }
      energy += a.sites[k].work;
    }
    for (int i = 0; plan_.peaks && i < plan_.instants; i++) {
      const double s = static_cast<double>(i) / plan_.instants;
      for (int j = 0; j < plan_.drift.n; j++) first = max(first, fabs(DriftWithin(j, s)));
      for (int j = 0; j < places; j++) {
        const Real x0 = place_.Row(j, before_.data()), x1 = i > 0 ? place_.Row(j, rate_.data()) : x0;
        second = max(second, fabs(x0 + s * (x1 - x0)));
      }
    }
  }
  const double of_steps = 1.0 / plan_.steps, of_dampers = of_steps / (plan_.instants * many);
  if (!plan_.peaks) {
    first *= plan_.square * of_steps;
    second *= plan_.square * of_steps;
  }
  // max passes over what is no number.
  const Mask lost = !isfinite(a.q[0] + a.q[n]);
  criteria_.clear();
  const auto add = [&](Real x) { criteria_.push_back(x); };
  if (plan_.each) {
    for (std::size_t i = 0; i < each_.size(); i++) add(Select(lost, kUnset, i / places % 2 == 0 ? each_[i] * of_steps : each_[i]));
  } else if (rides) {
    for (const int i : {0, 1, 2}) add(ride[i] * of_steps);
    add(ride[3]);
    add(ride[4] * of_steps);
  } else {
    add(Select(lost, kUnset, first));
    add(Select(lost, kUnset, second));
  }
  for (const Real& x : {share * of_dampers, power * of_dampers, current * of_dampers, energy}) add(x);
  for (std::size_t i = 0; i < criteria_.size(); i++) Scatter(criteria_[i], count, [&](int l, double x) { rows[l].criteria[i] = x; });
  Measure(each, noise);
  for (std::size_t i = 0; i < floors_.size(); i++) {
    const Real ideal = place_.Row(static_cast<int>(i), rate_.data()), disturbance = measured_[i] - ideal;
    floors_[i].Step(accelerometers_[i], ideal, plan_.period);
    measured_[i] = floors_[i].Read(accelerometers_[i]) + disturbance;
  }
  for (int i = 0; i < measurements(); i++) Scatter(measured_[i], count, [&](int l, double x) { rows[l].measured[i] = x; });
  at = kHeader;
  EachPart([&](Real& x) {
    Scatter(x, count, [&](int l, double one) { rows[l].state[at] = one; });
    at++;
  });
  for (int l = 0; l < count; l++) {
    rows[l].state[kStep] += plan_.steps;
    rows[l].state[kDrawn] += 1;
  }
}

}  // namespace mrdamp
