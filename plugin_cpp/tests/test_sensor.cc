// Stage sensor: gain, leakage, lag, offset, and the shift of the displacement channel.
#include "effects/sensor.h"
#include "tests/record_run.h"

using check::Record;
using check::Run;
using mrdamp::Sensor;
using mrdamp::SensorParams;

namespace {

TEST(NeutralSensorReadsTheForce) {
  const SensorParams p;
  Sensor s;
  s.Start(p, -3);
  CHECK(s.Read(p) == -3);
  s.Step(p, 17.25, 1e-3);
  CHECK(s.Read(p) == 17.25);
}

TEST(GainComesFirstAndOffsetLast) {
  SensorParams p;
  p.gain = 1.2, p.offset = -4, p.lag = 0.01;
  Sensor s;
  s.Start(p, 100);
  NEAR(s.Read(p), 116, 1e-12);
  for (int i = 0; i < 1000; i++) s.Step(p, 50, 1e-3);
  NEAR(s.Read(p), 56, 1e-9);
}

// Q' = F' - Q / tau for F = F0 + r t: Q = F0 exp(-t / tau) + r tau (1 - exp(-t / tau)), in steps of any size.
TEST(LeakageIsExactOnRamps) {
  SensorParams p;
  p.leakage = 0.3, p.gain = 1.1, p.offset = 2;
  for (const int steps : {1, 7, 400}) {
    Sensor s;
    s.Start(p, 80);
    const double end = 0.5, rate = -120;
    for (int k = 1; k <= steps; k++) s.Step(p, 80 + rate * end * k / steps, end / steps);
    const double decay = std::exp(-end / 0.3);
    NEAR(s.Read(p), 1.1 * (80 * decay + rate * 0.3 * (1 - decay)) + 2, 1e-11);
  }
}

TEST(AnOffsetThatSettlesIsExact) {
  SensorParams p;
  p.gain = 1.1, p.offset = 2, p.settle = -30, p.settle_time = 0.4;
  for (const int steps : {1, 7, 400}) {
    Sensor s;
    s.Start(p, 80);
    NEAR(s.Read(p), 88 + 2 - 30, 1e-11);
    for (int k = 1; k <= steps; k++) s.Step(p, 80, 0.6 / steps);
    NEAR(s.Read(p), 88 + 2 - 30 * std::exp(-0.6 / 0.4), 1e-11);
    s.Start(p, 80);  // a new run: set to zero again
    NEAR(s.Read(p), 60, 1e-11);
  }
}

TEST(AShareOfTheChargeLeaksByItself) {
  SensorParams p;
  p.leakage = 0.05, p.share = 0.3, p.leakage2 = 0.5, p.gain = 1.1;
  Sensor s;
  s.Start(p, 80);
  for (int k = 1; k <= 50; k++) {
    s.Step(p, 80, 1e-3);
    const double t = k * 1e-3;
    NEAR(s.Read(p), 88 * (0.7 * std::exp(-t / 0.05) + 0.3 * std::exp(-t / 0.5)), 1e-11);
  }
  p.leakage2 = 0;  // what does not leak stays
  for (int k = 0; k < 5000; k++) s.Step(p, 80, 1e-3);
  NEAR(s.Read(p), 0.3 * 88, 1e-9);
}

// A filter of second order is late by tau on a ramp, whatever its damping, and overshoots a step by exp(-pi z / sqrt(1 - z^2)).
TEST(AFilterOfSecondOrderIsLateByTau) {
  SensorParams p;
  p.lag = 0.01;
  for (const double ratio : {0.3, 0.7071, 0.9}) {
    p.ratio = ratio;
    Sensor s;
    s.Start(p, 5);
    for (int k = 1; k <= 1000; k++) s.Step(p, 5 + 2e-3 * k, 1e-3);
    NEAR(s.Read(p), 5 + 2 * (1 - 0.01), 1e-9);
    s.Start(p, 0);
    double most = 0;
    s.Step(p, 1, 1e-9);
    for (int k = 0; k < 20000; k++) {
      s.Step(p, 1, 1e-5);
      most = std::max(most, s.Read(p));
    }
    NEAR(most, 1 + std::exp(-M_PI * ratio / std::sqrt(1 - ratio * ratio)), 1e-4);
  }
}

TEST(AFilterOfThirdOrderIsLateByBoth) {
  SensorParams p;
  p.lag = 0.01, p.ratio = 0.7, p.lag2 = 0.004;
  Sensor s;
  s.Start(p, 5);
  for (int k = 1; k <= 1000; k++) s.Step(p, 5 + 2e-3 * k, 1e-3);
  NEAR(s.Read(p), 5 + 2 * (1 - 0.014), 1e-9);
}

TEST(LeakageForgetsAConstantForce) {
  SensorParams p;
  p.leakage = 0.05;
  Sensor s;
  s.Start(p, 80);
  for (int k = 1; k <= 50; k++) {
    s.Step(p, 80, 1e-3);
    NEAR(s.Read(p), 80 * std::exp(-k * 1e-3 / 0.05), 1e-11);
  }
}

TEST(LagIsExactOnRamps) {
  SensorParams p;
  p.lag = 0.02;
  for (const int steps : {1, 7, 400}) {
    Sensor s;
    s.Start(p, 10);
    const double end = 0.05, rate = 300;
    for (int k = 1; k <= steps; k++) s.Step(p, 10 + rate * end * k / steps, end / steps);
    NEAR(s.Read(p), 10 + rate * end - rate * 0.02 * (1 - std::exp(-end / 0.02)), 1e-11);
  }
}

TEST(TwoPolesMakeASecondOrderLag) {
  SensorParams p;
  p.lag = 0.02, p.lag2 = 0.005;
  Sensor s;
  s.Start(p, 0);
  const double h = 1e-4;
  s.Step(p, 100, 1e-12);  // as good as a step
  for (int k = 1; k <= 600; k++) {
    s.Step(p, 100, h);
    const double t = k * h;
    NEAR(s.Read(p), 100 * (1 - (0.02 * std::exp(-t / 0.02) - 0.005 * std::exp(-t / 0.005)) / 0.015), 0.02);
  }
}

TEST(NoTimeNoChangeOfTheLaggedReading) {
  SensorParams p;
  p.lag = 0.02;
  Sensor s;
  s.Start(p, 10);
  s.Step(p, 50, 0);
  CHECK(s.Read(p) == 10);
}

Record Sine(double shift) {
  const double w = 18;
  return check::Sample(
      1e-3, 500, [=](double t) { return 0.01 * std::sin(w * (t - shift)); },
      [=](double t) { return 0.01 * w * std::cos(w * (t - shift)); }, [](double) { return 1.0; });
}

TEST(SensorActsOnItsOwnColumnAlone) {
  const Record r = Sine(0);
  const std::vector<check::Setting> law = {{"c0a", 600}, {"c0b", 50}, {"fya", 100}, {"v_ref", 0.01}};
  std::vector<check::Setting> with = law;
  for (const check::Setting& s : {check::Setting{"sensor_gain_g", -1.3}, {"sensor_offset_f", 6}}) with.push_back(s);
  const auto plain = Run("bingham", law, r, MRDAMP_FORCE), read = Run("bingham", with, r, MRDAMP_FORCE);
  const auto reference = Run("bingham", with, r, MRDAMP_REFERENCE);
  for (std::size_t i = 0; i < plain.size(); i++) {
    NEAR(read[i], -1.3 * plain[i] + 6, 1e-9);
    CHECK(reference[i] == plain[i]);
  }
}

// x(t - d) is what the channel reads, so the force comes from the motion d ahead of it.
TEST(ChannelShiftIsTakenBack) {
  const std::vector<check::Setting> law = {{"c0a", 600}, {"c0b", 50}, {"fya", 100}, {"v_ref", 0.01}};
  for (const double shift : {0.0042, -0.0035}) {
    std::vector<check::Setting> late = law;
    late.push_back({"channel_shift_d", shift});
    const auto wanted = Run("bingham", law, Sine(0), MRDAMP_FORCE), got = Run("bingham", late, Sine(shift), MRDAMP_FORCE);
    for (int i = 10; i < 490; i++) NEAR(got[i], wanted[i], 1e-3);
    // Where the reading has no motion yet, or no more, it is taken to go on as it went.
    for (const int i : {0, 1, 2, 498, 499}) NEAR(got[i], wanted[i], 0.05 * 600);
  }
}

}  // namespace
