#include "core/record.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>
#include <utility>

#include "core/packs.h"
#include "core/shift.h"

namespace mrdamp {

std::vector<double> Differentiate(const double* x, int n, double dt) {
  std::vector<double> v(n);
  for (int i = 1; i + 1 < n; i++) v[i] = (x[i + 1] - x[i - 1]) / (2 * dt);
  if (n > 2) {
    v[0] = (-3 * x[0] + 4 * x[1] - x[2]) / (2 * dt);
    v[n - 1] = (3 * x[n - 1] - 4 * x[n - 2] + x[n - 3]) / (2 * dt);
  }
  return v;
}

namespace {

// A record begins in motion where the mean speed of its first kStart (s) is more than kMoving of its RMS; not within
// kMiddle of the middle of its range, from where a machine's program begins, and a cut record seldom does. A sample is
// like the start up to a sum of squares of kNear, of displacement over range, velocity over RMS, command over range.
// The run-in is kPath times the range long: two cycles, in which a hysteresis forgets.
constexpr double kStart = 0.02, kMoving = 0.05, kMiddle = 0.02, kNear = 0.1, kPath = 4;

void RunPack(const Job* const* jobs, int count, int lanes, int ncol, const int* columns) {
  MrdampLane lane[8];
  std::unique_ptr<double[]> moved[8];
  Damper plain[8];
  const double dt = jobs[0]->record->dt;
  for (int k = 0; k < count; k++) {
    const Job& job = *jobs[k];
    const RecordView& r = *job.record;
    plain[k] = *job.d;
    lane[k] = {plain[k].p.data(), r.n, r.x, r.v, r.a, r.u, job.before.from, job.before.to, job.out};
    if (const Params& p = job.d->p; Misread(p)) {
      moved[k].reset(new double[static_cast<std::size_t>(r.n) * (p.motion_lag_width > 0 ? kRoom : kMotion)]);
      TakeBack(p.channel_shift_d, p.motion_lag_tau, p.motion_lag_width, dt, moved[k].get(), &lane[k]);
    }
  }
  const MrdampPack* pack = count > 1 ? PackFor({plain[0]}, lanes) : nullptr;
  if (pack) pack->run(lane, count, dt, plain[0].hold, ncol, columns);
  else Run(plain[0], lane, 1, dt, ncol, columns);
}

}  // namespace

RunIn FindRunIn(const RecordView& r) {
  double low = r.x[0], high = r.x[0], mean = 0, fast = 0, least = r.u[0], most = r.u[0];
  for (int i = 0; i < r.n; i++) {
    low = std::min(low, r.x[i]);
    high = std::max(high, r.x[i]);
    least = std::min(least, r.u[i]);
    most = std::max(most, r.u[i]);
    fast += r.v[i] * r.v[i] / r.n;
  }
  const double range = high - low, speed = std::sqrt(fast), span = most > least ? most - least : 1;
  const int begin = std::min(std::max(3, static_cast<int>(std::lround(kStart / r.dt))), r.n / 4);
  for (int i = 0; i < begin; i++) mean += std::fabs(r.v[i]) / begin;
  if (!(mean > kMoving * speed)) return {};
  if (std::fabs(r.x[0] - 0.5 * (low + high)) < kMiddle * range) return {};
  double best = kNear;
  RunIn found;
  for (int i = r.n / 3; i + 1 < r.n; i++) {
    if (r.v[i] * r.v[0] < 0) continue;
    const double x = (r.x[i] - r.x[0]) / range, v = (r.v[i] - r.v[0]) / speed, u = (r.u[i] - r.u[0]) / span;
    const double off = x * x + v * v + u * u;
    if (off > best) continue;
    best = off;
    found.to = i;
  }
  double path = 0;
  for (found.from = found.to; found.from > 0 && path < kPath * range; found.from--) {
    path += std::fabs(r.x[found.from] - r.x[found.from - 1]);
  }
  return found;
}

void RunJobs(const std::vector<Job>& jobs, int ncol, const int* columns, int threads, int lanes) {
  lanes = Widest(lanes);
  std::vector<std::pair<std::string, const Job*>> order;  // jobs whose texts are equal may share a pack; empty: alone
  for (const Job& job : jobs) {
    std::string text = lanes > 1 ? Alike(*job.d) : "";
    if (!text.empty()) {
      text.append(reinterpret_cast<const char*>(&job.record->dt), sizeof job.record->dt);
      text += job.before.to > job.before.from ? 'm' : 'r';
    }
    order.emplace_back(std::move(text), &job);
  }
  // Long ones first: what a pack waits for is alike, and threads end together.
  std::stable_sort(order.begin(), order.end(), [](const auto& a, const auto& b) {
    return a.first != b.first ? a.first < b.first : a.second->record->n > b.second->record->n;
  });
  std::vector<std::vector<const Job*>> packs;
  for (std::size_t k = 0; k < order.size(); k++) {
    // A step of a pack takes half as long again as that of one damper: what is much longer than the rest goes alone.
    const bool alike = k > 0 && !order[k].first.empty() && order[k].first == order[k - 1].first;
    const bool joins = alike && 3 * order[k].second->record->n > packs.back()[0]->record->n;
    if (!joins || packs.back().size() == static_cast<std::size_t>(lanes)) packs.emplace_back();
    packs.back().push_back(order[k].second);
  }
  ParallelFor(static_cast<int>(packs.size()), threads, [&](int k) {
    RunPack(packs[k].data(), static_cast<int>(packs[k].size()), lanes, ncol, columns);
  });
}

}  // namespace mrdamp
