// Magnetics: each formula by itself, and where it acts in the chain.
#include "effects/magnetics.h"
#include "tests/record_run.h"

using check::kDt;
using check::Run;
using check::Sample;
using mrdamp::Params;

namespace {

TEST(SaturationBendsTheField) {
  Params p;
  CHECK(mrdamp::Saturate(p, 3.7) == 3.7);
  p.saturation_i_s = 1.5;
  for (const double shape : {0.0, 1.0, 2.0, 6.0}) {
    p.saturation_shape = shape;
    NEAR(mrdamp::Saturate(p, 1e-6) / 1e-6, 1, 1e-5);
    NEAR(mrdamp::Saturate(p, 1e7), 1.5, 1e-5);
    CHECK(mrdamp::Saturate(p, -0.9) == -mrdamp::Saturate(p, 0.9));
  }
  p.saturation_shape = 0;
  NEAR(mrdamp::Saturate(p, 1.5), 1.5 * std::tanh(1.0), 1e-15);
  p.saturation_shape = 1;
  NEAR(mrdamp::Saturate(p, 0.5), 0.5 / (1 + 0.5 / 1.5), 1e-15);  // Froehlich
}

// h' = (i' / D)(1 - sgn(i') h) by small steps of its own.
TEST(RemanenceFollowsItsEquation) {
  Params p;
  p.remanence_d = 0.2;
  const double path[] = {0, 0.3, 0.1, 1.4, -0.5, -0.45};
  double exact = 0, h = 0;
  for (int k = 1; k < 6; k++) {
    const double di = (path[k] - path[k - 1]) / 200000, sign = di > 0 ? 1 : -1;
    for (int j = 0; j < 200000; j++) {
      const double slope = di / p.remanence_d, half = exact + 0.5 * slope * (1 - sign * exact);
      exact += slope * (1 - sign * half);
    }
    h = mrdamp::Branch(p, h, path[k - 1], path[k]);
    NEAR(h, exact, 1e-9);
  }
}

TEST(RemanenceRaisesTheFieldOnTheWayDown) {
  const auto still = [](double) { return 0.0; };
  const check::Record r = Sample(kDt, 1001, still, still, [](double t) { return 1 - std::cos(2 * M_PI * t); });
  const auto field = Run("bingham", {{"c0a", 1}, {"remanence_b", 0.2}, {"remanence_d", 0.1}}, r, MRDAMP_FIELD);
  NEAR(field[250], 1 - 0.2 * (1 - std::exp(-1 / 0.1)), 1e-9);
  NEAR(field[750], 1 + 0.2 * (1 - 2 * std::exp(-1 / 0.1)), 1e-8);
}

// After any excursion within what it has seen, a circuit of stops comes back to where it was; the equation's does not.
TEST(SmallLoopsOfStopsClose) {
  Params p;
  p.remanence_d = 0.2;
  for (const double stops : {0.0, 1.0}) {
    p.remanence_stops = stops;
    mrdamp::Magnet m;
    m.Start(p, 0);
    const double path[] = {0, 0.5, 0.1, 0.3};
    for (int k = 1; k < 4; k++) m.Follow(p, path[k - 1], path[k]);
    const double before = m.branch;
    m.Follow(p, 0.3, 0.2);
    m.Follow(p, 0.2, 0.3);
    CHECK((std::fabs(m.branch - before) < 1e-12) == (stops == 1));
    m.Follow(p, 0.3, 5);
    NEAR(m.branch, 1, 1e-9);
    const double top = m.branch;
    m.Follow(p, 5, 5 - 1e-4);
    NEAR((top - m.branch) / 1e-4, (stops == 1 ? 1 : 2) / 0.2, 0.01);
  }
  mrdamp::Magnet m;
  p.remanence_start = 0.5, p.remanence_rise = 1;
  m.Start(p, 0);
  NEAR(m.branch, 0.5, 1e-12);
  m.Start(p, 5);
  NEAR(m.branch, 1, 1e-12);
}

// Far along a path the branch is at its bound, however the path is cut, and turned round it is the same with its sign.
TEST(BoundsOfRemanenceFollowTheCurrent) {
  Params p;
  p.remanence_d = 0.05, p.remanence_up = 0.3, p.remanence_down = -0.2;
  const double path[] = {0, 2, 0.5, -1.5, -0.5};
  // The equation's branch trails its bound by d times the bound's slope.
  const double bound[] = {0, 1.6, -0.9, -1.45, 0.9}, trail[] = {0, -0.015, 0.01, 0.015, -0.01};
  for (const double stops : {0.0, 1.0}) {
    p.remanence_stops = stops;
    mrdamp::Magnet whole, cut, other;
    for (mrdamp::Magnet* m : {&whole, &cut, &other}) m->Start(p, 0);
    for (int k = 1; k < 5; k++) {
      const double from = path[k - 1], to = path[k];
      whole.Follow(p, from, to);
      other.Follow(p, -from, -to);
      for (int j = 0; j < 7; j++) cut.Follow(p, from + (to - from) * j / 7, from + (to - from) * (j + 1) / 7);
      NEAR(whole.branch, bound[k] + (stops == 0 ? trail[k] : 0), 1e-6);
      NEAR(cut.branch, whole.branch, 1e-12);
      NEAR(other.branch, -whole.branch, 1e-12);
    }
  }
}

TEST(LoopsOfRemanenceCloseAtTheirKnee) {
  Params p;
  p.remanence_b = 0.2, p.remanence_knee = 0.8;
  NEAR(mrdamp::FieldOf(p, 0, 1), -0.2, 1e-15);
  NEAR(mrdamp::FieldOf(p, 0.8, -1), 0.8 + 0.2 * std::exp(-1), 1e-15);
  NEAR(mrdamp::FieldOf(p, -0.4, 1), -0.4 - 0.2 * std::exp(-0.25), 1e-15);
  p.remanence_knee = 0;
  NEAR(mrdamp::FieldOf(p, 0.8, 1), 0.6, 1e-15);
}

TEST(RemanenceBeginsAsAfterARiseFromZero) {
  const auto still = [](double) { return 0.0; };
  const check::Record r = Sample(kDt, 3, still, still, [](double) { return 0.3; });
  const auto first = [&](double rise, double start) {
    return Run("bingham", {{"c0a", 1}, {"remanence_b", 0.2}, {"remanence_d", 0.1}, {"remanence_rise", rise}, {"remanence_start", start}},
               r, MRDAMP_FIELD)[0];
  };
  NEAR(first(0, 0), 0.3, 1e-15);
  NEAR(first(0, 0.5), 0.3 - 0.2 * 0.5, 1e-15);
  NEAR(first(1, 0), 0.3 - 0.2 * (1 - std::exp(-3)), 1e-15);
  NEAR(first(1, -0.5), 0.3 - 0.2 * (1 - 1.5 * std::exp(-3)), 1e-15);
}

}  // namespace
