// Dampers that are stepped together give what each gives alone, to the bit.
#include <cmath>
#include <string>
#include <vector>

#include "mrdamp.h"
#include "tests/check.h"
#include "tests/record_run.h"

namespace {

using check::Setting;
using Settings = std::vector<Setting>;

const struct {
  const char* name;
  Settings settings;
} kLaws[] = {
    {"bingham", {{"c0a", 600}, {"c0b", 300}, {"fya", 100}, {"fyb", 500}, {"v_ref", 0.01}}},
    {"bouc_wen", {{"c0a", 600}, {"alpha_a", 8e4}, {"alpha_b", 2e5}, {"gamma", 3e4}, {"beta", 5e4}, {"A", 120}, {"k0", 300}}},
    {"bouc_wen", {{"c0a", 600}, {"alpha_a", 8e4}, {"gamma", 5e4}, {"beta", 3e4}, {"A", 120}, {"n", 1.6}}},
    {"modified_bouc_wen",
     {{"c0a", 600}, {"c1a", 8e3}, {"c1b", 1e4}, {"alpha_a", 8e4}, {"gamma", 200}, {"beta", 300}, {"A", 120}, {"n", 1}, {"k1", 100}}},
    {"hyperbolic_tangent",
     {{"c0a", 600}, {"c1a", 8e3}, {"k0a", 500}, {"k1a", 8e4}, {"k1b", 5e4}, {"m0", 0.5}, {"f0a", 100}, {"f0b", 500}, {"v_ref", 0.01}}},
};

const Settings kEffects[] = {
    {},
    {{"driver_lag_tau", 0.02}, {"driver_lag_fall", 0.01}, {"driver_lag_tau2", 0.005}},
    {{"driver_lag_tau", 0.02}, {"driver_lag_gain", 3}, {"driver_lag_integral", 0.02}, {"driver_lag_limit", 3}},
    {{"saturation_i_s", 0.8}, {"remanence_b", 0.1}, {"remanence_d", 0.2}, {"remanence_up", 0.3}},
    {{"remanence_b", 0.1}, {"remanence_d", 0.2}, {"remanence_stops", 1}},
    {{"heating_kappa", 0.02}, {"heating_capacity", 100}, {"heating_loss", 1}, {"shear_thinning_m", 0.6}},
    {{"asymmetry_a", 0.1}, {"asymmetry_time", 0.02}},
    {{"trapped_gas_d", 0.4}, {"trapped_gas_s_g", 0.003}},
    {{"trapped_gas_force", 300}, {"trapped_gas_s_g", 0.003}, {"trapped_gas_series", 1}},
    {{"seal_friction_coulomb", 40}, {"seal_friction_breakaway", 1.5}, {"gas_spring_f0", 50}},
    {{"moving_mass_m", 2}, {"moving_mass_hz", 60}},
    {{"mount_compliance_k", 5e5}, {"backlash_gap", 0.001}},
    {{"mount_compliance_k", 5e5}, {"mount_compliance_friction", 30}, {"mount_compliance_slide", 1e-4}, {"mount_compliance_loss", 0.5}},
    {{"mount_compliance_k", 5e5}, {"seal_friction_coulomb", 40}, {"seal_friction_breakaway", 1.5}},
    {{"mount_compliance_k", 5e5}, {"moving_mass_m", 2}, {"backlash_gap", 0.0005}},
    {{"mount_compliance_k", 5e5}, {"trapped_gas_force", 300}, {"trapped_gas_s_g", 0.003}, {"trapped_gas_series", 1}},
    {{"sensor_lag_tau", 0.01}, {"sensor_lag_ratio", 0.6}, {"sensor_leakage_tau", 2}, {"channel_shift_d", 0.002}},
    {{"command_delay_d", 0.013}},
};

constexpr int kSets = 11, kColumn = MRDAMP_FORCE;

// Eleven dampers that differ by up to half in every parameter but those that are counts, through a long record and a
// short one that begins in motion.
std::vector<double> Runs(const char* law, const Settings& settings, int lanes, int threads) {
  std::vector<double> params;
  for (int k = 0; k < kSets; k++) {
    Settings own = settings;
    for (Setting& s : own) {
      const std::string name = s.name;
      const bool counts = name == "n" || name == "trapped_gas_series" || name == "remanence_stops" || name == "command_delay_d";
      if (!counts) s.value *= 1 + 0.05 * k;
    }
    const std::vector<double> one = check::Parameters(own);
    params.insert(params.end(), one.begin(), one.end());
  }
  const auto motion = [](double begin) {
    return check::Sample(
        check::kDt, begin > 0 ? 400 : 900, [=](double t) { return 0.01 * std::sin(11 * (t + begin)) + 0.004 * std::sin(27 * (t + begin)); },
        [=](double t) { return 0.11 * std::cos(11 * (t + begin)) + 0.108 * std::cos(27 * (t + begin)); },
        [](double t) { return 0.5 + 0.4 * std::sin(6 * t); });
  };
  const check::Record records[] = {motion(0), motion(0.07)};
  std::vector<double> out(kSets * (records[0].x.size() + records[1].x.size()));
  mrdamp_record both[2];
  double* at = out.data();
  for (int r = 0; r < 2; r++) {
    const check::Record& m = records[r];
    const int n = static_cast<int>(m.x.size());
    both[r] = {kSets, n, m.dt, 0, r, r, params.data(), m.x.data(), m.v.data(), nullptr, m.u.data(), at};
    at += kSets * n;
  }
  char err[300] = "";
  const int failed = mrdamp_run_records(mrdamp_law_find(law), nullptr, 2, both, threads, lanes, 1, &kColumn, err, sizeof err);
  check::That(failed == 0, __FILE__, __LINE__, err);
  return out;
}

}  // namespace

TEST(LanesDoNotShow) {
  for (const auto& law : kLaws) {
    for (const Settings& effects : kEffects) {
      Settings settings = law.settings;
      settings.insert(settings.end(), effects.begin(), effects.end());
      const std::vector<double> alone = Runs(law.name, settings, 1, 1);
      double size = 0;
      for (const double f : alone) size = std::fmax(size, std::fabs(f));
      CHECK(size > 10 && std::isfinite(size));
      const std::string what = std::string(law.name) + " " + (effects.empty() ? "" : effects[0].name);
      for (const int lanes : {2, 4, 8}) {
        check::That(Runs(law.name, settings, lanes, lanes == 8 ? 3 : 1) == alone, __FILE__, __LINE__, what);
      }
    }
  }
}
