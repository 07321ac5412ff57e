#include "core/assembly.h"

#include <algorithm>
#include <cmath>

#include "core/solve.h"
#include "core/weight.h"
#include "effects/mechanics.h"

namespace mrdamp {

namespace {

// h / m times its slope up to which a damper is solved for from where the last step left it. Up to there the series
// below is within 1e-4 of core/weight.h's, and on the cable, the stiffest case at hand, the errors against a step of
// 10 us stay as they are; further up a damper that sticks needs its own trials.
constexpr double kSoft = 1;

}  // namespace

double Storey::Force(double x, double v, double dx, double* q) const {
  double dry = 0;
  if (friction > 0 && friction_width > 0) {
    dry = friction * std::tanh(v / friction_width);
  } else if (friction > 0) {
    const double sigma = friction / presliding;
    *q = SealFriction::Follow(*q, dx, friction, sigma);
    dry = sigma * *q;
  }
  const double over = lift > 0 ? std::max(stiffness * x + damping * v - lift, 0.0) : 0;
  return dry + one_sided * std::max(x, 0.0) + cubic * x * x * x + damping2 * std::fabs(v) * v - over;
}

Assembly::Assembly(const Linear& linear, const std::vector<Damper>& dampers, const std::vector<Storey>& storeys,
                   bool quick)
    : q(2 * linear.n(), 0.0), elements(dampers.size() + storeys.size()), bristle(storeys.size(), 0.0), linear_(linear),
      storeys_(storeys), tolerance_(quick ? 1e-5 : 1e-7), quick_(quick), free_(q.size()), next_(q.size()), blend_(elements.size()) {
  for (const Damper& d : dampers) sites.emplace_back(d);
}

void Assembly::Start(const double* command) {
  std::fill(q.begin(), q.end(), 0.0);
  std::fill(bristle.begin(), bristle.end(), 0.0);
  for (Element& e : elements) e = Element();
  for (std::size_t k = 0; k < sites.size(); k++) {
    Site& site = sites[k];
    site.acceleration = 0;
    mrdamp::Start(*site.d, &site.state.s, 0, 0, command[k]);
    Command(static_cast<int>(k), command[k]);
  }
}

void Assembly::Command(int damper, double command) {
  const Site& site = sites[damper];
  elements[damper].force =
      Observe(*site.d, site.state.s, Stroke(damper), Velocity(damper), site.acceleration, command).force;
}

bool Assembly::Arrives(int damper, double command) {
  if (!sites[damper].state.s.line || !CurrentJumps(*sites[damper].d)) return false;
  Command(damper, command);
  return true;
}

// Solves for the force at the step's end of one element while those of the others stand as they are.
void Assembly::Balance(int j, int sweep, double u0, double u1, double* moved, double* size) {
  const int count = static_cast<int>(elements.size()), n = linear_.n(), dampers = static_cast<int>(sites.size());
  const double h = linear_.h();
  Element& e = elements[j];
  double fx = linear_.Along(j, free_.data(), 0), fv = linear_.Along(j, free_.data(), n);
  for (int o = 0; o < count; o++) {
    const Element& other = elements[o];
    const Linear::Give& give = linear_.GiveOf(j, o);
    const double start = o == j ? e.force * (1 - blend_[j]) : other.force + blend_[o] * (other.next - other.force);
    const double end = o == j ? 0 : other.next;
    fx += give.hold_x * start + give.ramp_x * end;
    fv += give.hold_v * start + give.ramp_v * end;
  }
  const double x0 = linear_.Along(j, q.data(), 0), v0 = linear_.Along(j, q.data(), n);
  const auto [hold_x, hold_v, ramp_x, ramp_v] = linear_.GiveOf(j, j);
  double wv = ramp_v + blend_[j] * hold_v, wx = ramp_x + blend_[j] * hold_x, tried = 0, given = 0;
  double tried_before = 0, given_before = 0;
  int trials = 0;
  Site* const site = j < dampers ? &sites[j] : nullptr;
  // Force of the element when the step ends at velocity v.
  const auto law = [&](double v, double x) {
    tried_before = tried;
    given_before = given;
    tried = v;
    trials++;
    if (site) {
      site->trial.s.c = site->state.s.c;
      if (site->trial.s.past) site->trial.past = site->state.past;
      Advance(*site->d, &site->trial.s, {x0, v0, x, v, h}, u0, u1);
      return given = RodForce(*site->d, site->trial.s, x, v, (v - v0) / h, u1);
    }
    double held = bristle[j - dampers];
    return storeys_[j - dampers].Force(x, v, x - x0, &held);
  };
  if (!(ramp_v < 0)) {  // its ends do not give way: nothing to balance
    e.next = law(fv, fx);
    e.ready = true;
    return;
  }
  const auto residual = [&](double v) {
    const double along = (v - fv) / wv;
    return law(v, fx + wx * along) - along;
  };
  double guess = fv + wv * e.next, slope = (sweep > 0 && site ? e.rise : 0) - 1 / wv;
  const auto blend = [&](double share) {
    blend_[j] = share;
    fx -= hold_x * e.force * share;
    fv -= hold_v * e.force * share;
    wx += share * hold_x;
    wv += share * hold_v;
  };
  const bool soft = quick_ && site && -2 * ramp_v * e.rise < kSoft;  // false where the rise is unset
  if (sweep == 0 && soft) {
    const double stiff = -2 * ramp_v * e.rise;
    blend(stiff / 6 - stiff * stiff * stiff / 360);
    slope = e.rise - 1 / wv;
    guess = fv + wv * e.force;
  } else if (sweep == 0) {
    // The slope over all that the step may bring, from no force to the force without give (core/weight.h).
    const double f0 = law(fv, fx), dv = 2 * ramp_v * f0;
    if (std::fabs(dv) > 1e-12 * std::fabs(fv) + 1e-15) {
      const double f1 = law(fv + dv, fx + 2 * ramp_x * f0), free_v = fv;
      e.rise = std::max(0.0, (f1 - f0) / dv);
      blend(2 * EndWeight(-2 * ramp_v * e.rise) - 1);
      if (site) {  // along the secant of these two the balance is near
        slope = e.rise - 1 / wv;
        guess = fv + wv * (f0 + e.rise * (fv - free_v)) / (1 - e.rise * wv);
      }
    } else {
      e.rise = site ? std::max(0.0, Observe(*site->d, site->state.s, x0, v0, site->acceleration, u1).slope) : 0;
      slope += e.rise;
    }
  }
  const double solved = SolveIncreasing(residual, guess, slope, tolerance_ * std::fabs(e.next) + 1e-7);
  const double along = (solved - fv) / wv;
  e.ready = tried == solved;
  if (soft && trials > 1 && std::fabs(tried - tried_before) > 1e-6 * std::fabs(v0)) {
    e.rise = std::max(0.0, (given - given_before) / (tried - tried_before));
  }
  *moved = std::max(*moved, std::fabs(along - e.next));
  *size = std::max(*size, std::fabs(along));
  e.next = along;
}

void Assembly::Step(const double* load0, const double* load1, const double* u0, const double* u1, const double* settle) {
  const int count = static_cast<int>(elements.size()), n = linear_.n(), dampers = static_cast<int>(sites.size());
  const double h = linear_.h();
  linear_.Free(q.data(), load0, load1, free_.data());
  for (int k = 0; k < dampers; k++) Arrives(k, u0[k]);
  for (Element& e : elements) e.next = e.force;
  std::fill(blend_.begin(), blend_.end(), 0.0);
  for (int sweep = 0; sweep < (count > 1 ? 40 : 1); sweep++) {
    double moved = 0, size = 0;
    for (int j = 0; j < count; j++) {
      const bool damper = j < dampers;
      Balance(j, sweep, damper ? u0[j] : 0, damper ? u1[j] : 0, &moved, &size);
    }
    if (!(moved > 1e-8 * size)) break;
  }
  next_ = free_;
  for (int j = 0; j < count; j++) {
    Element& e = elements[j];
    e.start = e.force + blend_[j] * (e.next - e.force);
    linear_.Push(j, e.start, e.next, next_.data());
  }
  for (int j = 0; j < count; j++) {
    Element& e = elements[j];
    const double x0 = linear_.Along(j, q.data(), 0), v0 = linear_.Along(j, q.data(), n);
    const double x1 = linear_.Along(j, next_.data(), 0), v1 = linear_.Along(j, next_.data(), n);
    if (j >= dampers) {
      e.force = storeys_[j - dampers].Force(x1, v1, x1 - x0, &bristle[j - dampers]);
      continue;
    }
    Site& site = sites[j];
    State& s = site.state.s;
    // Where no other element acts, what was found is where the step ends.
    if (e.ready && count == 1 && !s.past) s.c = site.trial.s.c;
    else Advance(*site.d, &s, {x0, v0, x1, v1, h}, u0[j], u1[j]);
    Settle(*site.d, &s, x1, v1, settle[j]);
    site.acceleration = (v1 - v0) / h;
    // Exact for a force and a velocity that run straight.
    site.work = h * ((e.start * v0 + e.next * v1) / 3 + (e.start * v1 + e.next * v0) / 6);
    e.force = e.next;
  }
  q.swap(next_);
}

}  // namespace mrdamp
