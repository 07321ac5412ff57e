#include "core/rows.h"

#include <cmath>
#include <new>
#include <utility>
#include <vector>

#include "capi/make.h"
#include "core/frame.h"

using namespace mrdamp;

struct mrdamp_rows {
  Rows rows;
};

namespace {

constexpr int kMostDampers = 100, kMostSections = 20;

// What frames and modes share; false and a line on failure.
bool ReadDampers(const mrdamp_dampers& from, double period, int steps, int instants, RowsPlan* plan, std::vector<Damper>* dampers,
          char* err, int size) {
  if (from.count < 1 || from.count > kMostDampers) {
    return !Fail(err, size, std::to_string(from.count) + " dampers; allowed are 1 to " + std::to_string(kMostDampers));
  }
  if (!(period > 0) || !std::isfinite(period)) return !Fail(err, size, "the control period must be above 0");
  if (steps < 1 || instants < 1) {
    return !Fail(err, size, std::to_string(steps) + " steps in a control period, criteria at " + std::to_string(instants) +
                                " instants of each; allowed are 1 or more");
  }
  plan->period = period;
  plan->steps = steps;
  plan->instants = instants;
  for (int k = 0; k < from.count; k++) {
    Damper d;
    const mrdamp_narx* net = from.net ? from.net[k] : nullptr;
    if (!Make(from.law[k], from.params + static_cast<std::size_t>(k) * kParamCount, net, nullptr, &d, err, size)) return false;
    if (!(from.command_max[k] > 0) || !std::isfinite(from.command_max[k])) {
      return !Fail(err, size, "command_max of damper " + std::to_string(k + 1) + " must be a finite number above 0");
    }
    dampers->push_back(d);
    plan->command_max.push_back(from.command_max[k]);
  }
  return true;
}

}  // namespace

