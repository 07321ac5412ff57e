// command_delay and driver_lag: the store of commands, the lag's closed form, and both in the chain.
#include <algorithm>

#include "effects/driver.h"
#include "tests/record_run.h"

using mrdamp::DelayLine;
using mrdamp::Lag;

namespace {

double Wave(double t) { return std::sin(3 * t) + 0.4 * std::cos(7 * t); }

// Pushes Wave at each h; at the end of each step the store is asked for t - delay.
struct Error {
  double hold = 0, lines = 0;
};
Error Worst(double delay, double h, double end) {
  DelayLine line;
  Error worst;
  for (int k = 0; k * h < end; k++) {
    const double t = k * h;
    line.Push(t, Wave(t), delay);
    if (t < delay) continue;
    worst.lines = std::fmax(worst.lines, std::fabs(line.At(t - delay, false) - Wave(t - delay)));
    worst.hold = std::fmax(worst.hold, std::fabs(line.At(t - delay, true) - Wave(t - delay)));
  }
  return worst;
}

// The store must reach back over the whole delay, however its length and the step fit together. Wave's largest
// slope is 5.8 1/s: late by one step plus one hundredth of the delay.
TEST(DelayHoldsAtAnyStep) {
  for (const double delay : {0.002, 0.02, 0.1, 0.2, 0.4, 1.0}) {
    for (const double h : {1e-4, 2e-4, 4e-4, 5e-4, 7e-4, 1e-3, 1.7e-3, 2e-3, 5e-3}) {
      const Error e = Worst(delay, h, 4 * delay + 1);
      const double late = 5.8 * (h + 0.011 * delay);
      if (e.lines > late || e.hold > late) std::fprintf(stderr, "delay %g s, step %g s:\n", delay, h);
      CHECK(e.lines <= late);
      CHECK(e.hold <= late);
    }
  }
}

TEST(FewCommandsComeBackExactly) {
  DelayLine line;
  CHECK(line.At(1, true) == 0);
  const double delay = 0.1;
  for (int k = 0; k < 1000; k++) {  // 50 commands a delay; the store has gone round many times
    const double t = 0.002 * k;
    line.Push(t, k, delay);
    if (k < 60) continue;
    CHECK(line.At(t - 0.0995, true) == k - 50);   // held since the sample before
    NEAR(line.At(t - 0.0995, false), k - 49.75, 1e-9);
    CHECK(line.At(t + 1, true) == k);
    NEAR(line.At(t - 1e-4, false), k - 0.05, 1e-9);
  }
}

TEST(BeforeTheStartIsTheFirstCommand) {
  DelayLine line;
  line.Push(0, 5, 0.1);
  line.Push(0.01, 6, 0.1);
  CHECK(line.At(-1, true) == 5);
  CHECK(line.At(-1, false) == 5);
}

TEST(ACommandAtTheSameTimeReplaces) {
  DelayLine line;
  line.Push(0, 1, 0.1);
  line.Push(0.01, 2, 0.1);
  line.Push(0.01, 3, 0.1);
  CHECK(line.count == 2);
  CHECK(line.At(0.02, true) == 3);
}

// A command that steps at 50 ms through the chain, both ways of reading it.
TEST(ChainDelaysAStep) {
  for (const double delay : {0.004, 0.02, 0.1, 0.25}) {
    for (const double dt : {2e-4, 5e-4, 1e-3, 2e-3}) {
      const int n = static_cast<int>((0.1 + 2 * delay) / dt);
      const auto still = [](double) { return 0.0; };
      const check::Record r = check::Sample(dt, n, still, still, [](double t) { return t < 0.05 - 1e-9 ? 0.0 : 1.0; });
      for (const bool hold : {true, false}) {
        const std::vector<double> current = check::Run("bingham", {{"c0a", 1}, {"command_delay_d", delay}}, r, MRDAMP_CURRENT, hold);
        const auto half = std::find_if(current.begin(), current.end(), [](double i) { return i > 0.5; });
        const double seen = (half - current.begin()) * dt - 0.05;
        if (std::fabs(seen - delay) > 1.01 * dt + 0.011 * delay) {
          std::fprintf(stderr, "delay %g s, step %g s, hold %d: %g s\n", delay, dt, hold, seen);
        }
        NEAR(seen, delay, 1.01 * dt + 0.011 * delay);
      }
    }
  }
}

// A clock's command is that of its last tick, also where the ticks meet changes of the command and rounded times.
TEST(AClockHoldsWhatItTook) {
  mrdamp::Params p;
  p.command_delay_d = 0.013, p.command_delay_period = 0.01, p.command_delay_phase = 0.3;
  DelayLine line;
  double time = 0;
  for (int k = 0; k <= 60; k++, time += 1e-3) line.Push(time, 1e-3 * k, mrdamp::Reach(p));
  // Ticks at 3, 13, 23, 33, 43 ms, which arrive 13 ms later.
  for (const bool hold : {false, true}) {
    NEAR(mrdamp::Arrived(line, p, 0.0459, hold), 0.023, 1.1e-6);
    NEAR(mrdamp::Arrived(line, p, 0.046, hold), 0.033, 1.1e-6);
    NEAR(mrdamp::Arrived(line, p, 0.0559, hold), 0.033, 1.1e-6);
    NEAR(mrdamp::NextJump(line, p, 0.046), 0.056, 1e-12);
    NEAR(mrdamp::NextJump(line, p, 0.0555), 0.056, 1e-12);
  }
}

TEST(LagIsExactForStepsAndRamps) {
  const double tau = 0.008;
  NEAR(Lag(0.2, 1, 1, tau, 0.003), 1 - 0.8 * std::exp(-0.003 / tau), 1e-15);
  // ramp u = 2 + 30 t from i = 0.5: i = u - 30 tau + (0.5 - 2 + 30 tau) exp(-t / tau)
  const double t = 0.011;
  NEAR(Lag(0.5, 2, 2 + 30 * t, tau, t), 2 + 30 * t - 30 * tau + (-1.5 + 30 * tau) * std::exp(-t / tau), 1e-14);
  double i = 0.5;
  for (int k = 0; k < 11; k++) i = Lag(i, 2 + 30 * 0.001 * k, 2 + 30 * 0.001 * (k + 1), tau, 0.001);
  NEAR(i, Lag(0.5, 2, 2 + 30 * t, tau, t), 1e-14);
  CHECK(Lag(0.5, 1, 3, 0, 0.001) == 3);
}

TEST(ChainLagsAStep) {
  const double dt = 1e-3, t1 = 0.012, t2 = 0.004;
  const auto still = [](double) { return 0.0; };
  const check::Record r = check::Sample(dt, 100, still, still, [](double t) { return t < 0.01 - 1e-9 ? 0.5 : 2.0; });
  const auto one = check::Run("bingham", {{"c0a", 1}, {"driver_lag_tau", t1}}, r, MRDAMP_CURRENT, true);
  const auto two = check::Run("bingham", {{"c0a", 1}, {"driver_lag_tau", t1}, {"driver_lag_tau2", t2}}, r, MRDAMP_CURRENT, true);
  for (int i = 0; i < 100; i++) {
    const double t = std::fmax(i - 10, 0) * dt;
    NEAR(one[i], 0.5 + 1.5 * (1 - std::exp(-t / t1)), 1e-12);
    NEAR(two[i], 0.5 + 1.5 * (1 - (t1 * std::exp(-t / t1) - t2 * std::exp(-t / t2)) / (t1 - t2)), 1e-12);
  }
}

// Two poles, also where one is fast against the step or both are equal: t exp(-t / tau) / tau then.
TEST(TwoPolesAreExactForSteps) {
  for (const double ratio : {1e-4, 0.02, 0.9999, 1.0, 1.0001, 50.0, 1e4}) {
    mrdamp::Params p;
    const double slow = p.driver_lag_tau = 0.002, fast = p.driver_lag_tau2 = ratio * slow;
    mrdamp::Coil coil;
    double sum = 0, t = 0;
    coil.Start(p, 0);
    for (int k = 0; k < 20; k++) {
      sum += 5e-4 * coil.Step(p, 1, 1, 5e-4);
      t += 5e-4;
      const double apart = std::fabs(ratio - 1) > 1e-8 ? (slow * std::exp(-t / slow) - fast * std::exp(-t / fast)) / (slow - fast)
                                                        : (1 + t / slow) * std::exp(-t / slow);
      NEAR(coil.current, 1 - apart, 1e-9);
    }
    // Both equations integrated: the current's mean lacks what the poles hold back.
    NEAR(sum, t - slow * coil.first.y - fast * coil.current, 1e-12);
  }
}

// A held command that arrives within a step: the current is that of the exact delay, whatever it is.
TEST(AHeldDelayIsExactBehindALag) {
  const auto still = [](double) { return 0.0; };
  const check::Record r = check::Sample(check::kDt, 60, still, still, [](double t) { return t < 0.02 - 1e-9 ? 0.0 : 1.0; });
  for (const double delay : {0.0, 1e-4, 3e-4, 5e-4, 8e-4, 1.2e-3}) {
    const auto current = check::Run("bingham", {{"c0a", 1}, {"driver_lag_tau", 0.005}, {"command_delay_d", delay}}, r,
                                    MRDAMP_CURRENT, true);
    for (int i = 0; i < 60; i++) {
      const double t = i * check::kDt - 0.02 - delay;
      NEAR(current[i], t > 0 ? 1 - std::exp(-t / 0.005) : 0, 1e-12);
    }
  }
}

// A force that jumps with the command reaches the reading through the filter, not before it, wherever in a step it jumps.
TEST(ASensorReadsAJumpAfterIt) {
  for (const double delay : {0.0, 7.3e-3, 1e-2}) for (const double dt : {2e-4, 1e-3, 5e-3}) {
    const int n = static_cast<int>(0.1 / dt + 0.5), at = static_cast<int>(0.05 / dt + 0.5);
    const check::Record r = check::Sample(dt, n, [](double t) { return 0.1 * t; }, [](double) { return 0.1; },
                                          [&](double t) { return t < 0.05 - 1e-9 ? 0.0 : 1.0; });
    const std::vector<check::Setting> damper = {{"c0a", 100}, {"fyb", 400}, {"v_ref", 1e-3}, {"sensor_lag_tau", 0.005}, {"command_delay_d", delay}};
    const auto force = check::Run("bingham", damper, r, MRDAMP_FORCE, true);
    for (int i = 0; i < n; i++) {
      const double t = (i - at) * dt - delay;
      NEAR(force[i], 10 + (t > 0 ? 400 * (1 - std::exp(-t / 0.005)) : 0), 1e-6);
    }
  }
}

TEST(PairOfPolesIsExactForSteps) {
  const double dt = 1e-3, tau = 0.02, zeta = 0.4, w = 2 * zeta / tau, wd = w * std::sqrt(1 - zeta * zeta);
  const auto still = [](double) { return 0.0; };
  const check::Record r = check::Sample(dt, 100, still, still, [](double t) { return t < 0.01 - 1e-9 ? 0.5 : 2.0; });
  const auto i = check::Run("bingham", {{"c0a", 1}, {"driver_lag_tau", tau}, {"driver_lag_ratio", zeta}}, r, MRDAMP_CURRENT, true);
  const auto slow = check::Run("bingham", {{"c0a", 1}, {"driver_lag_tau2", tau}, {"driver_lag_share", 0.25}}, r, MRDAMP_CURRENT, true);
  for (int k = 0; k < 100; k++) {
    const double t = std::fmax(k - 10, 0) * dt;
    NEAR(i[k], 2 - 1.5 * std::exp(-zeta * w * t) * (std::cos(wd * t) + zeta * w / wd * std::sin(wd * t)), 1e-12);
    if (k > 10) NEAR(slow[k], 2 - 0.25 * 1.5 * std::exp(-t / tau), 1e-12);
  }
}

TEST(DelayAndLagAddUp) {
  const double dt = 1e-3, tau = 0.01, delay = 0.02;
  const auto still = [](double) { return 0.0; };
  const check::Record r = check::Sample(dt, 120, still, still, [](double t) { return t < 0.01 - 1e-9 ? 0.0 : 1.0; });
  const auto i = check::Run("bingham", {{"c0a", 1}, {"driver_lag_tau", tau}, {"command_delay_d", delay}}, r, MRDAMP_CURRENT, true);
  for (int k = 0; k < 120; k++) NEAR(i[k], k <= 30 ? 0 : 1 - std::exp(-(k - 30) * dt / tau), 1e-9);
}

TEST(CommandIsClampedAheadOfTheDriver) {
  const auto still = [](double) { return 0.0; };
  const check::Record r = check::Sample(1e-3, 50, still, still, [](double t) { return 200 * (t - 0.02); });
  const auto i = check::Run("bingham", {{"c0a", 1}, {"command_min", -1}, {"command_max", 2.5}}, r, MRDAMP_CURRENT);
  for (int k = 0; k < 50; k++) NEAR(i[k], std::clamp(200 * (k * 1e-3 - 0.02), -1.0, 2.5), 1e-12);
}

}  // namespace
