#include "core/frame.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <vector>

#include "core/matrix.h"
#include "core/record.h"
#include "core/solve.h"
#include "core/weight.h"
#include "effects/mechanics.h"
#include "effects/sensor.h"

namespace mrdamp {

bool CheckFrame(const mrdamp_frame& f, char* error, int error_size) {
  const int n = f.storeys;
  if (n < 1 || n > 200) {
    std::snprintf(error, error_size, "structure: %d storeys; allowed are 1 to 200", n);
    return false;
  }
  const struct {
    const char* name;
    const double* value;
    double least;
    bool open;
  } rows[] = {{"mass_kg", f.mass, 0, true},        {"stiffness_n_m", f.stiffness, 0, true},
              {"damping_n_s_m", f.damping, 0, false}, {"friction", f.friction, 0, false},
              {"friction_width", f.friction_width, 0, false},
              {"friction_presliding", f.friction_presliding, 0, false},
              {"damping2", f.damping2, 0, false}};
  for (const auto& row : rows) {
    for (int i = 0; row.value && i < n; i++) {
      const double v = row.value[i];
      if (std::isfinite(v) && (row.open ? v > row.least : v >= row.least)) continue;
      std::snprintf(error, error_size, "structure: %s of storey %d is %g; it must be a finite number %s 0", row.name,
                    i + 1, v, row.open ? "above" : "of at least");
      return false;
    }
  }
  for (int i = 0; i < n; i++) {
    const double side = f.one_sided ? f.one_sided[i] : 0, cubic = f.cubic ? f.cubic[i] : 0;
    if (std::isfinite(side) && std::isfinite(cubic) && f.stiffness[i] + side > 0) continue;
    std::snprintf(error, error_size, "structure: one_sided, cubic of storey %d are %g, %g; allowed are finite numbers that"
                  " leave a stiffness above 0", i + 1, side, cubic);
    return false;
  }
  for (int i = 0; f.acc_ratio && i < n; i++) {
    if (f.acc_ratio[i] >= 0 && f.acc_ratio[i] < 1) continue;
    std::snprintf(error, error_size, "structure: acc_ratio of floor %d is %g; allowed are 0 up to, not including, 1", i + 1,
                  f.acc_ratio[i]);
    return false;
  }
  for (int i = 0; f.acc_settle_time && i < n; i++) {
    if (f.acc_settle_time[i] >= 0) continue;
    std::snprintf(error, error_size, "structure: acc_settle_time of floor %d is %g; allowed are numbers of at least 0", i + 1,
                  f.acc_settle_time[i]);
    return false;
  }
  if (f.damper_to >= 0 && (f.damper_from < 0 || f.damper_from == f.damper_to || f.damper_from > n || f.damper_to > n)) {
    std::snprintf(error, error_size, "damper_between: [%d, %d]; allowed are two different floors of 0 (ground) to %d",
                  f.damper_from, f.damper_to, n);
    return false;
  }
  return true;
}

namespace {

constexpr double kPresliding = 1e-5;  // m of drift over which dry friction in a storey builds up, unless given

// One scalar element that acts on the structure along a direction: the damper, or what else than a spring a storey is.
struct Element {
  int input;                   // column of the structure's inputs
  int upper, lower;            // floor indices, -1 the ground
  double force = 0, next = 0;  // at the start and the end of the step
  double rise = 0;             // N s/m, its slope over what the step may bring
  bool ready = false;          // the damper's trial state was stepped to the end that was found
};

class Structure {
 public:
  Structure(const mrdamp_frame& f, double dt) : n_(f.storeys), f_(f), a_(2 * n_, 2 * n_), hold_(2 * n_, n_ + 2), ramp_(2 * n_, n_ + 2) {
    const int inputs = n_ + 2, size = 2 * n_ + 2 * inputs;
    Matrix x(size, size);
    for (int i = 0; i < n_; i++) {
      x(i, n_ + i) = dt;
      for (int j = 0; j < n_; j++) {
        x(n_ + i, j) = -Chain(f.stiffness, i, j) / f.mass[i] * dt;
        x(n_ + i, n_ + j) = -Chain(f.damping, i, j) / f.mass[i] * dt;
      }
      for (int k = 0; k < inputs; k++) x(n_ + i, 2 * n_ + k) = Input(i, k) * dt;
    }
    for (int k = 0; k < inputs; k++) x(2 * n_ + k, 2 * n_ + inputs + k) = 1;
    const Matrix e = Exponential(x);
    for (int i = 0; i < 2 * n_; i++) {
      for (int j = 0; j < 2 * n_; j++) a_(i, j) = e(i, j);
      for (int k = 0; k < inputs; k++) {
        ramp_(i, k) = e(i, 2 * n_ + inputs + k);
        hold_(i, k) = e(i, 2 * n_ + k) - ramp_(i, k);
      }
    }
  }

