// The shear frame against closed forms: one storey, two modes, viscous and dry dampers.
#include "tests/record_run.h"

using check::kDt;

namespace {

constexpr double kMass = 98.3, kStiffness = 5.16e5, kDamping = 125;  // Dyke et al. 1996, first storey

struct Frame {
  std::vector<double> mass, stiffness, damping, friction = {}, gain = {}, offset = {}, lag = {}, lag2 = {}, width = {},
                      one_sided = {}, cubic = {};
  int from = -1, to = -1;
};

// Columns by name of what the frame did.
struct Motion {
  int storeys, n;
  std::vector<double> out;
  double acceleration(int floor, int k) const { return out[static_cast<std::size_t>(floor - 1) * n + k]; }
  double displacement(int floor, int k) const { return out[static_cast<std::size_t>(storeys + floor - 1) * n + k]; }
  double force(int k) const { return out[static_cast<std::size_t>(2 * storeys) * n + k]; }
};

double* Or(std::vector<double>& v) { return v.empty() ? nullptr : v.data(); }

Motion Shake(Frame f, const std::vector<check::Setting>& settings, const std::vector<double>& ground, double command = 0,
             double dt = kDt) {
  const int storeys = static_cast<int>(f.mass.size()), n = static_cast<int>(ground.size());
  const std::vector<double> params = check::Parameters(settings), u(n, command);
  const mrdamp_frame frame{storeys, f.mass.data(), f.stiffness.data(), f.damping.data(), Or(f.friction), f.from, f.to,
                           Or(f.gain), Or(f.offset), nullptr, Or(f.lag), Or(f.lag2), Or(f.width), nullptr,
                           Or(f.one_sided), Or(f.cubic), nullptr, nullptr, nullptr, nullptr, nullptr, nullptr, 0, 0, 0, 0, 0, 0};
  Motion m{storeys, n, std::vector<double>(static_cast<std::size_t>(2 * storeys + 7) * n)};
  char err[300] = "";
  const int failed = mrdamp_run_frame(mrdamp_law_find("bingham"), nullptr, 1, params.data(), &frame, dt, n, ground.data(),
                                      u.data(), nullptr, m.out.data(), err, sizeof err);
  check::That(failed == 0, __FILE__, __LINE__, err);
  return m;
}

// One storey from displacement x and velocity v, free: displacement after t.
double Free(double x, double v, double t, double damping) {
  const double w = std::sqrt(kStiffness / kMass), s = 0.5 * damping / kMass, wd = std::sqrt(w * w - s * s);
  return std::exp(-s * t) * (x * std::cos(wd * t) + (v + s * x) / wd * std::sin(wd * t));
}

TEST(StepOfTheGround) {
  const Motion m = Shake({{kMass}, {kStiffness}, {kDamping}}, {}, std::vector<double>(1000, 2.0));
  const double rest = -2.0 * kMass / kStiffness;
  for (int k = 0; k < 1000; k++) NEAR(m.displacement(1, k), rest + Free(-rest, 0, k * kDt, kDamping), 1e-9 * std::fabs(rest));
}

// A pulse of the ground, then nothing: from any sample on the closed form must lead to all later ones. The
// velocity comes from the absolute acceleration -(k x + c v) / m.
TEST(FreeVibrationAfterAPulse) {
  std::vector<double> ground(2000, 0.0);
  for (int k = 0; k < 60; k++) ground[k] = 3 * std::sin(M_PI * k / 60);
  const Motion m = Shake({{kMass}, {kStiffness}, {kDamping}}, {}, ground);
  const double x = m.displacement(1, 60), v = (-kMass * m.acceleration(1, 60) - kStiffness * x) / kDamping;
  for (int k = 60; k < 2000; k += 7) NEAR(m.displacement(1, k), Free(x, v, (k - 60) * kDt, kDamping), 1e-9 * 5e-4);
  CHECK(std::fabs(x) > 5e-4);
}

TEST(TwoModesWithoutDamping) {
  const Motion m = Shake({{kMass, kMass}, {kStiffness, kStiffness}, {0, 0}}, {}, std::vector<double>(800, 1.0));
  const double w0 = kStiffness / kMass, root = std::sqrt(5.0);
  for (int k = 0; k < 800; k += 3) {
    double lower = 0, upper = 0;
    for (const double sign : {-1.0, 1.0}) {  // w^2 = k/m (3 -+ sqrt 5) / 2, shape (1, 2 - w^2 m / k)
      const double w2 = w0 * (3 + sign * root) / 2, shape = 2 - w2 / w0, share = (1 + shape) / (1 + shape * shape);
      const double q = -share / w2 * (1 - std::cos(std::sqrt(w2) * k * kDt));
      lower += q;
      upper += shape * q;
    }
    NEAR(m.displacement(1, k), lower, 1e-12);
    NEAR(m.displacement(2, k), upper, 1e-12);
  }
}

std::vector<double> Ground(int n) {
  std::vector<double> ground(n);
  for (int k = 0; k < n; k++) ground[k] = 2 * std::sin(55 * k * kDt) + std::sin(140 * k * kDt);
  return ground;
}

double Apart(const Motion& a, const Motion& b) {
  std::vector<double> left, right;
  for (int k = 0; k < a.n; k++) {
    for (int floor = 1; floor <= a.storeys; floor++) left.push_back(a.displacement(floor, k)), right.push_back(b.displacement(floor, k));
  }
  return check::Difference(left, right);
}

// A viscous damper in a storey is that storey's own damping, from weak to far beyond critical.
TEST(ViscousDamperIsDampingOfItsStorey) {
  const std::vector<double> mass = {98.3, 98.3, 98.3}, stiffness = {5.16e5, 6.84e5, 6.84e5};
  for (int storey = 1; storey <= 3; storey++) {
    for (const double c : {50.0, 2000.0, 5e4}) {
      std::vector<double> damping = {125, 50, 50};
      Frame with{mass, stiffness, damping};
      with.from = storey - 1, with.to = storey;
      damping[storey - 1] += c;
      const Motion a = Shake(with, {{"c0a", c}}, Ground(1500)), b = Shake({mass, stiffness, damping}, {}, Ground(1500));
      std::printf("     storey %d, c = %g N s/m: %.1e\n", storey, c, Apart(a, b));
      CHECK(Apart(a, b) < 2e-3);
    }
  }
}

// The same where the floor is so light that its damper alone would stop it within a small part of a step.
TEST(StiffDamperOfALightFloor) {
  for (const double c : {20.0, 2000.0}) {
    Frame with{{0.1}, {1000}, {0}};
    with.from = 0, with.to = 1;
    const Motion a = Shake(with, {{"c0a", c}}, Ground(1500)), b = Shake({{0.1}, {1000}, {c}}, {}, Ground(1500));
    std::printf("     c = %g N s/m: %.1e\n", c, Apart(a, b));
    CHECK(Apart(a, b) < 2e-2);
  }
}

TEST(DamperForceIsThatOfItsStroke) {
  Frame f{{98.3, 98.3}, {5e5, 6e5}, {100, 50}};
  f.from = 0, f.to = 2;  // over both storeys
  const Motion m = Shake(f, {{"c0a", 0}, {"gas_spring_k", 3e5}}, Ground(500));
  for (int k = 0; k < 500; k++) NEAR(m.force(k), 3e5 * m.displacement(2, k), 1e-6);
  for (int k = 0; k < 500; k++) {  // balance of the upper floor without its damping
    const double pull = -6e5 * (m.displacement(2, k) - m.displacement(1, k)) - m.force(k);
    const double rest = 98.3 * m.acceleration(2, k) - pull;
    CHECK(std::fabs(rest) <= 50 * 1.0);  // |v2 - v1| below 1 m/s
  }
  double largest = 0;
  for (int k = 0; k < 500; k++) largest = std::fmax(largest, std::fabs(m.force(k)));
  CHECK(largest > 50);
}

// Dry friction of the storey. Below its limit the floor stays near where it was: bristles without damping creep,
// but by less than half of what the spring alone would give. Above it the first swing ends at -2 (m a - F) / k
// and the way back at -4 F / k.
TEST(DryFrictionInAStorey) {
  Frame f{{kMass}, {kStiffness}, {0}, {150}};
  const Motion stuck = Shake(f, {}, std::vector<double>(500, 1.0));
  double furthest = 0;
  for (int k = 0; k < 500; k++) furthest = std::fmin(furthest, stuck.displacement(1, k));
  CHECK(furthest < 0 && furthest > -0.5 * kMass / kStiffness);

  f.friction = {100};
  const double push = 10 * kMass;
  const Motion slides = Shake(f, {}, std::vector<double>(500, 10.0));
  int at = 0;
  for (int k = 1; k < 60; k++) at = slides.displacement(1, k) < slides.displacement(1, at) ? k : at;
  NEAR(slides.displacement(1, at), -2 * (push - 100) / kStiffness, 0.02 * push / kStiffness);
  double back = slides.displacement(1, at);
  for (int k = at; k < at + 60; k++) back = std::fmax(back, slides.displacement(1, k));
  NEAR(back, -4 * 100 / kStiffness, 0.02 * push / kStiffness);
}

// Friction that turns over a width is F tanh(v / width): the damper's own law in the place of the storey.
TEST(WideFrictionIsATanh) {
  Frame own{{98.3, 98.3}, {5.16e5, 6.84e5}, {125, 50}, {40, 0}}, damper{{98.3, 98.3}, {5.16e5, 6.84e5}, {125, 50}};
  own.width = {0.003, 0};
  damper.from = 0, damper.to = 1;
  const Motion a = Shake(damper, {{"fya", 40}, {"v_ref", 0.003}}, Ground(1500)), b = Shake(own, {}, Ground(1500));
  std::printf("     %.1e\n", Apart(a, b));
  CHECK(Apart(a, b) < 1e-6);
  own.width = {};
  CHECK(Apart(a, Shake(own, {}, Ground(1500))) > 1e-3);
}

// Seal friction of a damper and friction of its storey are the same thing in the same place.
TEST(DryDamperIsDryStorey) {
  Frame own{{98.3, 98.3}, {5.16e5, 6.84e5}, {125, 50}, {40, 0}};
  Frame damper{{98.3, 98.3}, {5.16e5, 6.84e5}, {125, 50}};
  damper.from = 0, damper.to = 1;
  const Motion a = Shake(damper, {{"seal_friction_coulomb", 40}, {"seal_friction_presliding", 1e-5}}, Ground(1500));
  const Motion b = Shake(own, {}, Ground(1500));
  std::printf("     %.1e\n", Apart(a, b));
  CHECK(Apart(a, b) < 5e-3);
}

TEST(DamperAndFrictionTogether) {  // both act on the first floor: solved one after the other until they agree
  Frame both{{98.3, 98.3}, {5.16e5, 6.84e5}, {125, 50}, {40, 20}};
  Frame more = both;
  both.from = 0, both.to = 1;
  more.damping[0] += 3000;
  const double apart = Apart(Shake(both, {{"c0a", 3000}}, Ground(1500)), Shake(more, {}, Ground(1500)));
  std::printf("     %.1e\n", apart);
  CHECK(apart < 5e-3);
}

// A crack that opens under a positive drift: half swings of two springs in turn, each with the same velocity at the middle.
TEST(OneSidedStorey) {
  const double soft = 0.36 * kStiffness, omega = std::sqrt(kStiffness / kMass);
  Frame f{{kMass}, {kStiffness}, {0}};
  f.one_sided = {soft - kStiffness};
  std::vector<double> ground(600, 0.0);
  for (int k = 0; k < 4; k++) ground[k] = -2;  // a push that ends long before the floor turns
  const Motion m = Shake(f, {}, ground);
  double most = 0, least = 0;
  std::vector<double> through;  // s, of the drift through zero
  for (int k = 6; k < 600; k++) {
    const double x0 = m.displacement(1, k - 1), x1 = m.displacement(1, k);
    most = std::fmax(most, x1), least = std::fmin(least, x1);
    if (x0 * x1 < 0) through.push_back((k - 1 + x0 / (x0 - x1)) * kDt);
    NEAR(kMass * m.acceleration(1, k), -(x1 > 0 ? soft : kStiffness) * x1, 1e-6 * kStiffness * 1e-3);
  }
  CHECK(through.size() > 8);
  NEAR(through[2] - through[0], M_PI / omega * (1 + 1 / 0.6), 2e-4);
  NEAR(through[1] - through[0], M_PI / omega, 2e-4);
  NEAR(most / -least, 1 / 0.6, 5e-3);
}

// A spring that hardens keeps m v^2 / 2 + k x^2 / 2 + c x^4 / 4.
TEST(CubicStorey) {
  Frame f{{kMass}, {kStiffness}, {0}};
  f.cubic = {8e10};
  std::vector<double> ground(800, 0.0);
  for (int k = 0; k < 4; k++) ground[k] = -40;
  const Motion m = Shake(f, {}, ground);
  double least = INFINITY, most = 0, share = 0;
  for (int k = 10; k < 799; k++) {
    const double x = m.displacement(1, k), v = (m.displacement(1, k + 1) - m.displacement(1, k - 1)) / (2 * kDt);
    const double spring = 0.5 * kStiffness * x * x, more = 0.25 * 8e10 * x * x * x * x;
    NEAR(kMass * m.acceleration(1, k), -kStiffness * x - 8e10 * x * x * x, 1e-3);
    const double energy = 0.5 * kMass * v * v + spring + more;
    least = std::fmin(least, energy), most = std::fmax(most, energy), share = std::fmax(share, more / spring);
  }
  CHECK(share > 0.2);
  CHECK(most < 1.06 * least);
}

TEST(FloorSensors) {
  Frame f{{98.3, 98.3}, {5.16e5, 6.84e5}, {125, 50}};
  const Motion plain = Shake(f, {}, Ground(300));
  f.gain = {1, 0.8}, f.offset = {0, 0.05};
  const Motion read = Shake(f, {}, Ground(300));
  for (int k = 0; k < 300; k++) {
    CHECK(read.acceleration(1, k) == plain.acceleration(1, k));
    NEAR(read.acceleration(2, k), 0.8 * plain.acceleration(2, k) + 0.05, 1e-12);
  }
  // Poles in a row commute.
  Frame one{{98.3, 98.3}, {5.16e5, 6.84e5}, {125, 50}}, other = one;
  one.lag = {0.02, 0}, one.lag2 = {0.005, 0};
  other.lag = {0.005, 0}, other.lag2 = {0.02, 0};
  const Motion a = Shake(one, {}, Ground(1500)), b = Shake(other, {}, Ground(1500));
  double apart = 0, size = 0;
  for (int k = 0; k < 1500; k++) {
    apart = std::fmax(apart, std::fabs(a.acceleration(1, k) - b.acceleration(1, k)));
    size = std::fmax(size, std::fabs(a.acceleration(1, k)));
  }
  CHECK(apart < 0.02 * size && size > 0.1);
}

}  // namespace
