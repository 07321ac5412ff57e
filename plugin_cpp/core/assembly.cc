#include "core/assembly.h"

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

Real Storey::Force(Real x, Real v, Real dx, Real* q) const {
  Real dry = 0;
  if (friction > 0 && friction_width > 0) {
    dry = friction * tanh(v / friction_width);
  } else if (friction > 0) {
    const Real sigma = friction / presliding;
    *q = SealFriction::Follow(*q, dx, friction, sigma);
    dry = sigma * *q;
  }
  const Real over = lift > 0 ? max(stiffness * x + damping * v - lift, 0.0) : 0;
  return dry + one_sided * max(x, 0.0) + cubic * x * x * x + damping2 * fabs(v) * v - over;
}

Assembly::Assembly(const Linear& linear, const std::vector<Damper>& dampers, const std::vector<Storey>& storeys,
                   bool quick)
    : q(2 * linear.n(), 0.0), elements(dampers.size() + storeys.size()), bristle(storeys.size(), 0.0), linear_(linear),
      storeys_(storeys), tolerance_(quick ? 1e-5 : 1e-7), quick_(quick), free_(q.size()), next_(q.size()), blend_(elements.size()) {
  for (const Damper& d : dampers) sites.emplace_back(d);
}

void Assembly::Start(const Real* command) {
  for (Real& x : q) x = 0;
  for (Real& b : bristle) b = 0;
  for (Element& e : elements) e = Element();
  for (std::size_t k = 0; k < sites.size(); k++) {
    Site& site = sites[k];
    site.acceleration = 0;
    mrdamp::Start(*site.d, &site.state.s, 0, 0, command[k]);
    Command(static_cast<int>(k), command[k]);
  }
}

void Assembly::Command(int damper, Real command) {
  const Site& site = sites[damper];
  elements[damper].force =
      Observe(*site.d, site.state.s, Stroke(damper), Velocity(damper), site.acceleration, command).force;
}

bool Assembly::Arrives(int damper, Real command) {
  if (!sites[damper].state.s.line || !CurrentJumps(*sites[damper].d)) return false;
  Command(damper, command);
  return true;
}

// Solves for the force at the step's end of one element while those of the others stand as they are; where `here`.
void Assembly::Balance(int j, int sweep, Real u0, Real u1, Mask here, Real* moved, Real* size) {
  const int count = static_cast<int>(elements.size()), n = linear_.n(), dampers = static_cast<int>(sites.size());
  const double h = linear_.h();
  Element& e = elements[j];
  Real fx = linear_.Along(j, free_.data(), 0), fv = linear_.Along(j, free_.data(), n);
  for (int o = 0; o < count; o++) {
    const Element& other = elements[o];
    const Linear::Compliance& compliance = linear_.ComplianceOf(j, o);
    const Real start = o == j ? e.force * (1 - blend_[j]) : other.force + blend_[o] * (other.next - other.force);
    const Real end = o == j ? 0 : other.next;
    fx += compliance.hold_x * start + compliance.ramp_x * end;
    fv += compliance.hold_v * start + compliance.ramp_v * end;
  }
  const Real x0 = linear_.Along(j, q.data(), 0), v0 = linear_.Along(j, q.data(), n);
  const auto [hold_x, hold_v, ramp_x, ramp_v] = linear_.ComplianceOf(j, j);
  Real wv = ramp_v + blend_[j] * hold_v, wx = ramp_x + blend_[j] * hold_x, tried = 0, given = 0;
  Real tried_before = 0, given_before = 0, trials = 0;
  Site* const site = j < dampers ? &sites[j] : nullptr;
  // Force of the element when the step ends at velocity v.
  const auto law = [&](Real v, Real x, Mask asked) {
    tried_before = Select(asked, tried, tried_before);
    given_before = Select(asked, given, given_before);
    tried = Select(asked, v, tried);
    trials += Select(asked, 1, 0);
    if (site) {
      const Held held(&site->trial.s, asked);
      site->trial.s.c = site->state.s.c;
      if (site->trial.s.past) site->trial.past = site->state.past;
      Advance(*site->d, &site->trial.s, {x0, v0, x, v, h}, u0, u1);
      const Real force = RodForce(*site->d, site->trial.s, x, v, (v - v0) / h, u1);
      given = Select(asked, force, given);
      return force;
    }
    Real held = bristle[j - dampers];
    return storeys_[j - dampers].Force(x, v, x - x0, &held);
  };
  if (!(ramp_v < 0)) {  // its ends do not give way: nothing to balance
    e.next = Select(here, law(fv, fx, here), e.next);
    e.ready = e.ready || here;
    return;
  }
  Real guess = fv + wv * e.next, slope = (sweep > 0 && site ? e.rise : 0) - 1 / wv;
  const Mask soft = quick_ && site ? -2 * ramp_v * e.rise < kSoft : Mask(false);  // false where the rise is unset
  if (sweep == 0) {
    const Real stiff = -2 * ramp_v * e.rise, free_v = fv;
    Real share = Select(soft, stiff / 6 - stiff * stiff * stiff / 360, 0), f0 = 0;
    Mask wide = false;
    if (!All(soft)) {
      // The slope over all that the step may bring, from no force to the force without give (core/weight.h).
      f0 = law(fv, fx, !soft);
      const Real dv = 2 * ramp_v * f0;
      wide = !soft && fabs(dv) > 1e-12 * fabs(fv) + 1e-15;
      if (Any(wide)) {
        const Real f1 = law(fv + dv, fx + 2 * ramp_x * f0, wide);
        e.rise = Select(wide, max(0.0, (f1 - f0) / dv), e.rise);
        share = Select(wide, 2 * EndWeight(-2 * ramp_v * e.rise) - 1, share);
      }
      const Mask none = !soft && !wide;
      if (Any(none)) {
        const Real rest = site ? max(0.0, Observe(*site->d, site->state.s, x0, v0, site->acceleration, u1).slope) : 0;
        e.rise = Select(none, rest, e.rise);
        slope = Select(none, slope + rest, slope);
      }
    }
    blend_[j] = share;
    fx -= hold_x * e.force * share;
    fv -= hold_v * e.force * share;
    wx += share * hold_x;
    wv += share * hold_v;
    if (site) {  // along the secant of these two the balance is near
      slope = Select(soft || wide, e.rise - 1 / wv, slope);
      guess = Select(soft, fv + wv * e.force, guess);
      guess = Select(wide, fv + wv * (f0 + e.rise * (fv - free_v)) / (1 - e.rise * wv), guess);
    }
  }
  const auto residual = [&](Real v, Mask asked) {
    const Real along = (v - fv) / wv;
    return law(v, fx + wx * along, asked) - along;
  };
  const Real solved = SolveIncreasing(residual, guess, slope, tolerance_ * fabs(e.next) + 1e-7, here);
  const Real along = (solved - fv) / wv;
  e.ready = (e.ready && !here) || (here && tried == solved);
  const Mask learns = here && soft && trials > 1 && fabs(tried - tried_before) > 1e-6 * fabs(v0);
  if (Any(learns)) e.rise = Select(learns, max(0.0, (given - given_before) / (tried - tried_before)), e.rise);
  *moved = max(*moved, fabs(along - e.next));
  *size = max(*size, fabs(along));
  e.next = Select(here, along, e.next);
}

