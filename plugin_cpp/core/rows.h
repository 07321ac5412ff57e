// Rows of closed loops: many copies of one structure with dampers, stepped a control period at a time.
#ifndef MRDAMP_CORE_ROWS_H_
#define MRDAMP_CORE_ROWS_H_

#include <memory>
#include <vector>

#include "core/loop.h"
#include "core/pool.h"

namespace mrdamp {

class Rows {
 public:
  // accelerometers: of each place of the plan.
  Rows(RowsPlan plan, std::vector<Damper> dampers, std::vector<SensorParams> accelerometers);

  int size() const { return size_; }
  int measurements() const { return measurements_; }
  int criteria() const {
    if (plan_.each) return 4 * plan_.place.n + 4;
    return plan_.sections.empty() ? int{MRDAMP_CRITERIA} : int{MRDAMP_CAR_CRITERIA};
  }
  Pool& pool() { return pool_; }
  int dampers() const { return static_cast<int>(dampers_.size()); }
  // Standard deviation of each measurement.
  void SetNoise(const double* deviation) { noise_.assign(deviation, deviation + measurements_); }
  // What every step also writes from now on, as in mrdamp.h, or null.
  void SetWithin(double* within) { within_ = within; }

  // A row at rest; seed: of its noise. out: its measurements without a command.
  void Start(double seed, const mrdamp_load& load, double* state, double* out) const;
  // n rows; state n x size(), commands n x dampers, criteria n x criteria(), out n x measurements. lanes: as in mrdamp.h.
  void Step(int n, double* state, const mrdamp_load* loads, const double* commands, double* criteria, double* out, int threads,
            int lanes);

 private:
  // Work space of one thread: for single rows, and for packs.
  struct Workspace {
    std::unique_ptr<Loop> alone;
    std::unique_ptr<void, void (*)(void*)> packed{nullptr, nullptr};
    const MrdampPack* pack = nullptr;
  };

  const double* noise() const { return noise_.empty() ? nullptr : noise_.data(); }
  std::unique_ptr<Loop> MakeLoop() const;
  void Pack(const MrdampPack* pack, Workspace* workspace) const;

  RowsPlan plan_;
  std::vector<Damper> dampers_;
  std::vector<SensorParams> accelerometers_;  // none where they are ideal
  Linear linear_;
  Sparse place_, drift_;
  int size_, measurements_;
  std::vector<double> noise_;  // empty: none
  double* within_ = nullptr;
  std::vector<Workspace> workspaces_;
  Pool pool_;
};

}  // namespace mrdamp

#endif  // MRDAMP_CORE_ROWS_H_
