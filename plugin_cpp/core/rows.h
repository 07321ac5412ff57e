// Rows of closed loops: many copies of one structure with dampers, stepped a control period at a time.
#ifndef MRDAMP_CORE_ROWS_H_
#define MRDAMP_CORE_ROWS_H_

#include <cstdint>
#include <memory>
#include <vector>

#include "core/assembly.h"
#include "core/pool.h"
#include "effects/sensor.h"
#include "mrdamp.h"

namespace mrdamp {

// Structure, dampers and measurements of every row.
struct RowsPlan {
  LinearSystem system{0, 0, 0};
  std::vector<Damper> dampers;
  std::vector<Storey> storeys;
  double period = 0;  // s, of control
  int steps = 1;      // per period
  int instants = 1;   // of a step at which criteria are evaluated, from its start
  // Points of measurement: places x n, their accelerometers, and whether these include the load's acceleration.
  Matrix place{0, 0};
  std::vector<SensorParams> accelerometers;
  bool loaded = false;
  Matrix drift{0, 0};  // drifts x n, also measured
  // Criteria: largest |drift| and |acceleration|, or mean squares of the coordinates and of their accelerations, or,
  // if there are `sections`, those of a ride: b0 b1 b2 a1 a2 of each section of a filter of the second place's
  // acceleration. Drift 0 is then the tyre's, on storey 0, and drift 1 the stroke.
  bool peaks = true;
  std::vector<double> sections;
  double square = 1;  // factor on these
  std::vector<double> command_max;  // reference of the currents
};

// The state of a row is `size()` plain doubles, complete except for loads and commands.
class Rows {
 public:
  explicit Rows(RowsPlan plan);

  int size() const { return size_; }
  int measurements() const { return measurements_; }
  int criteria() const { return plan_.sections.empty() ? int{MRDAMP_CRITERIA} : int{MRDAMP_CAR_CRITERIA}; }
  int loads() const { return linear_.loads(); }
  int dampers() const { return static_cast<int>(plan_.dampers.size()); }
  // Standard deviation of each measurement.
  void SetNoise(const double* deviation) { noise_.assign(deviation, deviation + measurements_); }

  // A row at rest; seed: of its noise. out: its measurements without a command.
  void Start(double seed, const mrdamp_load& load, double* state, double* out) const;
  // n rows; state n x size(), commands n x dampers, criteria n x criteria(), out n x measurements.
  void Step(int n, double* state, const mrdamp_load* loads, const double* commands, double* criteria, double* out,
            int threads);

 private:
  // Work space of one thread.
  struct Desk {
    Assembly assembly;
    std::vector<Sensor> sensors, accelerometers;
    std::vector<double> load0, load1, forces;
    std::vector<double> rate, before, from, current;  // present rates; three of the step's start
    std::vector<double> filter;  // of a ride: two for each section
  };
  enum Header { kStep, kSeed, kDrawn, kHeader };

  Desk MakeDesk() const;
  void Load(const double* state, Desk* w) const;
  void Store(const Desk& w, double* state) const;
  void LoadAt(const mrdamp_load& load, double step, double* out) const;
  void Rates(Desk* w) const;
  void Ride(double* sums, Desk* w) const;
  double DriftWithin(int j, double s, const Desk& w) const;
  void Measure(const double* header, const double* command, const Desk& w, double* out) const;
  void StepOne(double* state, const mrdamp_load& load, const double* command, double* criteria, double* out, Desk* w) const;

  RowsPlan plan_;
  Linear linear_;
  Sparse place_, drift_;
  std::vector<SensorParams> readings_;
  bool ideal_;
  int size_, measurements_;
  std::vector<double> noise_;  // empty: none
  std::vector<std::unique_ptr<Desk>> desks_;
  Pool pool_;
};

}  // namespace mrdamp

#endif  // MRDAMP_CORE_ROWS_H_