  // Inputs: 0 ground acceleration, 1 damper, 2 + j the element of storey j. Acceleration of floor i per unit.
  double Input(int i, int k) const {
    if (k == 0) return -1;
    const int upper = k == 1 ? f_.damper_to - 1 : k - 2, lower = k == 1 ? f_.damper_from - 1 : k - 3;
    return ((i == upper ? -1.0 : 0.0) + (i == lower ? 1.0 : 0.0)) / f_.mass[i];
  }

  double Chain(const double* storey, int i, int j) const {
    if (i == j) return storey[i] + (i + 1 < n_ ? storey[i + 1] : 0);
    if (j == i + 1) return -storey[j];
    if (i == j + 1) return -storey[i];
    return 0;
  }

  // q1 without the elements: free motion and ground.
  void Free(const std::vector<double>& q, double ag0, double ag1, std::vector<double>* out) const {
    for (int i = 0; i < 2 * n_; i++) {
      double s = hold_(i, 0) * ag0 + ramp_(i, 0) * ag1;
      for (int j = 0; j < 2 * n_; j++) s += a_(i, j) * q[j];
      (*out)[i] = s;
    }
  }

  static double Along(const std::vector<double>& q, int offset, const Element& e) {
    return (e.upper >= 0 ? q[offset + e.upper] : 0) - (e.lower >= 0 ? q[offset + e.lower] : 0);
  }
  // How an element's end moves over a step, in x and v, for a force of another that is held and one that builds up.
  struct Give {
    double hold_x, hold_v, ramp_x, ramp_v;
  };
  Give Along(const Element& of, const Element& by) const {
    const auto along = [&](const Matrix& m, int offset) {
      return (of.upper >= 0 ? m(offset + of.upper, by.input) : 0) - (of.lower >= 0 ? m(offset + of.lower, by.input) : 0);
    };
    return {along(hold_, 0), along(hold_, n_), along(ramp_, 0), along(ramp_, n_)};
  }

  const Matrix& hold() const { return hold_; }
  const Matrix& ramp() const { return ramp_; }
  int n() const { return n_; }