void Assembly::Step(const Real* load0, const Real* load1, const Real* u0, const Real* u1, const Real* settle) {
  const int count = static_cast<int>(elements.size()), n = linear_.n(), dampers = static_cast<int>(sites.size());
  const double h = linear_.h();
  linear_.Free(q.data(), load0, load1, free_.data());
  for (int k = 0; k < dampers; k++) Arrives(k, u0[k]);
  for (Element& e : elements) {
    e.next = e.force;
    e.ready = false;
  }
  for (Real& blend : blend_) blend = 0;
  Mask here = true;
  for (int sweep = 0; sweep < (count > 1 ? 40 : 1) && Any(here); sweep++) {
    Real moved = 0, size = 0;
    for (int j = 0; j < count; j++) {
      const bool damper = j < dampers;
      Balance(j, sweep, damper ? u0[j] : 0, damper ? u1[j] : 0, here, &moved, &size);
    }
    here = here && moved > 1e-8 * size;
  }
  next_ = free_;
  for (int j = 0; j < count; j++) {
    Element& e = elements[j];
    e.start = e.force + blend_[j] * (e.next - e.force);
    linear_.Push(j, e.start, e.next, next_.data());
  }
  for (int j = 0; j < count; j++) {
    Element& e = elements[j];
    const Real x0 = linear_.Along(j, q.data(), 0), v0 = linear_.Along(j, q.data(), n);
    const Real x1 = linear_.Along(j, next_.data(), 0), v1 = linear_.Along(j, next_.data(), n);
    if (j >= dampers) {
      e.force = storeys_[j - dampers].Force(x1, v1, x1 - x0, &bristle[j - dampers]);
      continue;
    }
    Site& site = sites[j];
    State& s = site.state.s;
    // Where no other element acts, what was found is where the step ends.
    const Mask found = count == 1 && !s.past ? e.ready : Mask(false);
    if (!All(found)) Advance(*site.d, &s, {x0, v0, x1, v1, h}, u0[j], u1[j]);
    Keep(found, &s.c, site.trial.s.c);
    Settle(*site.d, &s, x1, v1, settle[j]);
    site.acceleration = (v1 - v0) / h;
    // Exact for a force and a velocity that run straight.
    site.work = h * ((e.start * v0 + e.next * v1) / 3 + (e.start * v1 + e.next * v0) / 6);
    e.force = e.next;
  }
  q.swap(next_);
}

}  // namespace mrdamp
