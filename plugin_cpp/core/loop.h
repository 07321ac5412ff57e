// A pack of closed loops of one structure with dampers, stepped a control period at a time, each in a state of its own.
#ifndef MRDAMP_CORE_LOOP_H_
#define MRDAMP_CORE_LOOP_H_

#include <vector>

#include "core/assembly.h"
#include "core/lane.h"
#include "effects/sensor.h"

namespace mrdamp {

// Structure and measurements of every row. Its layout does not hang on the number type.
struct RowsPlan {
  LinearSystem system{0, 0, 0};
  std::vector<Storey> storeys;
  double period = 0;  // s, of control
  int steps = 1;      // per period
  int instants = 1;   // of a step at which criteria are evaluated, from its start
  // Points of measurement: places x n, and how many loads, from the first on, accelerate the ground that coordinates are
  // relative to: accelerometers are not.
  Matrix place{0, 0};
  int grounds = 1;
  Matrix drift{0, 0};  // drifts x n, also measured
  // Criteria: largest |drift| and |acceleration|, or mean squares of the coordinates and of their accelerations, or,
  // if there are `sections`, those of a ride: b0 b1 b2 a1 a2 of each section of a filter of the second place's
  // acceleration. Drift 0 is then the tyre's, on storey 0, and drift 1 the stroke.
  bool peaks = true;
  bool each = false;  // in place of these, of every place, see mrdamp_linear
  std::vector<double> sections;
  double square = 1;  // factor on these
  std::vector<double> command_max;  // reference of the currents
};

// Work space of one thread. The state of a row is plain doubles, complete except for loads and commands.
class Loop {
 public:
  enum Header { kStep, kSeed, kDrawn, kHeader };

  // All must outlive it. place, drift: the plan's, without zeros. accelerometers: none where they are ideal.
  Loop(const Linear& linear, const RowsPlan& plan, const Sparse& place, const Sparse& drift, const std::vector<Damper>& dampers,
       const std::vector<SensorParams>& accelerometers);

  int size();  // doubles of a row's state
  int measurements() const { return 3 * plan_.place.n + plan_.drift.n + 5 * dampers(); }
  int dampers() const { return static_cast<int>(dampers_.size()); }

  // One row at rest, from its load and seed; `noise`: standard deviation of each measurement, or null.
  void Start(double seed, const MrdampRow& row, const double* noise);
  // A control period of the first `count` rows.
  void Step(const MrdampRow* rows, int count, const double* noise);

 private:
  template <class F>
  void EachPart(F&& f);
  void LoadAt(const MrdampRow* rows, double step, Real* out) const;
  void Rates();
  void Ride(Real* sums);
  void Each();
  Real DriftWithin(int j, double s) const;
  void Measure(const MrdampRow* rows, const double* noise);

  const Linear& linear_;
  const RowsPlan& plan_;
  const std::vector<Damper>& dampers_;
  const std::vector<SensorParams>& accelerometers_;
  std::vector<SensorParams> readings_;
  const Sparse &place_, &drift_;
  Assembly assembly_;
  std::vector<Sensor> sensors_, floors_;
  std::vector<Real> load0_, load1_, felt_, forces_;
  std::vector<Real> rate_, before_, from_, current_;  // present rates; three of the step's start
  std::vector<Real> filter_;  // of a ride: two for each section
  std::vector<Real> each_;    // of every place: mean squares and peaks of acceleration, then of displacement
  std::vector<Real> criteria_;
  std::vector<Real> command_, measured_;
};

}  // namespace mrdamp

#endif  // MRDAMP_CORE_LOOP_H_