 private:
  int n_;
  const mrdamp_frame& f_;
  Matrix a_, hold_, ramp_;
};

// Dry friction of a storey at the end of a step of drift dx that ends at velocity v; follows the bristle q.
double Dry(const mrdamp_frame& f, int storey, double v, double dx, double* q) {
  const double limit = f.friction ? f.friction[storey] : 0, width = f.friction_width ? f.friction_width[storey] : 0;
  if (!(limit > 0)) return 0;
  if (width > 0) return limit * std::tanh(v / width);
  const double drift = f.friction_presliding ? f.friction_presliding[storey] : 0;
  const double sigma = limit / (drift > 0 ? drift : kPresliding);
  *q = SealFriction::Follow(*q, dx, limit, sigma);
  return sigma * *q;
}

bool IsBent(const mrdamp_frame& f, int storey) {
  return (f.one_sided && f.one_sided[storey] != 0) || (f.cubic && f.cubic[storey] != 0) ||
         (f.damping2 && f.damping2[storey] > 0);
}

// What a storey has besides its stiffness and damping at the drift x and its rate v.
double Bent(const mrdamp_frame& f, int storey, double x, double v) {
  return (f.one_sided ? f.one_sided[storey] * std::max(x, 0.0) : 0) + (f.cubic ? f.cubic[storey] * x * x * x : 0) +
         (f.damping2 ? f.damping2[storey] * std::fabs(v) * v : 0);
}

}  // namespace

void RunFrame(const Damper& d, const mrdamp_frame& f, double dt, int samples, const double* ag, const double* u,
              double* out) {
  const int n = f.storeys;
  const int inner = std::max(1, static_cast<int>(std::ceil(dt / (0.5 * d.p.substep) - 1e-9)));
  const double h = dt / inner;
  const Structure structure(f, h);
  const bool damped = f.damper_to >= 0;

  std::vector<Element> elements;
  if (damped) elements.push_back({1, f.damper_to - 1, f.damper_from - 1});
  std::vector<double> bristle(n, 0.0);
  for (int j = 0; j < n; j++) {
    if ((f.friction && f.friction[j] > 0) || IsBent(f, j)) elements.push_back({2 + j, j, j - 1});
  }

  const std::size_t count = elements.size();
  std::vector<Structure::Give> gives;
  for (const Element& of : elements) {
    for (const Element& by : elements) gives.push_back(structure.Along(of, by));
  }

  std::vector<double> q(2 * n, 0.0), free(2 * n), next(2 * n), blend(count);
  OwnedState state(d), trial(d);
  const SensorParams reading = SensorParams::Of(d.p);
  Sensor sensor;
  std::vector<SensorParams> floor_params(n);
  std::vector<Sensor> floor_sensor(n);
  for (int i = 0; i < n; i++) {
    if (f.acc_gain) floor_params[i].gain = f.acc_gain[i];
    if (f.acc_offset) floor_params[i].offset = f.acc_offset[i];
    if (f.acc_leakage) floor_params[i].leakage = f.acc_leakage[i];
    if (f.acc_lag) floor_params[i].lag = f.acc_lag[i];
    if (f.acc_lag2) floor_params[i].lag2 = f.acc_lag2[i];
    if (f.acc_leakage_share) floor_params[i].share = f.acc_leakage_share[i];
    if (f.acc_leakage2) floor_params[i].leakage2 = f.acc_leakage2[i];
    if (f.acc_ratio) floor_params[i].ratio = f.acc_ratio[i];
    if (f.acc_settle) floor_params[i].settle = f.acc_settle[i];
    if (f.acc_settle_time && f.acc_settle_time[i] > 0) floor_params[i].settle_time = f.acc_settle_time[i];
  }
  if (damped) {
    Start(d, &state.s, 0, 0, u[0]);
    elements[0].force = Observe(d, state.s, 0, 0, 0, u[0]).force;
  }
  double acceleration_along = 0;
  Observation seen{};

  const auto record = [&](int k, double step) {
    double x = 0, v = 0;
    if (damped) {
      x = Structure::Along(q, 0, elements[0]);
      v = Structure::Along(q, n, elements[0]);
      seen = Observe(d, state.s, x, v, acceleration_along, u[k]);
    }
    for (int i = 0; i < n; i++) {
      double absolute = 0;
      for (int j = 0; j < n; j++) {
        absolute -= (structure.Chain(f.stiffness, i, j) * q[j] + structure.Chain(f.damping, i, j) * q[n + j]) / f.mass[i];
      }
      for (const Element& e : elements) {
        absolute += structure.Input(i, e.input) * (e.input == 1 ? seen.force : e.force);
      }
      if (k == 0) floor_sensor[i].Start(floor_params[i], absolute);
      else floor_sensor[i].Step(floor_params[i], absolute, step);
      out[static_cast<std::size_t>(i) * samples + k] = floor_sensor[i].Read(floor_params[i]);
      out[static_cast<std::size_t>(n + i) * samples + k] = q[i];
    }
    if (k == 0) sensor.Start(reading, seen.force);
    else sensor.Step(reading, seen.force, step);
    const double rest[] = {damped ? sensor.Read(reading) : 0, seen.damper, x, v, seen.current, seen.field, seen.temperature};
    for (int c = 0; c < 7; c++) out[static_cast<std::size_t>(2 * n + c) * samples + k] = rest[c];
  };

  record(0, 0);
  for (int k = 1; k < samples; k++) {
    const double command0 = u[k - 1], command1 = d.hold ? u[k - 1] : u[k];
    if (state.s.line) state.s.line->Push((d.hold ? k - 1 : k) * dt, d.Clamp(command1), Reach(d.p));
    if (trial.s.line) trial.line = state.line;
    for (int step = 0; step < inner; step++) {
      const double a = static_cast<double>(step) / inner, b = static_cast<double>(step + 1) / inner;
      const double u0 = command0 + (command1 - command0) * a, u1 = command0 + (command1 - command0) * b;
      const double g0 = ag[k - 1] + (ag[k] - ag[k - 1]) * a, g1 = ag[k - 1] + (ag[k] - ag[k - 1]) * b;
      structure.Free(q, g0, g1, &free);
      for (Element& e : elements) e.next = e.force;
      const int sweeps = count > 1 ? 40 : 1;
      std::fill(blend.begin(), blend.end(), 0.0);
      for (int sweep = 0; sweep < sweeps; sweep++) {
        double moved = 0, size = 0;
        for (std::size_t j = 0; j < count; j++) {
          Element& e = elements[j];
          const Structure::Give* give = &gives[j * count];
          double fx = Structure::Along(free, 0, e), fv = Structure::Along(free, n, e);
          for (std::size_t o = 0; o < count; o++) {
            const Element& other = elements[o];
            const double start = o == j ? e.force * (1 - blend[j]) : other.force + blend[o] * (other.next - other.force);
            const double end = o == j ? 0 : other.next;
            fx += give[o].hold_x * start + give[o].ramp_x * end;
            fv += give[o].hold_v * start + give[o].ramp_v * end;
          }
          const double x0 = Structure::Along(q, 0, e), v0 = Structure::Along(q, n, e);
          const auto [hold_x, hold_v, ramp_x, ramp_v] = give[j];
          double wv = ramp_v + blend[j] * hold_v, wx = ramp_x + blend[j] * hold_x, tried = 0;
          // Force of the element when the step ends at velocity v.
          const auto law = [&](double v, double x) {
            tried = v;
            if (e.input == 1) {
              trial.s.c = state.s.c;
              if (trial.s.past) trial.past = state.past;
              Advance(d, &trial.s, {x0, v0, x, v, h}, u0, u1);
              return RodForce(d, trial.s, x, v, (v - v0) / h, u1);
            }
            double q = bristle[e.input - 2];
            return Dry(f, e.input - 2, v, x - x0, &q) + Bent(f, e.input - 2, x, v);
          };
          const auto residual = [&](double v) {
            const double along = (v - fv) / wv;
            return law(v, fx + wx * along) - along;
          };
          double guess = fv + wv * e.next, slope = (sweep > 0 && e.input == 1 ? e.rise : 0) - 1 / wv;
          if (sweep == 0) {
            // The slope over all that the step may bring, from no force to the force without give (core/weight.h).
            const double f0 = law(fv, fx), dv = 2 * ramp_v * f0;
            if (std::fabs(dv) > 1e-12 * std::fabs(fv) + 1e-15) {
              const double f1 = law(fv + dv, fx + 2 * ramp_x * f0), free_v = fv;
              e.rise = std::max(0.0, (f1 - f0) / dv);
              blend[j] = 2 * EndWeight(-2 * ramp_v * e.rise) - 1;
              fx -= hold_x * e.force * blend[j];
              fv -= hold_v * e.force * blend[j];
              wx += blend[j] * hold_x;
              wv += blend[j] * hold_v;
              if (e.input == 1) {  // along the secant of these two the balance is near
                slope = e.rise - 1 / wv;
                guess = fv + wv * (f0 + e.rise * (fv - free_v)) / (1 - e.rise * wv);
              }
            } else {
              e.rise = e.input == 1 ? std::max(0.0, Observe(d, state.s, x0, v0, acceleration_along, u1).slope) : 0;
              slope += e.rise;
            }
          }
          const double solved = SolveIncreasing(residual, guess, slope, 1e-7 * std::fabs(e.next) + 1e-7);
          const double along = (solved - fv) / wv;
          e.ready = tried == solved;
          moved = std::max(moved, std::fabs(along - e.next));
          size = std::max(size, std::fabs(along));
          e.next = along;
        }
        if (!(moved > 1e-8 * size)) break;
      }
      next = free;
      for (std::size_t j = 0; j < count; j++) {
        const Element& e = elements[j];
        const double start = e.force + blend[j] * (e.next - e.force);
        for (int i = 0; i < 2 * n; i++) next[i] += structure.hold()(i, e.input) * start + structure.ramp()(i, e.input) * e.next;
      }
      for (Element& e : elements) {
        const double x0 = Structure::Along(q, 0, e), v0 = Structure::Along(q, n, e);
        const double x1 = Structure::Along(next, 0, e), v1 = Structure::Along(next, n, e);
        if (e.input == 1) {
          // Where no other element acts, what was found is where the step ends.
          if (e.ready && count == 1 && !state.s.past) state.s.c = trial.s.c;
          else Advance(d, &state.s, {x0, v0, x1, v1, h}, u0, u1);
          Settle(d, &state.s, x1, v1, step + 1 == inner ? u[k] : u1);
          acceleration_along = (v1 - v0) / h;
          e.force = e.next;
        } else {
          e.force = Dry(f, e.input - 2, v1, x1 - x0, &bristle[e.input - 2]) + Bent(f, e.input - 2, x1, v1);
        }
      }
      q.swap(next);
    }
    if (state.s.line && d.hold) state.s.line->Push(k * dt, d.Clamp(u[k]), Reach(d.p));
    record(k, dt);
  }
}

}  // namespace mrdamp
