// Rows of closed loops: against the frame's own entry, and what a caller may rely on.
#include <algorithm>

#include "tests/record_run.h"

namespace {

constexpr double kPeriod = 5e-3;
constexpr int kSteps = 20, kPeriods = 160;  // 0.25 ms, as the frame's entry steps at this sample time
const std::vector<check::Setting> kBoucWen{{"c0a", 300}, {"c0b", 150}, {"alpha_a", 6000}, {"alpha_b", 25000}, {"gamma", 9e4},
                                           {"beta", 6e4}, {"A", 150}, {"n", 2}, {"k0", 800}, {"x0", 0}};

struct Frame {
  std::vector<double> mass{98.3, 98.3, 98.3}, stiffness{5.16e5, 6.84e5, 6.84e5}, damping{125, 50, 50};
  std::vector<double> friction{0, 0, 0}, lag{0, 0, 0};
  mrdamp_frame Of(int from, int to) const {
    mrdamp_frame f{};
    f.storeys = 3;
    f.mass = mass.data();
    f.stiffness = stiffness.data();
    f.damping = damping.data();
    f.friction = friction.data();
    f.acc_lag = lag.data();
    f.damper_from = from;
    f.damper_to = to;
    return f;
  }
};

std::vector<double> Ground(int samples, double dt) {
  std::vector<double> ground;
  for (int k = 0; k < samples; k++) ground.push_back(3 * std::sin(31 * k * dt) + 2 * std::sin(83 * k * dt + 1));
  return ground;
}

// Rows of a frame with dampers of kBoucWen and further settings, and their arrays.
struct Rows {
  mrdamp_rows* rows = nullptr;
  int n, size = 0, many = 0, dampers;
  std::vector<double> ground = Ground(2000, 1e-3), state, criteria, out;
  std::vector<mrdamp_load> loads;

  Rows(const Frame& frame, std::vector<check::Setting> more, std::vector<int> between, int copies = 1, int steps = kSteps,
       std::vector<double> noise = {}, double share = 1)
      : n(copies), dampers(static_cast<int>(between.size() / 2)) {
    std::vector<check::Setting> settings = kBoucWen;
    for (check::Setting& s : settings) s.value *= s.name[0] == 'c' || s.name[1] == 'l' || s.name[0] == 'k' ? share : 1;
    settings.insert(settings.end(), more.begin(), more.end());
    std::vector<double> params, largest(dampers, 2.0);
    for (int k = 0; k < dampers; k++) {
      const std::vector<double> one = check::Parameters(settings);
      params.insert(params.end(), one.begin(), one.end());
    }
    const std::vector<int> laws(dampers, mrdamp_law_find("bouc_wen"));
    const mrdamp_dampers given{dampers, laws.data(), nullptr, params.data(), largest.data()};
    const mrdamp_frame f = frame.Of(0, 1);
    char err[300] = "";
    rows = mrdamp_rows_frame(&f, &given, between.data(), kPeriod, steps, 1, err, sizeof err);
    check::That(rows != nullptr, __FILE__, __LINE__, err);
    size = mrdamp_rows_size(rows);
    many = mrdamp_rows_measurements(rows);
    if (!noise.empty()) CHECK(mrdamp_rows_noise(rows, noise.data(), err, sizeof err) == 0);
    state.resize(static_cast<std::size_t>(n) * size);
    out.resize(static_cast<std::size_t>(n) * many);
    criteria.resize(static_cast<std::size_t>(n) * MRDAMP_CRITERIA);
    loads.assign(n, {ground.data(), 1e-3, static_cast<int>(ground.size()), 1 << 30});
    for (int k = 0; k < n; k++) Start(k, k);
  }
  Rows(const Rows&) = delete;
  Rows& operator=(const Rows&) = delete;
  ~Rows() { mrdamp_rows_free(rows); }

