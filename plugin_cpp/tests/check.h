// A test file is one program: TEST(name) { ... }, checks that count, and an exit code.
#ifndef MRDAMP_TESTS_CHECK_H_
#define MRDAMP_TESTS_CHECK_H_

#include <cmath>
#include <cstdio>
#include <string>
#include <vector>

namespace check {

struct Case {
  const char* name;
  void (*body)();
};

inline std::vector<Case>& Cases() {
  static std::vector<Case> cases;
  return cases;
}

inline int failures = 0, checks = 0;

struct Registered {
  Registered(const char* name, void (*body)()) { Cases().push_back({name, body}); }
};

inline void That(bool holds, const char* file, int line, const std::string& what) {
  checks++;
  if (holds) return;
  failures++;
  std::fprintf(stderr, "%s:%d: %s\n", file, line, what.c_str());
}

inline std::string Text(double v) {
  char text[40];
  std::snprintf(text, sizeof text, "%.17g", v);
  return text;
}

inline void Near(double got, double wanted, double tolerance, const char* file, int line, const std::string& what) {
  That(std::fabs(got - wanted) <= tolerance, file, line,
       what + ": got " + Text(got) + ", wanted " + Text(wanted) + " within " + Text(tolerance));
}

inline void Has(const std::string& text, const std::string& part, const char* file, int line) {
  That(text.find(part) != std::string::npos, file, line, "'" + text + "' has no '" + part + "'");
}

// Largest |a - b| over the largest |b|.
inline double Difference(const std::vector<double>& a, const std::vector<double>& b) {
  if (a.size() != b.size()) return INFINITY;
  double apart = 0, size = 0;
  for (std::size_t i = 0; i < a.size(); i++) {
    if (!std::isfinite(a[i])) return INFINITY;
    apart = std::fmax(apart, std::fabs(a[i] - b[i]));
    size = std::fmax(size, std::fabs(b[i]));
  }
  return apart > 0 ? apart / size : 0;
}

}  // namespace check

#define TEST(name)                                           \
  static void name();                                        \
  static const check::Registered registered_##name(#name, name); \
  static void name()
#define CHECK(condition) check::That(condition, __FILE__, __LINE__, #condition)
#define NEAR(got, wanted, tolerance) check::Near(got, wanted, tolerance, __FILE__, __LINE__, #got)
#define HAS(text, part) check::Has(text, part, __FILE__, __LINE__)

int main() {
  for (const check::Case& c : check::Cases()) {
    const int before = check::failures;
    c.body();
    std::printf("%s %s\n", check::failures == before ? "ok  " : "FAIL", c.name);
  }
  std::printf("%zu tests, %d checks, %d failures\n", check::Cases().size(), check::checks, check::failures);
  return check::failures == 0 && check::checks > 0 ? 0 : 1;
}

#endif  // MRDAMP_TESTS_CHECK_H_
