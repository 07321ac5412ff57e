// The chain's own entries: the force on the rod alone is that of the whole observation.
#include <cmath>

#include "core/chain.h"
#include "core/record.h"
#include "tests/check.h"

namespace {

TEST(RodForceIsThatOfAnObservation) {
  for (const double mount : {0.0, 2e5}) {
    for (const double hz : {0.0, 40.0}) {
      mrdamp::Damper d;
      d.law = mrdamp::Law::kBoucWen;
      mrdamp::Params& p = d.p;
      p.c0a = 800, p.alpha_a = 2e4, p.alpha_b = 1e5, p.gamma = p.beta = 1e6, p.A = 150, p.n = 2;
      p.mount_compliance_k = mount, p.moving_mass_m = 2, p.moving_mass_hz = hz, p.moving_mass_share = 0.6;
      p.moving_mass_beyond = 1;
      mrdamp::OwnedState state(d);
      mrdamp::Start(d, &state.s, 0, 0, 0.4);
      const double h = 5e-4;
      double x = 0, v = 0;
      for (int k = 1; k < 200; k++) {
        const double t = k * h, x1 = 0.01 * std::sin(12 * t), v1 = 0.12 * std::cos(12 * t), a = (v1 - v) / h;
        mrdamp::Advance(d, &state.s, {x, v, x1, v1, h}, 0.4, 0.7);
        const double whole = mrdamp::Observe(d, state.s, x1, v1, a, 0.7).force;
        CHECK(mrdamp::RodForce(d, state.s, x1, v1, a, 0.7) == whole);
        CHECK(whole != 0);
        x = x1;
        v = v1;
      }
    }
  }
}

// The slope that solves begin with, against differences of the force at the same state; factors of the velocity have a share.
TEST(SlopeIsTheDerivativeOfTheForce) {
  const std::vector<std::vector<std::pair<const char*, double>>> effects = {
      {},
      {{"shear_thinning_m", 0.5}, {"shear_thinning_v_s", 0.05}},
      {{"asymmetry_a", 0.3}},
      {{"asymmetry_a", -0.3}, {"shear_thinning_m", 0.5}},
      {{"asymmetry_yield", 0.3}, {"asymmetry_viscous", 0.3}},
      {{"asymmetry_a", 0.3}, {"asymmetry_force", 100}},
      {{"trapped_gas_force", 50}, {"trapped_gas_s_g", 0.003}},
      {{"seal_friction_coulomb", 100}, {"seal_friction_width", 0.002}}};
  for (const mrdamp::Law law : {mrdamp::Law::kBingham, mrdamp::Law::kBoucWen, mrdamp::Law::kHyperbolicTangent, mrdamp::Law::kModifiedBoucWen}) {
    for (const auto& effect : effects) {
      mrdamp::Damper d;
      d.law = law;
      mrdamp::Params& p = d.p;
      p.c0a = p.c0b = 300, p.fya = p.alpha_a = 50, p.fyb = p.alpha_b = 400, p.v_ref = 0.01, p.gamma = 500, p.beta = 300, p.A = 800;
      p.n = 2, p.c1a = 3000, p.k0 = 300, p.k1 = 100, p.k0a = 900, p.k1a = 30000, p.m0 = 0.5, p.f0a = 100, p.f0b = 300;
      for (const auto& [name, value] : effect) p.data()[mrdamp::FindAttribute(name)] = value;
      mrdamp::OwnedState state(d);
      mrdamp::Start(d, &state.s, 0, 0, 1);
      const double h = 5e-4, w = 2 * mrdamp::kPi * 3, dv = 1e-7;
      double most = 0, apart = 0;
      for (int k = 0; k < 1200; k++) {
        const double t = k * h, x0 = 0.01 * (1 - std::cos(w * t)), v0 = 0.01 * w * std::sin(w * t);
        const double x1 = 0.01 * (1 - std::cos(w * (t + h))), v1 = 0.01 * w * std::sin(w * (t + h));
        mrdamp::Advance(d, &state.s, {x0, v0, x1, v1, h}, 1, 1);
        const auto force = [&](double v) { return mrdamp::Observe(d, state.s, x1, v, 0, 1).force; };
        const double slope = (force(v1 + dv) - force(v1 - dv)) / (2 * dv);
        most = std::fmax(most, std::fabs(slope));
        apart = std::fmax(apart, std::fabs(mrdamp::Observe(d, state.s, x1, v1, 0, 1).slope - slope));
      }
      NEAR(apart, 0, 0.01 * most);
    }
  }
}

}  // namespace
