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

}  // namespace
