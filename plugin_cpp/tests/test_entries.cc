// The C entries: arguments that are refused, threads, whole records against single steps.
#include <cstring>

#include "tests/record_run.h"

using check::Parameters;
using check::Record;
using check::Run;

namespace {

const std::vector<check::Setting> kSpencer = {{"c0a", 2100}, {"c0b", 350}, {"c1a", 28300}, {"c1b", 295}, {"k0", 4690},
                                              {"k1", 500}, {"alpha_a", 14000}, {"alpha_b", 69500}, {"gamma", 3.63e6},
                                              {"beta", 3.63e6}, {"A", 301}, {"n", 2}};

std::vector<check::Setting> And(std::vector<check::Setting> a, const std::vector<check::Setting>& b) {
  a.insert(a.end(), b.begin(), b.end());
  return a;
}

// Effects of every stage that keep a state.
const std::vector<check::Setting> kStates = {
    {"driver_lag_tau", 0.008}, {"driver_lag_tau2", 0.002}, {"command_delay_d", 0.004371}, {"saturation_i_s", 2},
    {"remanence_b", 0.05}, {"heating_kappa", 0.01}, {"heating_capacity", 5}, {"trapped_gas_d", 0.3}, {"asymmetry_a", 0.1},
    {"seal_friction_coulomb", 30}, {"sensor_leakage_tau", 0.5}, {"sensor_lag_tau", 0.002}, {"sensor_lag_tau2", 0.001}};

Record Motion(int n = 400, double dt = 1e-3) {
  return check::Sample(
      dt, n, [](double t) { return 0.01 * std::sin(31 * t) + 0.002 * std::sin(97 * t); },
      [](double t) { return 0.31 * std::cos(31 * t) + 0.194 * std::cos(97 * t); },
      [](double t) { return 1.1 + std::sin(43 * t); });
}

TEST(NumbersOfTheInterface) {
  CHECK(mrdamp_abi() == 14);
  CHECK(mrdamp_law_count() == 5);
  for (int law = 0; law < 5; law++) CHECK(mrdamp_law_find(mrdamp_law_name(law)) == law);
  CHECK(mrdamp_law_find("") == -1 && mrdamp_law_find("dahl") == -1);
  CHECK(mrdamp_attribute_count() > 80);
}

// ---- refusals: 1 and one terminated line ---------------------------------------------------------------

struct Call {
  int law = mrdamp_law_find("modified_bouc_wen");
  const mrdamp_narx* net = nullptr;
  std::vector<double> params = Parameters(kSpencer);
  Record r = Motion(10);
  int n = 10;
  std::vector<int> columns = {MRDAMP_FORCE};

