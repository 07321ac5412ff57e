// Fluid, mechanics and mount: each formula by itself, and where it acts in the chain.
#include "effects/fluid.h"
#include "effects/mechanics.h"
#include "effects/mount.h"
#include "laws/law.h"
#include "tests/record_run.h"

using check::kDt;
using check::Record;
using check::Run;
using check::Sample;
using mrdamp::Params;

namespace {

Record Sine(double amplitude, double omega, double command, int n = 600) {
  return Sample(
      kDt, n, [=](double t) { return amplitude * std::sin(omega * t); },
      [=](double t) { return amplitude * omega * std::cos(omega * t); }, [=](double) { return command; });
}

TEST(HeatIsExactForConstantPower) {
  Params p;
  p.heating_capacity = 50, p.heating_loss = 2;
  NEAR(mrdamp::Heat(p, {3, 0}, 40, 10).fluid, 20 + (3 - 20) * std::exp(-0.4), 1e-12);
  p.heating_loss = 0;
  NEAR(mrdamp::Heat(p, {3, 0}, 40, 10).fluid, 3 + 8, 1e-12);
}

// A power of 40 W into a fluid that gives its heat to a body, by small steps of their own equations.
TEST(HeatFlowsOnToABody) {
  Params p;
  p.heating_capacity = 5, p.heating_link = 2, p.heating_body = 30, p.heating_loss = 0.5;
  const double dt = 1e-3;
  double fluid = 0, body = 0;
  mrdamp::Rise r{0, 0};
  for (int k = 0; k < 20000; k++) {
    for (int j = 0; j < 10; j++) {
      const double flow = 2 * (fluid - body);
      fluid += dt / 10 * (40 - flow) / 5;
      body += dt / 10 * (flow - 0.5 * body) / 30;
    }
    r = mrdamp::Heat(p, r, 40, dt);
  }
  NEAR(r.fluid, fluid, 2e-3 * fluid);
  NEAR(r.body, body, 2e-3 * body);
  CHECK(fluid > body + 10 && body > 10);
}

TEST(ViscosityFallsInItsShape) {
  Params p;
  p.heating_kappa = 0.02;
  NEAR(mrdamp::Thinned(p, 10), std::exp(-0.2), 1e-15);
  p.heating_shape = 1;
  NEAR(mrdamp::Thinned(p, 10), 1 / 1.2, 1e-15);
  p.heating_shape = 100;
  NEAR(mrdamp::Thinned(p, 10), std::exp(-0.2), 2e-4);
}

TEST(HeatingTakesUpTheDissipatedWork) {
  const Record r = Sine(0.01, 30, 0);
  const std::vector<check::Setting> p = {{"c0a", 1000}, {"heating_kappa", 1e-12}, {"heating_capacity", 20}};
  const auto heat = Run("bingham", p, r, MRDAMP_TEMPERATURE), force = Run("bingham", p, r, MRDAMP_TRUE);
  double work = 0;
  for (std::size_t i = 1; i < heat.size(); i++) work += 0.5 * kDt * (force[i] * r.v[i] + force[i - 1] * r.v[i - 1]);
  NEAR(heat.back() * 20, work, 0.01 * work);
  CHECK(work > 10);
}

TEST(HeatThinsViscosityAndYieldEachByItsOwn) {
  const Record r = Sample(kDt, 5, [](double t) { return 0.2 * t; }, [](double) { return 0.2; }, [](double) { return 0.0; });
  const std::vector<check::Setting> p = {{"c0a", 1000}, {"fya", 300}, {"heating_kappa", 0.02}, {"heating_kappa_yield", 0.005},
                                         {"heating_start", 40}, {"heating_capacity", 1e9}};
  NEAR(Run("bingham", p, r, MRDAMP_TRUE)[4], 200 * std::exp(-0.8) + 300 * std::exp(-0.2), 1e-4);
}

TEST(AsymmetryStrengthensExtension) {
  Params p;
  double rate;
  CHECK(mrdamp::Asymmetry(p, 1, &rate) == 1);
  p.asymmetry_a = 0.15;
  NEAR(mrdamp::Asymmetry(p, 1, &rate), 1.15, 1e-12);
  NEAR(mrdamp::Asymmetry(p, -1, &rate), 0.85, 1e-12);
  CHECK(mrdamp::Asymmetry(p, 0, &rate) == 1);
}

TEST(AsymmetryHasASharePerPart) {
  Params p;
  p.c0a = 100, p.fya = 30, p.asymmetry_yield = 0.2, p.asymmetry_viscous = -0.1, p.asymmetry_width = 1e-3;
  const auto up = mrdamp::Evaluate(p, mrdamp::Law::kBingham, {}, 1), down = mrdamp::Evaluate(p, mrdamp::Law::kBingham, {}, -1);
  NEAR(up.c0, 90, 1e-9);
  NEAR(up.yield, 36, 1e-9);
  NEAR(down.c0, 110, 1e-9);
  NEAR(down.yield, 24, 1e-9);
}

TEST(APlateGoesFromStopToStop) {
  Params p;
  p.asymmetry_travel = 1e-3;
  NEAR(mrdamp::FollowPlate(p, 0, 2e-4), 0.4, 1e-12);
  CHECK(mrdamp::FollowPlate(p, 0.4, 1e-3) == 1);
  NEAR(mrdamp::FollowPlate(p, 1, -3e-4), 0.4, 1e-12);
  CHECK(mrdamp::FollowPlate(p, 1, -1) == -1);
}

TEST(APlateMovesInItsOwnTime) {
  // A force of 100 N in extension from rest: the plate is where 1 - exp(-t / time) of its way is, 0.2 tanh(100 / 50).
  const Record r = Sample(kDt, 101, [](double t) { return 0.2 * t; }, [](double) { return 0.2; }, [](double) { return 0.0; });
  const std::vector<check::Setting> p = {{"c0a", 500}, {"asymmetry_a", 0.2}, {"asymmetry_force", 50}, {"asymmetry_time", 0.04}};
  NEAR(Run("bingham", p, r, MRDAMP_TRUE)[100], 100 * (1 + 0.2 * std::tanh(2) * (1 - std::exp(-0.1 / 0.04))), 1e-6);
}

TEST(TrappedGasTakesTheStartOfAStroke) {
  Params p;
  p.trapped_gas_d = 0.6, p.trapped_gas_s_g = 0.002, p.trapped_gas_direction = 1;
  mrdamp::Stroke s;
  CHECK(mrdamp::TrappedGas(p, s, 0, 0) == 1);
  s.Follow(5e-6, p);  // not yet a stroke
  CHECK(s.direction == 0);
  for (double x = 0; x <= 0.0105; x += 1e-4) s.Follow(x, p);
  CHECK(s.direction == 1);
  NEAR(mrdamp::TrappedGas(p, s, 0.002, 0), 1 - 0.6 * std::exp(-1), 1e-9);
  const double top = s.extreme;
  s.Follow(top - 0.9e-5, p);  // noise turns nothing round
  CHECK(s.direction == 1);
  s.Follow(top - 2e-5, p);
  CHECK(s.direction == -1 && s.turn == top);
  CHECK(mrdamp::TrappedGas(p, s, top - 0.001, 0) == 1);  // the other direction loses nothing
  p.trapped_gas_direction = 0;
  NEAR(mrdamp::TrappedGas(p, s, top - 0.001, 0), 1 - 0.6 * std::exp(-0.25), 1e-12);
}

TEST(GasSpringIsAParabola) {
  Params p;
  p.gas_spring_k = 2000, p.gas_spring_k2 = 5, p.gas_spring_f0 = 30;
  NEAR(mrdamp::GasSpring(p, 0.1), 200 * 1.5 + 30, 1e-12);
  NEAR(mrdamp::GasSpring(p, -0.1), -200 * 0.5 + 30, 1e-12);
}

TEST(APocketOfGasOpensOnTheWayBack) {
  Params p;
  p.trapped_gas_d = 0.6, p.trapped_gas_s_g = 0.001, p.trapped_gas_reach = 0.002, p.trapped_gas_shape = 1;
  mrdamp::Stroke s;
  for (double x = 0; x <= 0.0051; x += 1e-4) s.Follow(x, p);
  NEAR(mrdamp::TrappedGas(p, s, 0.005, 0), 1 - 0.6 * std::exp(-2), 1e-9);  // shut
  s.Follow(s.last - 5e-4, p);  // a quarter open
  CHECK(mrdamp::TrappedGas(p, s, s.last, 0) == 1);   // the other direction loses nothing
  s.Follow(s.last + 1e-4, p);
  NEAR(mrdamp::TrappedGas(p, s, s.last, 0), 1 - 0.6 * std::exp(-1.6), 1e-9);
}

TEST(APocketMayLoseByTheVelocity) {
  Params p;
  p.trapped_gas_d = 0.6, p.trapped_gas_s_g = 0.001, p.trapped_gas_reach = 0.002, p.trapped_gas_shape = 1, p.trapped_gas_width = 0.01;
  mrdamp::Stroke s;  // wide open
  CHECK(mrdamp::TrappedGas(p, s, 0, 0) == 1 && mrdamp::TrappedGas(p, s, 0, -0.1) == 1);
  NEAR(mrdamp::TrappedGas(p, s, 0, 0.01), 1 - 0.6 * std::tanh(1.0), 1e-12);
  s.Follow(1e-3, p);
  NEAR(mrdamp::TrappedGas(p, s, 1e-3, 0.5), 1 - 0.6 * std::exp(-1), 1e-12);
  p.trapped_gas_direction = 0;
  NEAR(mrdamp::TrappedGas(p, s, 1e-3, -0.5), 1 - 0.6 * std::exp(-1), 1e-12);
}

TEST(APocketOpensInItsOwnTime) {
  Params p;
  p.trapped_gas_d = 0.5, p.trapped_gas_s_g = 0.002, p.trapped_gas_shape = 1, p.trapped_gas_end = 1, p.trapped_gas_time = 0.1;
  for (const double side : {1.0, -1.0}) {
    p.trapped_gas_direction = side;
    mrdamp::Stroke s;
    s.pocket = side > 0 ? 0 : 0.002;
    s.Follow(side * 1.5e-3, p, 0.01);  // a quarter open
    NEAR(mrdamp::TrappedGas(p, s, s.last, 0), 1 - 0.5 * 0.25, 1e-12);
    s.Follow(s.last, p, 0.1);  // at rest
    s.Follow(s.last - side * 1e-3, p, 0);  // the way back alone opens nothing
    s.Follow(s.last + side * 1e-4, p, 0.01);
    NEAR(mrdamp::TrappedGas(p, s, s.last, 0), 1 - 0.5 * (1 - 0.75 * std::exp(-1.0) - 0.05), 1e-12);
    s.Follow(s.last + side * 5e-3, p, 0.01);
    CHECK(mrdamp::TrappedGas(p, s, s.last, 0) == 1);  // shut
  }
}

TEST(GasLimitsTheForceByItsPressure) {
  Params p;
  p.trapped_gas_force = 50, p.trapped_gas_s_g = 0.002, p.trapped_gas_shape = 1.3;
  mrdamp::Stroke s;
  double rate;
  s.Follow(1e-3, p);
  const double limit = 50 * std::pow(0.5, -1.3);
  NEAR(mrdamp::LimitedByGas(p, s, limit, &rate), limit * std::pow(0.5, 0.25), 1e-9);
  NEAR(rate, std::pow(0.5, 1.25), 1e-12);
  NEAR(mrdamp::LimitedByGas(p, s, 100 * limit, &rate), limit, 1e-3);
  CHECK(mrdamp::LimitedByGas(p, s, -300, &rate) == -300 && rate == 1);  // the other direction
  s.Follow(3e-3, p);
  CHECK(mrdamp::LimitedByGas(p, s, 300, &rate) == 300);  // pressed together
  p.trapped_gas_direction = 0;
  s.Follow(2e-3, p);  // half open to either side
  NEAR(mrdamp::LimitedByGas(p, s, -100 * limit, &rate), -limit, 1e-3);
}

TEST(APocketInSeriesIsPressedPolytropically) {
  Params p;
  CHECK(!mrdamp::HasPocket(p));
  p.trapped_gas_series = 1, p.trapped_gas_force = 50, p.trapped_gas_s_g = 0.002, p.trapped_gas_shape = 1.3;
  CHECK(mrdamp::HasPocket(p) && !mrdamp::HasTrappedGas(p));
  const double force = 50 * (std::pow(0.25, -1.3) - 1), step = 1e-3;
  NEAR(mrdamp::PocketStretch(p, force), 1.5e-3, 1e-12);
  NEAR(mrdamp::PocketForce(p, 1.5e-3), force, 1e-9);
  const double chord = (mrdamp::PocketStretch(p, force + step) - mrdamp::PocketStretch(p, force - step)) / (2 * step);
  NEAR(mrdamp::PocketGive(p, 1.5e-3), chord, 1e-4 * chord);
  CHECK(mrdamp::PocketStretch(p, -300) == 0);  // at its stop
  p.trapped_gas_direction = -1;
  CHECK(mrdamp::PocketStretch(p, 300) == 0);
  NEAR(mrdamp::PocketStretch(p, -force), -1.5e-3, 1e-12);
  NEAR(mrdamp::PocketForce(p, -1.5e-3), -force, 1e-9);
  p.trapped_gas_direction = 0;
  NEAR(mrdamp::PocketStretch(p, -force), -mrdamp::PocketStretch(p, force), 1e-15);
}

TEST(APocketTakesItsWayFromTheFluidWhileItIsPressed) {
  Params p;
  p.trapped_gas_direction = -1, p.trapped_gas_width = 0.01;
  NEAR(mrdamp::PocketShare(p, -0.1), 1, 1e-8);
  NEAR(mrdamp::PocketShare(p, 0.01), 0.5 * (1 - std::tanh(1.0)), 1e-12);
  p.trapped_gas_direction = 0;
  CHECK(mrdamp::PocketShare(p, 0.1) == 1);
}

TEST(AStrokeCountsFromItsOwnWayBack) {
  Params p;
  p.trapped_gas_d = 0.6, p.trapped_gas_turn = 1e-3;
  mrdamp::Stroke s;
  s.Follow(5e-3, p);
  s.Follow(4.1e-3, p);
  CHECK(s.direction == 1);
  s.Follow(3.9e-3, p);
  CHECK(s.direction == -1 && s.turn == 5e-3);
}

// y'' + 2 zeta w y' + w^2 y = w^2 x on a ramp, by small steps of its own.
TEST(OscillatorIsExactOnRamps) {
  const double w = 40, zeta = 0.3, end = 0.2;
  double y = 0.7, v = -3;
  const int fine = 400000;
  for (int k = 0; k < fine; k++) {
    const double h = end / fine, x = 1 + 25 * (k + 0.5) * h;
    const double ym = y + 0.5 * h * v, vm = v + 0.5 * h * (w * w * (x - y) - 2 * zeta * w * v);
    y += h * vm;
    v += h * (w * w * (x - ym) - 2 * zeta * w * vm);
  }
  for (const int steps : {1, 5, 64}) {
    mrdamp::Oscillator o{0.7, -3};
    for (int k = 0; k < steps; k++) o.Step(w, zeta, 1 + 25 * end * k / steps, 1 + 25 * end * (k + 1) / steps, end / steps);
    NEAR(o.y, y, 1e-7);
    NEAR(o.rate, v, 1e-5);
  }
}

// A mass on a soft spring feels the rod's mean acceleration only; on a hard one it follows the rod.
TEST(AMovingMassRingsOnItsSpring) {
  const Record r = Sine(0.01, 20, 0);
  const auto load = [&](double hz) {
    return Run("bingham", {{"c0a", 100}, {"moving_mass_m", 3}, {"moving_mass_hz", hz}, {"moving_mass_ratio", 0.9}}, r, MRDAMP_REFERENCE);
  };
  const auto rigid = load(0), hard = load(400), near = load(5);
  const double w = 2 * M_PI * 5;
  for (std::size_t i = 400; i < rigid.size(); i++) {
    const double t = static_cast<double>(i) * kDt;
    NEAR(hard[i], rigid[i], 0.02 * 3 * 4);
    // Steady: the spring and dashpot carry m a (1 + 2 i zeta q) / (1 - q^2 + 2 i zeta q), q = 20 / w.
    const double q = 20 / w, b = 2 * 0.9 * q, size = (1 - q * q) * (1 - q * q) + b * b;
    const double re = (1 - q * q + b * b) / size, im = (b * (1 - q * q) - b) / size;
    const double a = -0.01 * 400 * (re * std::sin(20 * t) + im * std::cos(20 * t));
    NEAR(near[i], 100 * r.v[i] + 3 * a, 0.03);
  }
}

TEST(SealFrictionBuildsUpAndSlides) {
  using mrdamp::SealFriction;
  const double coulomb = 20, presliding = 2e-5, sigma = coulomb / presliding;
  CHECK(SealFriction::Follow(1e-6, 0, coulomb, sigma) == 1e-6);
  // dq/dx = 1 - q sgn(dx) sigma / limit from rest
  NEAR(sigma * SealFriction::Follow(0, presliding, coulomb, sigma), coulomb * (1 - std::exp(-1)), 1e-9);
  NEAR(sigma * SealFriction::Follow(0, -1, coulomb, sigma), -coulomb, 1e-9);
  double q = 0;
  for (int i = 0; i < 8; i++) q = SealFriction::Follow(q, presliding / 8, coulomb, sigma);
  NEAR(q, SealFriction::Follow(0, presliding, coulomb, sigma), 1e-18);
  NEAR(SealFriction::Limit(20, 1.5, 0.01, 0), 30, 1e-12);
  NEAR(SealFriction::Limit(20, 1.5, 0.01, -0.01), 20 * (1 + 0.5 * std::exp(-1)), 1e-12);
  NEAR(SealFriction::Limit(20, 1.5, 0.01, 1), 20, 1e-12);
}

TEST(MechanicsAddToTheForce) {
  const Record r = Sine(0.01, 20, 0);
  const auto force = Run("bingham", {{"c0a", 100}, {"gas_spring_k", 3000}, {"gas_spring_f0", 40}, {"seal_friction_coulomb", 25}}, r,
                         MRDAMP_TRUE);
  int seen = 0;
  for (std::size_t i = 1; i < force.size(); i++) {
    if (std::fabs(r.v[i]) < 0.1) continue;  // away from the turns, where friction is still building up
    NEAR(force[i], 100 * r.v[i] + 3000 * r.x[i] + 40 + (r.v[i] > 0 ? 25 : -25), 0.05);
    seen++;
  }
  CHECK(seen > 100);
}

TEST(MovingMassIsSeenByTheLoadCellAlone) {
  Record r = Sine(0.01, 20, 0);
  for (const double x : r.x) r.a.push_back(-400 * x);
  const std::vector<check::Setting> p = {{"c0a", 100}, {"moving_mass_m", 2.5}};
  const auto read = Run("bingham", p, r, MRDAMP_FORCE), own = Run("bingham", p, r, MRDAMP_TRUE);
  for (std::size_t i = 0; i < r.x.size(); i++) {
    NEAR(own[i], 100 * r.v[i], 1e-9);
    NEAR(read[i], 100 * r.v[i] + 2.5 * r.a[i], 1e-9);
  }
}

TEST(AMountIsStifferForSmallMotionsByItsFriction) {
  Params p;
  p.mount_compliance_k = 1e5, p.mount_compliance_friction = 50, p.mount_compliance_slide = 1e-4;
  mrdamp::Elastomer r;
  NEAR(r.Force(p, 1e-4), 10 + 50 * (1 - std::exp(-1.0)), 1e-9);
  NEAR(r.Slope(p, 0), 1e5 + 50 / 1e-4, 1e-3);
  const double step = 1e-9;
  NEAR(r.Slope(p, 1e-4), (r.Force(p, 1e-4 + step) - r.Force(p, 1e-4 - step)) / (2 * step), 1);
  r.Follow(p, 2e-3, {});
  NEAR(r.Force(p, 2e-3), 250, 1e-5);
  NEAR(r.Slope(p, 2e-3), 1e5, 1);  // slides
  NEAR(r.Force(p, 2e-3 - 1e-4), 190 + 50 * (2 * std::exp(-1.0) - 1), 1e-5);
  NEAR(r.Slope(p, 2e-3 - step), 1e5 + 2 * 50 / 1e-4, 20);
}

TEST(AMountLetsGo) {
  Params p;
  p.mount_compliance_k = 1e5, p.mount_compliance_loss = 2, p.mount_compliance_time = 0.05;
  mrdamp::Elastomer r;
  const mrdamp::Easing over = mrdamp::Ease(p, 0.05);
  NEAR(r.Look(p, 1e-4, over).force, 10 + 20 * (1 - std::exp(-1.0)), 1e-9);  // pulled evenly
  NEAR(r.Slope(p, r.Look(p, 1e-4, over), 0, over), 1e5 + 2e5 * (1 - std::exp(-1.0)), 1e-6);
  r.Follow(p, 1e-4, over);
  r.Follow(p, 1e-4, over);  // held
  NEAR(r.Force(p, 1e-4), 10 + 20 * (1 - std::exp(-1.0)) * std::exp(-1.0), 1e-9);
  NEAR(r.Force(p, 2e-4), r.Force(p, 1e-4) + 30, 1e-9);  // at once by both springs
  NEAR(mrdamp::Ease(p, 0).take, 1, 0);
}

TEST(MountForceHasADeadZone) {
  Params p;
  CHECK(!mrdamp::HasMount(p));
  p.backlash_gap = 2e-3;
  CHECK(mrdamp::HasMount(p));
  CHECK(mrdamp::MountForce(p, 0.9e-3) == 0);
  NEAR(mrdamp::MountForce(p, 1.5e-3), 0.5e-3 * p.backlash_k, 1e-9);
  p.mount_compliance_k = 1e5;
  NEAR(mrdamp::MountForce(p, -1.5e-3), -50, 1e-9);
}

// A dashpot behind a spring, pulled at a constant velocity: F = c V (1 - exp(-k t / c)); after the start the same
// around a turn. With backlash half the gap is closed first.
TEST(MountIsAMaxwellElement) {
  const double c = 2000, k = 8e4, v = 0.05;
  const Record r = Sample(kDt, 200, [=](double t) { return v * t; }, [=](double) { return v; }, [](double) { return 0.0; });
  for (const double gap : {0.0, 1e-3}) {
    const std::vector<check::Setting> p = {{"c0a", c}, {"mount_compliance_k", k}, {"backlash_gap", gap}};
    const auto force = Run("bingham", p, r, MRDAMP_REFERENCE), piston = Run("bingham", p, r, MRDAMP_PISTON);
    for (int i = 0; i < 200; i++) {
      const double t = i * kDt - 0.5 * gap / v;
      const double wanted = t > 0 ? c * v * (1 - std::exp(-k * t / c)) : 0;
      NEAR(force[i], wanted, 0.01 * c * v);
      if (force[i] > 0) NEAR(r.x[i] - piston[i] - 0.5 * gap, force[i] / k, 1e-9);
    }
    NEAR(force[199], c * v, 0.01 * c * v);
  }
}

// The same element under a sine: F lags by atan(k / (c w)) with the size c w k / sqrt(k^2 + (c w)^2).
TEST(MountUnderASine) {
  const double c = 2000, k = 8e4, omega = 60, x = 0.002;
  const Record r = Sine(x, omega, 0, 1000);
  const auto force = Run("bingham", {{"c0a", c}, {"mount_compliance_k", k}}, r, MRDAMP_REFERENCE);
  const double d = k * k + c * omega * c * omega;
  std::vector<double> got, wanted;
  for (int i = 300; i < 1000; i++) {
    const double t = i * kDt;
    got.push_back(force[i]);
    wanted.push_back(x * k * c * omega / d * (c * omega * std::sin(omega * t) + k * std::cos(omega * t)));
  }
  CHECK(check::Difference(got, wanted) < 2e-3);
}

}  // namespace
