#include "core/frame.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <tuple>
#include <utility>
#include <vector>

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
  for (const auto& [name, mass, stiffness, damping] : {std::tuple{"sway", f.sway_mass, f.sway_stiffness, f.sway_damping},
                                                       std::tuple{"rock", f.rock_mass, f.rock_stiffness, f.rock_damping}}) {
    if (stiffness == 0 || (stiffness > 0 && mass > 0 && damping >= 0 && std::isfinite(stiffness + mass + damping))) continue;
    std::snprintf(error, error_size, "structure: %s_mass, _stiffness, _damping are %g, %g, %g; allowed are finite numbers, the"
                  " mass above 0, the others at least 0", name, mass, stiffness, damping);
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

FrameSystem::FrameSystem(const mrdamp_frame& f, int dampers, const int* between)
    : system(0, 0, 0) {
  const int n = f.storeys;
  std::vector<int> acting;
  for (int j = 0; j < n; j++) {
    Storey s;
    if (f.friction) s.friction = f.friction[j];
    if (f.friction_width) s.friction_width = f.friction_width[j];
    if (f.friction_presliding && f.friction_presliding[j] > 0) s.presliding = f.friction_presliding[j];
    if (f.one_sided) s.one_sided = f.one_sided[j];
    if (f.cubic) s.cubic = f.cubic[j];
    if (f.damping2) s.damping2 = f.damping2[j];
    if (!s.Acts()) continue;
    storeys.push_back(s);
    acting.push_back(j);
  }
  // Coordinates after the floors: the foundation's displacement, the drift of every storey by its rotation.
  const int sway = f.sway_stiffness > 0 ? n : -1, rock = f.rock_stiffness > 0 ? n + (sway > 0) : -1;
  const int size = n + (sway > 0) + (rock > 0);
  std::vector<double> mass(f.mass, f.mass + n);
  if (sway > 0) mass.push_back(f.sway_mass);
  if (rock > 0) mass.push_back(f.rock_mass);
  system = LinearSystem(size, 1, dampers + static_cast<int>(acting.size()));
  // Elongation between two floors, 0 the foundation, per unit of the coordinates.
  const auto between_floors = [&](int from, int to) {
    std::vector<double> along(size);
    for (const auto& [floor, sign] : {std::pair{to, 1}, std::pair{from, -1}}) {
      const int at = floor > 0 ? floor - 1 : sway;
      if (at >= 0) along[at] += sign;
    }
    if (rock > 0) along[rock] = from - to;
    return along;
  };
  const auto add = [&](const std::vector<double>& along, double stiffness, double damping) {
    for (int i = 0; i < size; i++) {
      for (int j = 0; j < size; j++) {
        if (along[i] == 0 || along[j] == 0) continue;
        system.rate(i, j) -= along[i] * along[j] * stiffness / mass[i];
        system.rate(i, size + j) -= along[i] * along[j] * damping / mass[i];
      }
    }
  };
  for (int j = 0; j < n; j++) add(between_floors(j, j + 1), f.stiffness[j], f.damping[j]);
  std::vector<double> alone(size);
  if (sway > 0) alone[sway] = 1, add(alone, f.sway_stiffness, f.sway_damping), alone[sway] = 0;
  if (rock > 0) alone[rock] = 1, add(alone, f.rock_stiffness, f.rock_damping);
  for (int i = 0; i < size; i++) system.load(i, 0) = i == rock ? 0 : -1;
  for (int k = 0; k < system.elements; k++) {
    const int from = k < dampers ? between[2 * k] : acting[k - dampers];
    const int to = k < dampers ? between[2 * k + 1] : acting[k - dampers] + 1;
    const std::vector<double> along = between_floors(from, to);
    for (int i = 0; i < size; i++) {
      system.stroke(k, i) = along[i];
      system.push(i, k) = -along[i] / mass[i];
    }
  }
}

std::vector<SensorParams> FloorSensors(const mrdamp_frame& f) {
  std::vector<SensorParams> found(f.storeys);
  for (int i = 0; i < f.storeys; i++) {
    if (f.acc_gain) found[i].gain = f.acc_gain[i];
    if (f.acc_offset) found[i].offset = f.acc_offset[i];
    if (f.acc_leakage) found[i].leakage = f.acc_leakage[i];
    if (f.acc_lag) found[i].lag = f.acc_lag[i];
    if (f.acc_lag2) found[i].lag2 = f.acc_lag2[i];
    if (f.acc_leakage_share) found[i].share = f.acc_leakage_share[i];
    if (f.acc_leakage2) found[i].leakage2 = f.acc_leakage2[i];
    if (f.acc_ratio) found[i].ratio = f.acc_ratio[i];
    if (f.acc_settle) found[i].settle = f.acc_settle[i];
    if (f.acc_settle_time && f.acc_settle_time[i] > 0) found[i].settle_time = f.acc_settle_time[i];
  }
  return found;
}

void RunFrame(const Damper& d, const mrdamp_frame& f, double dt, int samples, const double* ag, const double* u,
              double* out) {
  const int n = f.storeys;
  const bool damped = f.damper_to >= 0;
  const int between[] = {f.damper_from, f.damper_to};
  const FrameSystem frame(f, damped, between);
  // The structure alone is exact at any step.
  const double within = frame.system.elements > 0 ? 0.5 * d.p.substep : dt;
  const int inner = std::max(1, static_cast<int>(std::ceil(dt / within - 1e-9)));
  const Linear linear(frame.system, dt / inner);
  const std::vector<Damper> dampers(damped, d);
  Assembly a(linear, dampers, frame.storeys);
  a.Start(u);

  const SensorParams reading = SensorParams::Of(d.p);
  Sensor sensor;
  const std::vector<SensorParams> floor_params = FloorSensors(f);
  std::vector<Sensor> floor_sensor(n);
  std::vector<double> forces(a.elements.size()), absolute(linear.n());
  Observation seen{};

  const bool jumps = damped && CurrentJumps(d);
  const auto rates = [&] {
    for (std::size_t j = 0; j < forces.size(); j++) forces[j] = a.elements[j].force;
    linear.Rates<double>(a.q.data(), forces.data(), nullptr, absolute.data());
  };
  const auto record = [&](int k, double step) {
    double x = 0, v = 0;
    if (jumps && k > 0) {  // the signals just before the new command
      rates();
      for (int i = 0; i < n; i++) floor_sensor[i].Step(floor_params[i], absolute[i], step);
      sensor.Step(reading, forces[0], step);
      step = 0;
    }
    if (damped) {
      x = a.Stroke(0);
      v = a.Velocity(0);
      seen = Observe(d, a.sites[0].state.s, x, v, a.sites[0].acceleration, u[k]);
      if (jumps) a.elements[0].force = seen.force;
    }
    rates();
    for (int i = 0; i < n; i++) {
      if (k == 0) floor_sensor[i].Start(floor_params[i], absolute[i]);
      else floor_sensor[i].Step(floor_params[i], absolute[i], step);
      out[static_cast<std::size_t>(i) * samples + k] = floor_sensor[i].Read(floor_params[i]);
      out[static_cast<std::size_t>(n + i) * samples + k] = a.q[i];
    }
    if (k == 0) sensor.Start(reading, seen.force);
    else sensor.Step(reading, seen.force, step);
    const double rest[] = {damped ? sensor.Read(reading) : 0, seen.damper, x, v, seen.current, seen.field, seen.temperature};
    for (int c = 0; c < 7; c++) out[static_cast<std::size_t>(2 * n + c) * samples + k] = rest[c];
  };

  record(0, 0);
  for (int k = 1; k < samples; k++) {
    const double command0 = u[k - 1], command1 = d.hold ? u[k - 1] : u[k];
    DelayLine* const line = damped ? a.sites[0].state.s.line : nullptr;
    if (line) {
      line->Push((d.hold ? k - 1 : k) * dt, d.Clamp(command1), Reach(d.p));
      a.sites[0].trial.line = *line;
    }
    for (int step = 0; step < inner; step++) {
      const double from = static_cast<double>(step) / inner, to = static_cast<double>(step + 1) / inner;
      const double u0 = command0 + (command1 - command0) * from, u1 = command0 + (command1 - command0) * to;
      const double g0 = ag[k - 1] + (ag[k] - ag[k - 1]) * from, g1 = ag[k - 1] + (ag[k] - ag[k - 1]) * to;
      a.Step(&g0, &g1, &u0, &u1, step + 1 == inner ? &u[k] : &u1);
    }
    if (line && d.hold) line->Push(k * dt, d.Clamp(u[k]), Reach(d.p));
    record(k, dt);
  }
}

}  // namespace mrdamp