  std::string Refused() {
    std::vector<double> out(200, -7);
    char err[300] = "";
    const int failed = mrdamp_run(law, net, 1, params.data(), r.dt, n, r.x.data(), r.v.data(), r.a.empty() ? nullptr : r.a.data(),
                                  r.u.data(), nullptr, static_cast<int>(columns.size()), columns.data(), out.data(), err, sizeof err);
    CHECK(failed == (err[0] != '\0'));
    if (failed) CHECK(out[0] == -7);
    CHECK(std::strchr(err, '\n') == nullptr);
    return err;
  }
};

template <class Change>
std::string Refused(Change change) {
  Call call;
  change(call);
  const std::string error = call.Refused();
  CHECK(!error.empty());
  return error;
}

TEST(ARecordIsChecked) {
  CHECK(Call().Refused().empty());
  HAS(Refused([](Call& c) { c.n = 2; }), "at least 3 samples, got 2");
  HAS(Refused([](Call& c) { c.n = -5; }), "got -5");
  for (const double dt : {0.0, -1e-3, double(NAN), double(INFINITY)}) HAS(Refused([=](Call& c) { c.r.dt = dt; }), "sample time");
  HAS(Refused([](Call& c) { c.r.x[4] = NAN; }), "displacement: sample 4 is not a finite number");
  HAS(Refused([](Call& c) { c.r.v[9] = INFINITY; }), "velocity: sample 9");
  HAS(Refused([](Call& c) { c.r.u[0] = -INFINITY; }), "command: sample 0");
  HAS(Refused([](Call& c) { c.r.a.assign(10, NAN); }), "acceleration: sample 0");
  HAS(Refused([](Call& c) { c.columns.push_back(MRDAMP_COLUMNS); }), "unknown column 8");
  HAS(Refused([](Call& c) { c.columns.push_back(-1); }), "unknown column -1");
}

TEST(NoSetsAndTooFew) {
  const Record r = Motion(10);
  const int column = MRDAMP_FORCE;
  char err[200] = "";
  const auto run = [&](int sets) {
    return mrdamp_run(0, nullptr, sets, nullptr, r.dt, 10, r.x.data(), r.v.data(), nullptr, r.u.data(), nullptr, 1, &column, nullptr,
                      err, sizeof err);
  };
  CHECK(run(0) == 0);
  CHECK(run(-1) == 1);
  HAS(err, "negative");
}

TEST(ADamperIsChecked) {
  for (const int law : {-1, 5, 1000000}) HAS(Refused([=](Call& c) { c.law = law; }), "law number " + std::to_string(law));
  HAS(Refused([](Call& c) { c.law = mrdamp_law_find("narx"); }), "needs `weights`");
  for (int i = 0; i < mrdamp_attribute_count(); i++) {
    const std::string name = mrdamp_attribute_name(i);
    HAS(Refused([=](Call& c) { c.params[i] = INFINITY; }), name);
    if (!std::isnan(mrdamp_attribute_default(i))) HAS(Refused([=](Call& c) { c.params[i] = NAN; }), name);
    const double min = mrdamp_attribute_min(i), max = mrdamp_attribute_max(i);
    if (std::isfinite(min)) HAS(Refused([=](Call& c) { c.params[i] = std::nextafter(min, -INFINITY) - 1e-9; }), name);
    if (std::isfinite(max)) HAS(Refused([=](Call& c) { c.params[i] = std::nextafter(max, INFINITY) + 1e-9; }), name);
  }
}

// mrdamp_check says what the runs say; mrdamp_damper_new too.
TEST(ChecksAgree) {
  std::vector<std::vector<double>> sets = {Parameters(kSpencer), Parameters(And(kSpencer, {{"c1a", 0}})),
                                           Parameters(And(kSpencer, {{"beta", -4e6}})), Parameters(And(kSpencer, {{"n", 0.9}}))};
  for (std::size_t k = 0; k < sets.size(); k++) {
    char err[300] = "", other[300] = "";
    const int law = mrdamp_law_find("modified_bouc_wen");
    CHECK(mrdamp_check(law, sets[k].data(), err, sizeof err) == (k > 0));
    mrdamp_damper* damper = mrdamp_damper_new(law, sets[k].data(), nullptr, other, sizeof other);
    CHECK((damper == nullptr) == (k > 0));
    CHECK(!std::strcmp(err, other));
    mrdamp_damper_free(damper);
  }
  char err[300];
  CHECK(mrdamp_check(99, sets[0].data(), err, sizeof err) == 1);
  CHECK(mrdamp_check(mrdamp_law_find("narx"), Parameters({}).data(), err, sizeof err) == 0);
}

TEST(AShortBufferIsTerminated) {
  for (const int size : {0, 1, 5, 20}) {
    char err[32];
    std::memset(err, '#', sizeof err);
    CHECK(mrdamp_check(-1, Parameters({}).data(), err, size) == 1);
    CHECK(err[size] == '#');
    if (size > 0) CHECK(err[size - 1] == '\0' || std::strlen(err) < static_cast<std::size_t>(size));
  }
  CHECK(mrdamp_check(-1, Parameters({}).data(), nullptr, 0) == 1);
}

TEST(AFrameIsChecked) {
  double mass[] = {90, 90}, stiffness[] = {5e5, 5e5}, damping[] = {50, 0}, friction[] = {0, 10};
  double one_sided[] = {0, -4e5}, ratio[] = {0, 0.7}, damping2[] = {0, 300};
  const std::vector<double> ground(10, 0.5), u(10, 0.0), params = Parameters({{"c0a", 100}});
  std::vector<double> out(11 * 10);
  const auto refused = [&](int storeys, int from, int to, int n = 10, double dt = 1e-3) {
    const mrdamp_frame f{storeys, mass, stiffness, damping, friction, from, to,
                         nullptr,  nullptr, nullptr,   nullptr, nullptr, nullptr, nullptr, one_sided, nullptr,
                         damping2, nullptr, nullptr,   ratio,    nullptr, nullptr, 0, 0, 0, 0, 0, 0};
    char err[300] = "";
    mrdamp_run_frame(0, nullptr, 1, params.data(), &f, dt, n, ground.data(), u.data(), nullptr, out.data(), err, sizeof err);
    return std::string(err);
  };
  CHECK(refused(2, 0, 1).empty() && refused(2, 0, 2).empty() && refused(2, -1, -1).empty());
  one_sided[0] = -5e5;
  HAS(refused(2, 0, 1), "one_sided, cubic of storey 1 are -500000, 0; allowed are finite numbers that leave a stiffness");
  one_sided[0] = 0;
  ratio[1] = 1;
  HAS(refused(2, 0, 1), "acc_ratio of floor 2 is 1; allowed are 0 up to, not including, 1");
  ratio[1] = 0.7;
  damping2[1] = -1;
  HAS(refused(2, 0, 1), "damping2 of storey 2 is -1");
  damping2[1] = 300;
  HAS(refused(0, 0, 1), "0 storeys; allowed are 1 to 200");
  HAS(refused(201, 0, 1), "201 storeys");
  HAS(refused(2, 1, 1), "damper_between: [1, 1]");
  HAS(refused(2, 0, 3), "of 0 (ground) to 2");
  HAS(refused(2, 3, 0), "damper_between: [3, 0]");
  HAS(refused(2, -1, 2), "damper_between: [-1, 2]");
  HAS(refused(2, 0, 1, 1), "at least 2 samples");
  HAS(refused(2, 0, 1, 10, 0), "sample time");
  mass[1] = 0;
  HAS(refused(2, 0, 1), "mass_kg of storey 2 is 0; it must be a finite number above 0");
  mass[1] = 90, stiffness[0] = NAN;
  HAS(refused(2, 0, 1), "stiffness_n_m of storey 1 is nan");
  stiffness[0] = 5e5, damping[1] = -1;
  HAS(refused(2, 0, 1), "damping_n_s_m of storey 2 is -1; it must be a finite number of at least 0");
  damping[1] = 0, friction[0] = INFINITY;
  HAS(refused(2, 0, 1), "friction of storey 1 is inf");
}

// ---- the same bits -----------------------------------------------------------------------------------------

bool SameBits(const std::vector<double>& a, const std::vector<double>& b) {
  return a.size() == b.size() && !std::memcmp(a.data(), b.data(), a.size() * sizeof(double));
}

TEST(ThreadsDoNotChangeABit) {
  const int sets = 24, n = 300, columns[] = {MRDAMP_FORCE, MRDAMP_STATE, MRDAMP_TEMPERATURE, MRDAMP_CURRENT};
  const Record r = Motion(n);
  std::vector<double> params;
  for (int k = 0; k < sets; k++) {
    std::vector<double> one = Parameters(And(kSpencer, kStates));
    for (int i = 0; i < 6; i++) one[i] *= 1 + 0.03 * k;
    if (k % 3 == 1) one = Parameters(And(kSpencer, {{"mount_compliance_k", 1e5 + k}}));
    params.insert(params.end(), one.begin(), one.end());
  }
  const auto run = [&](int threads) {
    std::vector<double> out(static_cast<std::size_t>(sets) * 4 * n);
    const mrdamp_options options{0, threads, 0, 0, 0};
    CHECK(mrdamp_run(mrdamp_law_find("modified_bouc_wen"), nullptr, sets, params.data(), r.dt, n, r.x.data(), r.v.data(), nullptr,
                     r.u.data(), &options, 4, columns, out.data(), nullptr, 0) == 0);
    return out;
  };
  const std::vector<double> one = run(1);
  for (const int threads : {0, 2, 4, 24, 60}) CHECK(SameBits(run(threads), one));
  // and the sets do not see each other
  std::vector<double> alone(4 * n);
  CHECK(mrdamp_run(mrdamp_law_find("modified_bouc_wen"), nullptr, 1, params.data() + 7 * mrdamp_attribute_count(), r.dt, n,
                   r.x.data(), r.v.data(), nullptr, r.u.data(), nullptr, 4, columns, alone.data(), nullptr, 0) == 0);
  const mrdamp_options held{1, 4, 0, 0, 0};
  std::vector<double> all(static_cast<std::size_t>(sets) * 4 * n);
  CHECK(mrdamp_run(mrdamp_law_find("modified_bouc_wen"), nullptr, sets, params.data(), r.dt, n, r.x.data(), r.v.data(), nullptr,
                   r.u.data(), &held, 4, columns, all.data(), nullptr, 0) == 0);
  CHECK(!std::memcmp(alone.data(), all.data() + 7 * 4 * n, alone.size() * sizeof(double)));
}

TEST(FramesOnThreadsDoNotChangeABit) {
  const int sets = 6, n = 200;
  double mass[] = {98.3, 98.3, 98.3}, stiffness[] = {5.16e5, 6.84e5, 6.84e5}, damping[] = {125, 50, 50}, friction[] = {20, 0, 5};
  std::vector<mrdamp_frame> frames;
  std::vector<double> params, ground(n), u(n, 1.0);
  std::size_t size = 0;
  for (int k = 0; k < sets; k++) {
    mrdamp_frame f{};
    f.storeys = 1 + k % 3;
    f.mass = mass, f.stiffness = stiffness, f.damping = damping, f.friction = k % 2 ? friction : nullptr;
    f.damper_to = 1;
    frames.push_back(f);
    const std::vector<double> one = Parameters(And(kSpencer, {{"c0a", 1000.0 + 100 * k}}));
    params.insert(params.end(), one.begin(), one.end());
    size += static_cast<std::size_t>(2 * (1 + k % 3) + 7) * n;
  }
  for (int k = 0; k < n; k++) ground[k] = 2 * std::sin(0.03 * k);
  const auto run = [&](int threads) {
    std::vector<double> out(size);
    const mrdamp_options options{0, threads, 0, 0, 0};
    CHECK(mrdamp_run_frame(mrdamp_law_find("modified_bouc_wen"), nullptr, sets, params.data(), frames.data(), 1e-3, n, ground.data(),
                           u.data(), &options, out.data(), nullptr, 0) == 0);
    return out;
  };
  CHECK(SameBits(run(1), run(4)));
}

// ---- one sample after the other ------------------------------------------------------------------------------

std::vector<double> Step(const char* law, const std::vector<check::Setting>& settings, const Record& r, int column,
                         mrdamp_damper* reuse = nullptr) {
  char err[300] = "";
  mrdamp_damper* damper =
      reuse ? reuse : mrdamp_damper_new(mrdamp_law_find(law), Parameters(settings).data(), nullptr, err, sizeof err);
  check::That(damper != nullptr, __FILE__, __LINE__, err);
  std::vector<double> out;
  for (std::size_t i = 0; i < r.x.size(); i++) {
    const double force = mrdamp_damper_step(damper, r.dt, r.x[i], r.v[i], r.u[i > 0 ? i - 1 : 0]);
    CHECK(force == mrdamp_damper_value(damper, MRDAMP_FORCE));
    out.push_back(mrdamp_damper_value(damper, column));
  }
  CHECK(std::isnan(mrdamp_damper_value(damper, MRDAMP_COLUMNS)) && std::isnan(mrdamp_damper_value(damper, -1)));
  if (!reuse) mrdamp_damper_free(damper);
  return out;
}

// u of a step is held over it, as with hold = 1 in a record. (Without lag and delay a record's sample already
// feels its own command; with a lag the two are the same.)
TEST(StepsAreTheRecord) {
  const Record r = Motion();
  const std::vector<check::Setting> lag = And(kSpencer, {{"driver_lag_tau", 0.005}});
  for (const auto& settings : {lag, And(kSpencer, kStates), And(lag, {{"mount_compliance_k", 3e5}, {"backlash_gap", 1e-4}})}) {
    for (const int column : {MRDAMP_FORCE, MRDAMP_TRUE, MRDAMP_STATE, MRDAMP_CURRENT, MRDAMP_FIELD, MRDAMP_TEMPERATURE, MRDAMP_PISTON}) {
      const double apart = check::Difference(Step("modified_bouc_wen", settings, r, column),
                                             Run("modified_bouc_wen", settings, r, column, true));
      check::That(apart < 1e-9, __FILE__, __LINE__, "column " + std::to_string(column) + ": " + check::Text(apart));
    }
  }
  // no lag: the same where the command stands still
  Record still = Motion();
  still.u.assign(still.u.size(), 1.7);
  CHECK(check::Difference(Step("modified_bouc_wen", kSpencer, still, MRDAMP_FORCE),
                          Run("modified_bouc_wen", kSpencer, still, MRDAMP_FORCE, true)) < 1e-12);
}

TEST(ResetStartsAgain) {
  const std::vector<check::Setting> settings = And(kSpencer, kStates);
  mrdamp_damper* damper = mrdamp_damper_new(mrdamp_law_find("modified_bouc_wen"), Parameters(settings).data(), nullptr, nullptr, 0);
  const auto first = Step("modified_bouc_wen", settings, Motion(), MRDAMP_FORCE, damper);
  mrdamp_damper_reset(damper);
  CHECK(SameBits(Step("modified_bouc_wen", settings, Motion(), MRDAMP_FORCE, damper), first));
  mrdamp_damper_free(damper);
}

TEST(AStepOfNoTimeChangesNothing) {
  mrdamp_damper* damper = mrdamp_damper_new(mrdamp_law_find("modified_bouc_wen"), Parameters(kSpencer).data(), nullptr, nullptr, 0);
  mrdamp_damper_step(damper, 1e-3, 0, 0, 1);
  const double force = mrdamp_damper_step(damper, 1e-3, 1e-4, 0.1, 1);
  for (const double dt : {0.0, -1.0}) CHECK(mrdamp_damper_step(damper, dt, 1e-4, 0.1, 1) == force);
  mrdamp_damper_free(damper);
}

// What a column holds does not depend on which others are asked for, nor v on being left out where it is linear.
TEST(ColumnsAndDerivatives) {
  Record r = check::Sample(1e-3, 100, [](double t) { return 0.02 * t + 0.5 * t * t; }, [](double t) { return 0.02 + t; },
                           [](double) { return 1.0; });
  const std::vector<check::Setting> p = {{"c0a", 700}, {"moving_mass_m", 3}};
  const auto given = Run("bingham", p, r, MRDAMP_FORCE);
  r.v.clear();
  const auto differentiated = Run("bingham", p, r, MRDAMP_FORCE);
  for (int i = 0; i < 100; i++) {
    NEAR(given[i], 700 * (0.02 + i * 1e-3) + 3, 1e-8);
    NEAR(differentiated[i], given[i], 1e-6);
  }
}

}  // namespace
