// Rows of any linear structure and of a quarter car: closed forms, and what is refused.
#include <algorithm>

#include "tests/record_run.h"

namespace {

constexpr double kPeriod = 5e-3;

struct Modes {
  std::vector<double> frequency{12.0, 31.0}, ratio{0.01, 0.02}, stroke{0.0, 0.0}, at{0.5, -0.2};
  std::vector<double> params = check::Parameters({{"c0a", 100}, {"c0b", 0}, {"fya", 0}, {"fyb", 0}, {"v_ref", 0.1}});
  double largest = 1, mass = 2.5;

  mrdamp_rows* Make(int steps, char* err, int size) const {
    const int law = mrdamp_law_find("bingham");
    const mrdamp_dampers dampers{1, &law, nullptr, params.data(), &largest};
    const double unit[] = {1, 0, 0, 1};
    std::vector<double> rate(8);
    for (int i = 0; i < 2; i++) {
      rate[5 * i] = -frequency[i] * frequency[i];
      rate[5 * i + 2] = -2 * ratio[i] * frequency[i];
    }
    const mrdamp_linear linear{2, 2, rate.data(), unit, stroke.data(), stroke.data(), 1, at.data(), 0, mass};
    return mrdamp_rows_linear(&linear, &dampers, kPeriod, steps, err, size);
  }
};

// Oscillators under a step of force, whose measurements and mean squares are then those of the closed form.
TEST(ModesUnderAStepOfForce) {
  char err[300] = "";
  const Modes given;
  mrdamp_rows* rows = given.Make(4, err, sizeof err);
  check::That(rows != nullptr, __FILE__, __LINE__, err);
  const double force[] = {3, -40}, u = 0;
  const mrdamp_load load{force, 1, 1, 1 << 30};
  std::vector<double> state(mrdamp_rows_size(rows)), out(mrdamp_rows_measurements(rows)), criteria(MRDAMP_CRITERIA);
  mrdamp_rows_start(rows, 0, &load, state.data(), out.data());
  const auto free = [&](int i, double t, double* a) {
    const double w = given.frequency[i], s = given.ratio[i] * w, wd = std::sqrt(w * w - s * s), rest = force[i] / (w * w);
    const double decay = std::exp(-s * t), c = std::cos(wd * t), d = std::sin(wd * t);
    *a = rest * w * w * decay * (c - s / wd * d);
    return rest * (1 - decay * (c + s / wd * d));
  };
  for (int k = 1; k <= 200; k++) {
    mrdamp_rows_step(rows, 1, state.data(), &load, &u, criteria.data(), out.data(), 1, 0);
    double x = 0, a = 0, squares[2] = {};
    for (int i = 0; i < 2; i++) {
      double rate;
      x += given.at[i] * free(i, k * kPeriod, &rate);
      a += given.at[i] * rate;
      for (int j = 0; j < 4; j++) {
        const double at = (k - 1) * kPeriod + j * kPeriod / 4;
        double now;
        squares[0] += std::pow(free(i, at + kPeriod / 4, &now), 2);
        free(i, at, &now);
        squares[1] += now * now;
      }
    }
    NEAR(out[1], x, 1e-12);
    NEAR(out[0], a, 1e-9);
    NEAR(criteria[0], squares[0] / 4 / 2.5, 1e-12);
    NEAR(criteria[1], squares[1] / 4 / 2.5, 1e-7);
  }
  mrdamp_rows_free(rows);
}

// The same, at the place: mean squares and peaks of its acceleration and displacement over the steps' starts.
TEST(CriteriaOfAPlace) {
  char err[300] = "";
  Modes given;
  given.mass = 0;
  given.frequency[1] = 12;  // both as one
  given.ratio[1] = 0.01;
  mrdamp_rows* rows = given.Make(4, err, sizeof err);
  check::That(rows != nullptr, __FILE__, __LINE__, err);
  CHECK(mrdamp_rows_criteria(rows) == 8);
  const double force[] = {3, -40}, u = 0, w = 12, z = 0.01 * w, wd = std::sqrt(w * w - z * z), push = 0.5 * 3 + 0.2 * 40;
  const mrdamp_load load{force, 1, 1, 1 << 30};
  std::vector<double> state(mrdamp_rows_size(rows)), out(mrdamp_rows_measurements(rows)), criteria(8);
  mrdamp_rows_start(rows, 0, &load, state.data(), out.data());
  for (int k = 0; k < 100; k++) {
    mrdamp_rows_step(rows, 1, state.data(), &load, &u, criteria.data(), out.data(), 1, 0);
    double wanted[4] = {};
    for (int j = 0; j < 4; j++) {
      const double t = k * kPeriod + j * kPeriod / 4, decay = std::exp(-z * t), c = std::cos(wd * t), d = std::sin(wd * t);
      const double a = push * decay * (c - z / wd * d), x = push / (w * w) * (1 - decay * (c + z / wd * d));
      wanted[0] += a * a / 4;
      wanted[1] = std::max(wanted[1], std::fabs(a));
      wanted[2] += x * x / 4;
      wanted[3] = std::max(wanted[3], std::fabs(x));
    }
    for (int i = 0; i < 4; i++) NEAR(criteria[i], wanted[i], 1e-7);
  }
  mrdamp_rows_free(rows);
}

// A road that falls away faster than the wheel can follow: in flight nothing but the weight acts on both masses together.
TEST(CarOffTheRoad) {
  char err[300] = "";
  const double plain[] = {1, 0, 0, 0, 0}, largest = 2, u = 0.5;
  const std::vector<double> params = check::Parameters({{"c0a", 300}, {"c0b", 150}, {"alpha_a", 6000}, {"alpha_b", 25000}, {"gamma", 9e4},
                                                           {"beta", 6e4}, {"A", 150}, {"n", 2}, {"k0", 800}, {"x0", 0}});
  const int law = mrdamp_law_find("bouc_wen");
  const mrdamp_dampers dampers{1, &law, nullptr, params.data(), &largest}, none{0, &law, nullptr, params.data(), &largest};
  mrdamp_car car{400, 40, 2e4, 10, 2.1e5, 120, 440 * 9.81, 1, plain};
  mrdamp_rows* rows = mrdamp_rows_car(&car, &dampers, kPeriod, 5, 1, err, sizeof err);
  check::That(rows != nullptr, __FILE__, __LINE__, err);
  CHECK(mrdamp_rows_criteria(rows) == MRDAMP_CAR_CRITERIA);
  const double road = -150;
  const mrdamp_load load{&road, 1, 1, 1 << 30};
  std::vector<double> state(mrdamp_rows_size(rows)), out(mrdamp_rows_measurements(rows)), criteria(MRDAMP_CAR_CRITERIA);
  mrdamp_rows_start(rows, 0, &load, state.data(), out.data());
  int flying = 0;
  for (int k = 0; k < 40; k++) {
    mrdamp_rows_step(rows, 1, state.data(), &load, &u, criteria.data(), out.data(), 1, 0);
    // Wheel's and body's accelerations, their deflections to the road.
    const double tyre = std::max(car.weight - car.tyre_stiffness * out[2] - car.tyre_damping * out[4], 0.0);
    NEAR(40 * out[0] + 400 * out[1], tyre - car.weight, 2e-2);
    CHECK(criteria[0] >= 0 && criteria[3] >= 0 && criteria[4] >= 0 && criteria[4] <= 1);
    if (criteria[4] == 1) {
      NEAR(criteria[1], 1, 1e-9);
      flying++;
    }
  }
  CHECK(flying > 30);
  mrdamp_rows_free(rows);
  CHECK(!mrdamp_rows_car(&car, &none, kPeriod, 5, 1, err, sizeof err));
  HAS(err, "0 dampers");
  car.tyre_damping = -1;
  CHECK(!mrdamp_rows_car(&car, &dampers, kPeriod, 5, 1, err, sizeof err));
  HAS(err, "damping must be");
  car.tyre_stiffness = 0;
  CHECK(!mrdamp_rows_car(&car, &dampers, kPeriod, 5, 1, err, sizeof err));
  HAS(err, "masses, stiffnesses");
}

TEST(MatricesAreFinite) {
  char err[300] = "";
  Modes modes;
  modes.frequency[1] = HUGE_VAL;
  CHECK(!modes.Make(5, err, sizeof err));
  HAS(err, "finite");
}

}  // namespace