  void Start(int row, double seed) { mrdamp_rows_start(rows, seed, &loads[row], &state[row * size], &out[row * many]); }
  void Step(const std::vector<double>& u, int threads = 1, int lanes = 0) {
    mrdamp_rows_step(rows, n, state.data(), loads.data(), u.data(), criteria.data(), out.data(), threads, lanes);
  }
  // Columns of the measurements.
  double Acceleration(int floor, int row = 0) const { return out[row * many + floor - 1]; }
  double Displacement(int floor, int row = 0) const { return out[row * many + 3 + floor - 1]; }
  double Of(int signal, int damper = 0) const { return out[12 + signal * dampers + damper]; }
};

double Command(int k) { return 1 + std::sin(0.7 * k); }

// One row under held commands is a record of the frame's entry at the same step.
void LikeTheFrame(const Frame& frame, const std::vector<check::Setting>& more, int from, int to, int compared = 5) {
  Rows rows(frame, more, {from, to});
  std::vector<check::Setting> settings = kBoucWen;
  settings.insert(settings.end(), more.begin(), more.end());
  settings.push_back({"command_start", 0});  // a record begins with its first command, a row with none
  const std::vector<double> params = check::Parameters(settings);
  const double dt = kPeriod / 5;
  const int samples = 5 * kPeriods + 1;
  std::vector<double> u(samples), wanted(static_cast<std::size_t>(13) * samples);
  for (int k = 0; k < samples; k++) u[k] = Command(k / 5);
  const mrdamp_frame f = frame.Of(from, to);
  const mrdamp_options options{1, 1, 0, 0, 0};
  char err[300] = "";
  check::That(mrdamp_run_frame(mrdamp_law_find("bouc_wen"), nullptr, 1, params.data(), &f, dt, samples, rows.ground.data(),
                               u.data(), &options, wanted.data(), err, sizeof err) == 0, __FILE__, __LINE__, err);
  std::vector<double> got[5], of[5], within(static_cast<std::size_t>(kSteps) * rows.many), inside, fine;
  mrdamp_rows_within(rows.rows, within.data());
  for (int k = 1; k <= kPeriods; k++) {
    rows.Step({Command(k - 1)});
    for (int i = 0; i < 5; i++) {  // displacement of floor 3
      inside.push_back(within[i * (kSteps / 5) * rows.many + 5]);
      fine.push_back(wanted[static_cast<std::size_t>(5) * samples + 5 * (k - 1) + i]);
    }
    const double read[] = {rows.Displacement(1), rows.Displacement(3), rows.Of(2), rows.Of(3), rows.Of(1)};
    const int columns[] = {3, 5, 8, 9, 7};
    for (int c = 0; c < 5; c++) {
      got[c].push_back(read[c]);
      of[c].push_back(wanted[static_cast<std::size_t>(columns[c]) * samples + 5 * k]);
    }
  }
  for (int c = 0; c < compared; c++) NEAR(check::Difference(got[c], of[c]), 0, 1e-5);
  NEAR(check::Difference(inside, fine), 0, 1e-5);
}

TEST(ARowIsTheFramesEntry) {
  const Frame plain;
  Frame dry;
  dry.friction = {0, 8, 0};
  LikeTheFrame(plain, {{"driver_lag_tau", 0.005}}, 0, 1);
  LikeTheFrame(plain, {{"moving_mass_m", 5}, {"driver_lag_tau", 0.005}}, 1, 3, 4);  // the entry's force is without the mass
  LikeTheFrame(plain, {{"mount_compliance_k", 2e6}, {"driver_lag_tau", 0.005}}, 0, 2);
  LikeTheFrame(plain, {{"command_delay_d", 0.008}, {"driver_lag_tau", 0.005}}, 0, 1);
  LikeTheFrame(dry, {{"driver_lag_tau", 0.005}}, 0, 1);
}

TEST(TwoDampersInOnePlaceAreOneTwiceAsStrong) {
  Rows two({}, {}, {0, 1, 0, 1}), one({}, {}, {0, 1}, 1, kSteps, {}, 2);
  double apart = 0, size = 0, energy[2] = {};
  for (int k = 0; k < kPeriods; k++) {
    two.Step({Command(k), Command(k)});
    one.Step({Command(k)});
    apart = std::fmax(apart, std::fabs(two.Displacement(2) - one.Displacement(2)));
    size = std::fmax(size, std::fabs(one.Displacement(2)));
    NEAR(two.Of(1, 0), two.Of(1, 1), 1e-4 * std::fabs(two.Of(1, 0)) + 1e-4);
    energy[0] += two.criteria[5], energy[1] += one.criteria[5];
    for (int c = 2; c < 5; c++) NEAR(two.criteria[c], one.criteria[c], 1e-12);
  }
  CHECK(apart < 1e-4 * size);
  NEAR(energy[0], energy[1], 1e-3 * energy[1]);
}

// What the ground brings in is what the frame holds, its dashpots burn and the damper takes.
TEST(TheEnergyTakenInIsAccountedFor) {
  Frame f;
  f.damping = {0, 0, 0};
  Rows rows(f, {}, {1, 2});
  std::fill(rows.ground.begin() + 60, rows.ground.end(), 0.0);
  const auto held = [&] {
    double sum = 0, below = 0, rate = 0;
    for (int i = 0; i < 3; i++) {
      const double x = rows.state[3 + i], v = rows.state[6 + i];
      sum += 0.5 * f.mass[i] * v * v + 0.5 * f.stiffness[i] * (x - below) * (x - below);
      below = x;
      rate = v;
    }
    return rate == rate ? sum : NAN;
  };
  for (int k = 0; k < 20; k++) rows.Step({1.0});
  const double before = held();
  double taken = 0;
  for (int k = 0; k < 100; k++) {
    rows.Step({Command(k)});
    taken += rows.criteria[5];
  }
  CHECK(taken > 0.3 * before);
  NEAR(taken, before - held(), 5e-4 * before);
}

// On threads, in packs or alone: the same bits.
TEST(RowsDoNotHangOnEachOther) {
  Frame bent;
  bent.lag = {0.003, 0, 0.001};
  bent.friction = {20, 0, 5};
  const struct {
    std::vector<check::Setting> more;
    std::vector<int> between;
  } cases[] = {{{{"sensor_lag_tau", 0.002}}, {0, 1}},
               {{{"driver_lag_tau", 0.005}, {"n", 1.6}}, {0, 2}},
               {{}, {0, 1, 1, 2}},
               {{{"mount_compliance_k", 4e5}, {"backlash_gap", 2e-4}, {"seal_friction_coulomb", 30}}, {0, 1}},
               {{{"command_delay_d", 0.003}}, {0, 1}}};
  const int n = 37, lanes[] = {1, 2, 4, 8};
  for (const auto& one : cases) {
    const int dampers = static_cast<int>(one.between.size() / 2);
    const std::vector<double> noise(3 * 3 + 3 + 5 * dampers, 0.1);
    Rows many(bent, one.more, one.between, n, 5, noise), some(bent, one.more, one.between, n, 5, noise);
    for (int k = 0; k < 60; k++) {
      std::vector<double> u;
      for (int row = 0; row < n * dampers; row++) u.push_back(Command(k + row));
      many.Step(u);
      some.Step(u, k % 2 + 1, lanes[k % 4]);
    }
    CHECK(many.out == some.out && many.criteria == some.criteria && many.state == some.state);
    for (int row = 0; row < n; row += 12) {
      Rows alone(bent, one.more, one.between, 1, 5, noise);
      alone.Start(0, row);
      for (int k = 0; k < 60; k++) {
        std::vector<double> u;
        for (int d = 0; d < dampers; d++) u.push_back(Command(k + row * dampers + d));
        alone.Step(u);
      }
      CHECK(std::equal(alone.out.begin(), alone.out.end(), many.out.begin() + row * many.many));
    }
  }
}

TEST(ACopyOfTheStateGoesOnAlike) {
  const std::vector<double> noise(3 * 3 + 3 + 5, 0.1);
  Rows rows({}, {{"command_delay_d", 0.012}, {"heating_kappa", 0.01}, {"heating_capacity", 50}}, {0, 2}, 1, 5, noise);
  for (int k = 0; k < 30; k++) rows.Step({Command(k)});
  const std::vector<double> kept = rows.state;
  const auto on = [&] {
    for (int k = 30; k < 60; k++) rows.Step({Command(k)});
    return rows.out;
  };
  const std::vector<double> first = on();
  rows.state = kept;
  CHECK(on() == first);
}

TEST(NoiseIsWhiteAndOfTheSizeAskedFor) {
  std::vector<double> noise(3 * 3 + 3 + 5, 0.0);
  noise[1] = 0.3;
  noise[12] = 2;
  Rows noisy({}, {}, {0, 1}, 1, 5, noise), plain({}, {}, {0, 1}, 1, 5);
  double squares[2] = {}, sum[2] = {}, next = 0, cross = 0, before = 0;
  const int periods = 4000;
  for (int k = 0; k < periods; k++) {
    noisy.Step({1});
    plain.Step({1});
    const double a = noisy.Acceleration(2) - plain.Acceleration(2), b = noisy.Of(0) - plain.Of(0);
    squares[0] += a * a, squares[1] += b * b, sum[0] += a, sum[1] += b;
    next += a * before, cross += a * b, before = a;
    CHECK(noisy.Acceleration(1) == plain.Acceleration(1));
  }
  const double root = std::sqrt(periods);
  NEAR(std::sqrt(squares[0] / periods), 0.3, 4 * 0.3 / std::sqrt(2.0) / root);
  NEAR(std::sqrt(squares[1] / periods), 2, 4 * 2 / std::sqrt(2.0) / root);
  NEAR(sum[0] / periods, 0, 4 * 0.3 / root);
  NEAR(next / periods, 0, 4 * 0.09 / root);
  NEAR(cross / periods, 0, 4 * 0.6 / root);
}

TEST(TheLoadEndsWhereItIsSaid) {
  Rows rows({}, {}, {0, 1}, 4, 5);
  std::vector<double> ended = rows.ground, held = rows.ground;
  std::fill(ended.begin() + 50, ended.end(), 0.0);
  std::fill(held.begin() + 11, held.end(), held[10]);
  rows.loads[0].steps = 50;
  rows.loads[1].values = ended.data();
  rows.loads[2].samples = 11;
  rows.loads[3].values = held.data();
  for (int k = 0; k < 100; k++) rows.Step({1, 1, 1, 1});
  for (int i = 0; i < rows.many; i++) {
    NEAR(rows.out[i], rows.out[rows.many + i], 1e-12);
    NEAR(rows.out[2 * rows.many + i], rows.out[3 * rows.many + i], 1e-12);
  }
  CHECK(std::fabs(rows.Displacement(3, 0) - rows.Displacement(3, 2)) > 1e-5);
}

TEST(BadRowsAreTold) {
  char err[300] = "";
  const Frame frame;
  const mrdamp_frame f = frame.Of(0, 1);
  const std::vector<double> params = check::Parameters(kBoucWen);
  const int law = mrdamp_law_find("bouc_wen"), good[] = {0, 1}, bad[] = {0, 4}, nowhere[] = {-1, -1};
  const double largest = 2, none = 0;
  const mrdamp_dampers one{1, &law, nullptr, params.data(), &largest}, free{1, &law, nullptr, params.data(), &none};
  const mrdamp_dampers empty{0, &law, nullptr, params.data(), &largest};
  CHECK(!mrdamp_rows_frame(&f, &one, bad, kPeriod, 5, 1, err, sizeof err));
  HAS(err, "damper_between: [0, 4]");
  CHECK(!mrdamp_rows_frame(&f, &one, nowhere, kPeriod, 5, 1, err, sizeof err));
  HAS(err, "damper_between");
  CHECK(!mrdamp_rows_frame(&f, &one, good, 0, 5, 1, err, sizeof err));
  HAS(err, "period");
  CHECK(!mrdamp_rows_frame(&f, &one, good, kPeriod, 0, 1, err, sizeof err));
  HAS(err, "0 steps");
  CHECK(!mrdamp_rows_frame(&f, &empty, good, kPeriod, 5, 1, err, sizeof err));
  HAS(err, "0 dampers");
  CHECK(!mrdamp_rows_frame(&f, &free, good, kPeriod, 5, 1, err, sizeof err));
  HAS(err, "command_max of damper 1");
  mrdamp_rows* rows = mrdamp_rows_frame(&f, &one, good, kPeriod, 5, 1, err, sizeof err);
  std::vector<double> noise(mrdamp_rows_measurements(rows), 0.0);
  noise[3] = -1;
  CHECK(mrdamp_rows_noise(rows, noise.data(), err, sizeof err) != 0);
  HAS(err, "noise of measurement 4");
  mrdamp_rows_free(rows);
}

}  // namespace