extern "C" {

mrdamp_rows* mrdamp_rows_frame(const mrdamp_frame* frame, const mrdamp_dampers* dampers, const int* between, double period,
                               int steps, int instants, char* err, int err_size) {
  RowsPlan plan;
  std::vector<Damper> made;
  mrdamp_frame f = *frame;
  if (!ReadDampers(*dampers, period, steps, instants, &plan, &made, err, err_size)) return nullptr;
  for (int k = 0; k < dampers->count; k++) {
    f.damper_from = between[2 * k];
    f.damper_to = between[2 * k + 1];
    if (f.damper_to < 0) f.damper_from = -1, f.damper_to = 0;  // here a damper must stand somewhere
    if (!CheckFrame(f, err, err_size)) return nullptr;
  }
  FrameSystem found(f, dampers->count, between);
  const int n = f.storeys;
  plan.system = found.system;
  plan.storeys = found.storeys;
  plan.place = plan.drift = Matrix(n, found.system.n);
  for (int i = 0; i < n; i++) {
    plan.place(i, i) = plan.drift(i, i) = 1;
    if (i > 0) plan.drift(i, i - 1) = -1;
  }
  return new (std::nothrow) mrdamp_rows{Rows(std::move(plan), std::move(made), FloorSensors(f))};
}

mrdamp_rows* mrdamp_rows_linear(const mrdamp_linear* linear, const mrdamp_dampers* dampers, double period, int steps,
                                char* err, int err_size) {
  RowsPlan plan;
  std::vector<Damper> made;
  const mrdamp_linear& s = *linear;
  const int n = s.coordinates;
  if (n < 1 || n > 500 || s.loads < 1 || s.places < 0 || s.grounds < 0 || s.grounds > s.loads) {
    Fail(err, err_size, std::to_string(n) + " coordinates, " + std::to_string(s.loads) + " loads, " + std::to_string(s.places) +
                            " places, " + std::to_string(s.grounds) + " loads of the ground; allowed are 1 to 500, 1 or more, 0 or more, 0 to all");
    return nullptr;
  }
  if (!ReadDampers(*dampers, period, steps, 1, &plan, &made, err, err_size)) return nullptr;
  plan.system = LinearSystem(n, s.loads, dampers->count);
  plan.place = Matrix(s.places, n);
  plan.drift = Matrix(0, n);
  bool finite = s.mass >= 0 && std::isfinite(s.mass);
  const std::pair<Matrix*, const double*> parts[] = {{&plan.system.rate, s.rate}, {&plan.system.load, s.load},
                                                     {&plan.system.stroke, s.stroke}, {&plan.system.push, s.push}, {&plan.place, s.at}};
  for (const auto& [to, from] : parts) {
    for (int i = 0; i < to->n; i++) {
      for (int j = 0; j < to->m; j++) {
        (*to)(i, j) = from[static_cast<std::size_t>(i) * to->m + j];
        finite = finite && std::isfinite((*to)(i, j));
      }
    }
  }
  if (!finite) {
    Fail(err, err_size, "the structure's matrices must be finite, and its mass at least 0");
    return nullptr;
  }
  plan.grounds = s.grounds;
  plan.peaks = false;
  plan.each = s.mass == 0;
  if (!plan.each) plan.square = 1 / s.mass;
  return new (std::nothrow) mrdamp_rows{Rows(std::move(plan), std::move(made), {})};
}

mrdamp_rows* mrdamp_rows_car(const mrdamp_car* car, const mrdamp_dampers* dampers, double period, int steps, int instants,
                             char* err, int err_size) {
  RowsPlan plan;
  std::vector<Damper> made;
  const mrdamp_car& c = *car;
  for (const double v : {c.body, c.wheel, c.stiffness, c.tyre_stiffness, c.weight}) {
    if (v > 0 && std::isfinite(v)) continue;
    Fail(err, err_size, "car: masses, stiffnesses and weight must be finite numbers above 0");
    return nullptr;
  }
  if (!(c.damping >= 0 && c.tyre_damping >= 0 && std::isfinite(c.damping) && std::isfinite(c.tyre_damping))) {
    Fail(err, err_size, "car: damping must be a finite number of at least 0");
    return nullptr;
  }
  if (dampers->count != 1 || c.sections < 1 || c.sections > kMostSections) {
    Fail(err, err_size, "car: " + std::to_string(dampers->count) + " dampers, " + std::to_string(c.sections) +
                            " sections of the weighting; allowed are 1, 1 to " + std::to_string(kMostSections));
    return nullptr;
  }
  if (!ReadDampers(*dampers, period, steps, instants, &plan, &made, err, err_size)) return nullptr;
  plan.system = LinearSystem(2, 1, 2);
  LinearSystem& s = plan.system;
  const double k[] = {c.stiffness, c.damping}, tyre[] = {c.tyre_stiffness, c.tyre_damping};
  for (const int i : {0, 1}) {  // of displacements, then of velocities
    s.rate(0, 2 * i) = -(k[i] + tyre[i]) / c.wheel;
    s.rate(0, 2 * i + 1) = k[i] / c.wheel;
    s.rate(1, 2 * i) = k[i] / c.body;
    s.rate(1, 2 * i + 1) = -k[i] / c.body;
    s.load(i, 0) = -1;
  }
  s.stroke(0, 0) = -1;
  s.stroke(0, 1) = s.stroke(1, 0) = 1;
  s.push(0, 0) = 1 / c.wheel;
  s.push(1, 0) = -1 / c.body;
  s.push(0, 1) = -1 / c.wheel;
  Storey road;
  road.lift = c.weight;
  road.stiffness = c.tyre_stiffness;
  road.damping = c.tyre_damping;
  plan.storeys = {road};
  plan.place = plan.drift = Matrix(2, 2);
  plan.place(0, 0) = plan.place(1, 1) = plan.drift(0, 0) = plan.drift(1, 1) = 1;
  plan.drift(1, 0) = -1;
  plan.peaks = false;
  plan.sections.assign(c.weighting, c.weighting + 5 * c.sections);
  return new (std::nothrow) mrdamp_rows{Rows(std::move(plan), std::move(made), {})};
}

void mrdamp_rows_free(mrdamp_rows* rows) { delete rows; }
int mrdamp_rows_size(const mrdamp_rows* rows) { return rows->rows.size(); }
int mrdamp_rows_measurements(const mrdamp_rows* rows) { return rows->rows.measurements(); }
int mrdamp_rows_criteria(const mrdamp_rows* rows) { return rows->rows.criteria(); }

int mrdamp_rows_noise(mrdamp_rows* rows, const double* deviation, char* err, int err_size) {
  for (int i = 0; i < rows->rows.measurements(); i++) {
    if (deviation[i] >= 0 && std::isfinite(deviation[i])) continue;
    return Fail(err, err_size, "noise of measurement " + std::to_string(i + 1) + " must be a finite number of at least 0");
  }
  rows->rows.SetNoise(deviation);
  return 0;
}

void mrdamp_rows_within(mrdamp_rows* rows, double* within) { rows->rows.SetWithin(within); }

void mrdamp_rows_start(const mrdamp_rows* rows, double seed, const mrdamp_load* load, double* state, double* measurements) {
  rows->rows.Start(seed, *load, state, measurements);
}

void mrdamp_rows_step(mrdamp_rows* rows, int n, double* state, const mrdamp_load* loads, const double* commands,
                      double* criteria, double* measurements, int threads, int lanes) {
  rows->rows.Step(n, state, loads, commands, criteria, measurements, threads, lanes);
}

void mrdamp_rows_step_each(mrdamp_rows* const* rows, int n, double* const* states, const mrdamp_load* const* loads,
                           const double* commands, double* criteria, double* measurements, int threads) {
  const Rows& one = rows[0]->rows;
  rows[0]->rows.pool().For(n, threads, 1, [&](int first, int last, int) {
    for (int k = first; k < last; k++) {
      rows[k]->rows.Step(1, states[k], loads[k], commands + k * one.dampers(), criteria + k * one.criteria(),
                         measurements + k * one.measurements(), 1, 1);
    }
  });
}

}  // extern "C"
