// The elementary functions of the chain against those of the C library in extended precision.
#include <cmath>

#include "core/real.h"
#include "tests/check.h"

namespace {

// Largest relative error over a range, near zero too.
template <class F, class G>
double Worst(double low, double high, F f, G exact) {
  double worst = 0;
  for (int i = 0; i < 100000; i++) {
    const double part = (i + 0.5) / 100000, scale = i % 2 ? std::pow(10.0, -(i % 97) / 8.0) : 1;
    const double x = (low + part * (high - low)) * scale;
    const long double right = exact(static_cast<long double>(x));
    const double off = static_cast<double>(std::fabs((f(x) - right) / right));
    if (!(off <= worst)) worst = off;
  }
  return worst;
}

}  // namespace

TEST(ElementaryFunctionsAreThoseOfTheLibrary) {
  CHECK(Worst(-700, 700, [](double x) { return mrdamp::exp(x); }, [](long double x) { return std::exp(x); }) < 5e-16);
  CHECK(Worst(-30, 30, [](double x) { return mrdamp::expm1(x); }, [](long double x) { return std::expm1(x); }) < 2e-15);
  CHECK(Worst(-20, 20, [](double x) { return mrdamp::tanh(x); }, [](long double x) { return std::tanh(x); }) < 2e-15);
  CHECK(Worst(1e-9, 1e9, [](double x) { return mrdamp::log(x); }, [](long double x) { return std::log(x); }) < 1e-15);
  CHECK(Worst(-0.9, 3, [](double x) { return mrdamp::log1p(x); }, [](long double x) { return std::log1p(x); }) < 1e-15);
  CHECK(Worst(-0.99, 0.99, [](double x) { return mrdamp::atanh(x); }, [](long double x) { return std::atanh(x); }) < 4e-15);
  CHECK(Worst(-50, 50, [](double x) { return mrdamp::atan(x); }, [](long double x) { return std::atan(x); }) < 1e-15);
  CHECK(Worst(-1.5, 1.5, [](double x) { return mrdamp::tan(x); }, [](long double x) { return std::tan(x); }) < 3e-14);
  CHECK(Worst(1e-3, 50, [](double x) { return mrdamp::pow(x, 1.6); }, [](long double x) { return std::pow(x, 1.6L); }) < 1e-14);
}

TEST(ElementaryFunctionsAtTheirEnds) {
  CHECK(mrdamp::exp(0) == 1 && mrdamp::expm1(0) == 0 && mrdamp::tanh(0) == 0 && mrdamp::log(1) == 0 && mrdamp::pow(1, 3.7) == 1);
  CHECK(mrdamp::tanh(1e300) == 1 && mrdamp::tanh(-1e300) == -1);
  CHECK(mrdamp::exp(-1e4) < 1e-300 && mrdamp::exp(1e4) > 1e300);
  CHECK(mrdamp::pow(0, 2) == 0 && mrdamp::pow(0, 0) == 1);
  CHECK(std::isnan(mrdamp::exp(NAN)) && std::isnan(mrdamp::tanh(NAN)) && std::isnan(mrdamp::log(NAN)) && std::isnan(mrdamp::pow(NAN, 2)));
}
