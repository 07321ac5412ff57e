// One damper through one record by the C entry, for tests.
#ifndef MRDAMP_TESTS_RECORD_RUN_H_
#define MRDAMP_TESTS_RECORD_RUN_H_

#include <cstring>
#include <vector>

#include "mrdamp.h"
#include "tests/check.h"

namespace check {

constexpr double kDt = 1e-3;  // s, of test records

struct Setting {
  const char* name;
  double value;
};

inline std::vector<double> Parameters(const std::vector<Setting>& settings) {
  std::vector<double> params(mrdamp_attribute_count());
  mrdamp_defaults(params.data());
  for (const Setting& s : settings) {
    int i = 0;
    while (i < mrdamp_attribute_count() && std::strcmp(s.name, mrdamp_attribute_name(i)) != 0) i++;
    That(i < mrdamp_attribute_count(), __FILE__, __LINE__, std::string("no attribute ") + s.name);
    if (i < mrdamp_attribute_count()) params[i] = s.value;
  }
  return params;
}

struct Record {
  double dt;
  std::vector<double> x, v, u;
  std::vector<double> a = {};  // empty: differentiated
};

// Samples of three functions of time.
template <class X, class V, class U>
Record Sample(double dt, int n, X x, V v, U u) {
  Record r{dt, {}, {}, {}, {}};
  for (int i = 0; i < n; i++) r.x.push_back(x(i * dt)), r.v.push_back(v(i * dt)), r.u.push_back(u(i * dt));
  return r;
}

// hold: the command is held between samples.
inline std::vector<double> Run(const char* law, const std::vector<Setting>& settings, const Record& r, int column,
                               bool hold = false, const mrdamp_narx* net = nullptr) {
  const std::vector<double> params = Parameters(settings);
  std::vector<double> out(r.x.size());
  const mrdamp_options options{hold, 1, 0, 0, 0};
  char err[300] = "";
  const int failed = mrdamp_run(mrdamp_law_find(law), net, 1, params.data(), r.dt, static_cast<int>(r.x.size()), r.x.data(),
                                r.v.empty() ? nullptr : r.v.data(), r.a.empty() ? nullptr : r.a.data(), r.u.data(), &options,
                                1, &column, out.data(), err, sizeof err);
  That(failed == 0, __FILE__, __LINE__, err);
  return out;
}

}  // namespace check

#endif  // MRDAMP_TESTS_RECORD_RUN_H_
