#include "core/rows.h"

#include <algorithm>
#include <utility>

#include "core/packs.h"

namespace mrdamp {

namespace {

constexpr int kPiece = 2;  // rows that a thread takes at a time where they do not share packs: some us of work

bool IsIdeal(const SensorParams& p) {
  return p.gain == 1 && p.offset == 0 && !(p.leakage > 0) && !(p.lag > 0) && !(p.lag2 > 0) && !(p.share > 0) && p.settle == 0;
}

}  // namespace

Rows::Rows(RowsPlan plan, std::vector<Damper> dampers, std::vector<SensorParams> accelerometers)
    : plan_(std::move(plan)), dampers_(std::move(dampers)), accelerometers_(std::move(accelerometers)),
      linear_(plan_.system, plan_.period / plan_.steps), place_(plan_.place), drift_(plan_.drift) {
  for (Damper& d : dampers_) d.p.substep = std::max(d.p.substep, linear_.h());
  if (std::all_of(accelerometers_.begin(), accelerometers_.end(), IsIdeal)) accelerometers_.clear();
  const std::unique_ptr<Loop> loop = MakeLoop();
  size_ = loop->size();
  measurements_ = loop->measurements();
}

std::unique_ptr<Loop> Rows::MakeLoop() const {
  return std::make_unique<Loop>(linear_, plan_, place_, drift_, dampers_, accelerometers_);
}

void Rows::Pack(const MrdampPack* pack, Workspace* workspace) const {
  if (workspace->pack == pack) return;
  std::vector<double> params, readings;
  for (const Damper& d : dampers_) params.insert(params.end(), d.p.data(), d.p.data() + kParamCount);
  for (const SensorParams& p : accelerometers_) {
    const double* from = reinterpret_cast<const double*>(&p);
    readings.insert(readings.end(), from, from + sizeof p / sizeof(double));
  }
  void* loop = pack->loop(&linear_, &plan_, &place_, &drift_, this->dampers(), params.data(), kParamCount, dampers_[0].hold,
                          static_cast<int>(accelerometers_.size()), readings.data());
  workspace->packed = {loop, pack->free};
  workspace->pack = pack;
}

void Rows::Start(double seed, const mrdamp_load& load, double* state, double* out) const {
  MakeLoop()->Start(seed, {state, &load, nullptr, nullptr, out, nullptr}, noise());
}

void Rows::Step(int n, double* state, const mrdamp_load* loads, const double* commands, double* criteria, double* out,
                int threads, int lanes) {
  workspaces_.resize(std::max<std::size_t>(workspaces_.size(), std::clamp(threads, 1, Pool::kMost)));
  lanes = Widest(lanes);
  const MrdampPack* const pack = PackFor(dampers_, lanes);
  pool_.For(n, threads, pack ? lanes : kPiece, [&](int first, int last, int worker) {
    // Made by the thread that works in it, so that no two threads write into one line of the cache.
    Workspace& workspace = workspaces_[worker];
    MrdampRow rows[8];
    for (int at = first, count; at < last; at += count) {
      count = pack ? std::min(lanes, last - at) : 1;
      for (int l = 0; l < count; l++) {
        const auto row = static_cast<std::size_t>(at + l);
        rows[l] = {state + row * size_, &loads[row], commands + row * dampers(), criteria + row * this->criteria(),
                   out + row * measurements_, within_ ? within_ + row * plan_.steps * measurements_ : nullptr};
      }
      if (count > 1) {
        Pack(pack, &workspace);
        pack->step(workspace.packed.get(), rows, count, noise());
      } else {
        if (!workspace.alone) workspace.alone = MakeLoop();
        workspace.alone->Step(rows, 1, noise());
      }
    }
  });
}

}  // namespace mrdamp
