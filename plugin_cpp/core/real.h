// The number type of the chain: a double, or a pack of doubles (-DMRDAMP_LANES=8), one for each of several dampers that
// are stepped together.
//
// What may differ between lanes is chosen by Select; a branch is entered where Any lane asks for it. What is alike in all
// lanes of a pack (which effects a damper has, steps of time) is read by Head from the first. Every lane does what it
// would do alone, and the elementary functions are the same for both types, so that a pack gives a double's bits.
#ifndef MRDAMP_CORE_REAL_H_
#define MRDAMP_CORE_REAL_H_

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>

namespace mrdamp {

inline constexpr double kPi = 3.14159265358979323846;
inline constexpr double kInf = std::numeric_limits<double>::infinity();
inline constexpr double kUnset = std::numeric_limits<double>::quiet_NaN();

using std::fabs;
using std::isfinite;
using std::isnan;
using std::sqrt;

inline double Select(bool m, double a, double b) { return m ? a : b; }
inline bool Any(bool m) { return m; }
inline bool All(bool m) { return m; }
inline double Head(double x) { return x; }
// As std::max and std::min of <algorithm>; max(a, b) is a where either is NaN.
inline double max(double a, double b) { return a < b ? b : a; }
inline double min(double a, double b) { return b < a ? b : a; }

// Bits of a number as integers and back; `m ? a : b` for them.
inline std::int64_t Bits(double x) {
  std::int64_t i;
  std::memcpy(&i, &x, sizeof i);
  return i;
}
inline double Number(std::int64_t i, double) {
  double x;
  std::memcpy(&x, &i, sizeof x);
  return x;
}

#ifdef MRDAMP_LANES
inline constexpr int kLanes = MRDAMP_LANES;
typedef double Vector __attribute__((vector_size(8 * MRDAMP_LANES)));
typedef std::int64_t Integers __attribute__((vector_size(8 * MRDAMP_LANES)));

inline Integers Bits(Vector x) { return (Integers)x; }
inline Vector Number(Integers i, Vector) { return (Vector)i; }

struct Mask {
  Integers a;

  Mask() = default;
  Mask(bool b) : a(Integers{} - (b ? 1 : 0)) {}
  explicit Mask(Integers i) : a(i) {}
  friend Mask operator&&(Mask x, Mask y) { return Mask(x.a & y.a); }
  friend Mask operator||(Mask x, Mask y) { return Mask(x.a | y.a); }
  Mask operator!() const { return Mask(~a); }
  friend bool Any(Mask m) {
#if defined(__AVX512F__) && MRDAMP_LANES == 8
    typedef long long W __attribute__((vector_size(64)));
    return __builtin_ia32_ptestmq512((W)m.a, (W)m.a, 0xff) != 0;
#elif defined(__AVX__) && MRDAMP_LANES == 4
    typedef long long W __attribute__((vector_size(32)));
    return !__builtin_ia32_ptestz256((W)m.a, (W)m.a);
#else
    std::int64_t some = 0;
    for (int l = 0; l < kLanes; l++) some |= m.a[l];
    return some != 0;
#endif
  }
  friend bool All(Mask m) { return !Any(!m); }
};

struct Real {
  Vector a;

  Real() : a(Vector{}) {}
  Real(double x) : a(Vector{} + x) {}
  explicit Real(Vector x) : a(x) {}
  double operator[](int lane) const { return a[lane]; }
  void Set(int lane, double x) { a[lane] = x; }

#define MRDAMP_OPERATOR(op)                                                   \
  friend Real operator op(Real x, Real y) { return Real(Vector(x.a op y.a)); } \
  Real& operator op##=(Real y) { return *this = *this op y; }
  MRDAMP_OPERATOR(+)
  MRDAMP_OPERATOR(-)
  MRDAMP_OPERATOR(*)
  MRDAMP_OPERATOR(/)
#undef MRDAMP_OPERATOR
#define MRDAMP_OPERATOR(op) \
  friend Mask operator op(Real x, Real y) { return Mask(Integers(x.a op y.a)); }
  MRDAMP_OPERATOR(<)
  MRDAMP_OPERATOR(>)
  MRDAMP_OPERATOR(<=)
  MRDAMP_OPERATOR(>=)
  MRDAMP_OPERATOR(==)
  MRDAMP_OPERATOR(!=)
#undef MRDAMP_OPERATOR
  Real operator-() const { return Real(Vector(-a)); }
  friend double Head(Real x) { return x.a[0]; }
  friend Mask isnan(Real x) { return x != x; }
  friend Mask isfinite(Real x) { return x - x == 0; }
  friend Real fabs(Real x) { return Real(Vector((Integers)x.a & INT64_MAX)); }
  friend Real sqrt(Real x) {
#if defined(__AVX512F__) && MRDAMP_LANES == 8
    return Real(Vector(__builtin_ia32_sqrtpd512_mask(x.a, x.a, -1, 4)));
#elif defined(__AVX__) && MRDAMP_LANES == 4
    return Real(Vector(__builtin_ia32_sqrtpd256(x.a)));
#else
    for (int l = 0; l < kLanes; l++) x.a[l] = std::sqrt(x.a[l]);
    return x;
#endif
  }
};

inline Real Select(Mask m, Real x, Real y) { return Real(Vector(m.a ? x.a : y.a)); }
inline Real max(Real x, Real y) { return Select(x < y, y, x); }
inline Real min(Real x, Real y) { return Select(y < x, y, x); }
#else
inline constexpr int kLanes = 1;
using Real = double;
using Mask = bool;
#endif

inline Real fmax(Real x, Real y) { return max(x, y); }
inline Real fmin(Real x, Real y) { return min(x, y); }
inline Real copysign(Real x, Real y) { return Select(y < 0, -fabs(x), fabs(x)); }

// Elementary functions of a double or a vector of them: a few units in the last place (tests/test_real.cc).
namespace elementary {

constexpr double kMagic = 0x1.8p52, kLn2High = 0x1.62e42fee00000p-1, kLn2Low = 0x1.a39ef35793c76p-33;

// x = k ln 2 + r: r, and 2^k as a number. Beyond its range x stands at the end: exp is between 3e-308 and 8e307.
template <class V>
V Reduce(V x, V* power) {
  x = x < -708.0 ? V{} - 708.0 : x;
  x = x > 709.0 ? V{} + 709.0 : x;
  const V t = x * 1.4426950408889634 + kMagic, n = t - kMagic;
  *power = Number(((Bits(t) - Bits(V{} + (kMagic - 1023))) & 0x7ff) << 52, x);
  return (x - n * kLn2High) - n * kLn2Low;
}

// (exp(r) - 1 - r) / r^2 for |r| < 0.35, its series
template <class V>
V Tail(V r) {
  const V r2 = r * r, r4 = r2 * r2;
  const V a = (1.0 / 2 + r * (1.0 / 6)) + r2 * (1.0 / 24 + r * (1.0 / 120));
  const V b = (1.0 / 720 + r * (1.0 / 5040)) + r2 * (1.0 / 40320 + r * (1.0 / 362880));
  const V c = (1.0 / 3628800 + r * (1.0 / 39916800)) + r2 * (1.0 / 479001600);
  return a + r4 * b + r4 * r4 * c;
}

template <class V>
V Exp(V x) {
  V power;
  const V r = Reduce(x, &power);
  return power + power * (r + r * r * Tail(r));
}

template <class V>
V Expm1(V x) {
  V power;
  const V r = Reduce(x, &power);
  return power * (r + r * r * Tail(r)) + (power - 1.0);
}

// of a large one, by its exponential
template <class V>
V Tanh(V x) {
  const auto sign = Bits(x) & INT64_MIN;
  V y = Number(Bits(x) & INT64_MAX, x) * 2.0;
  y = y > 80.0 ? V{} + 80.0 : y;
  const V e = Expm1(y);
  return Number(Bits(e / (e + 2.0)) | sign, x);
}

// of |x| < 0.06, its series
template <class V>
V TanhNear(V x) {
  const V s = x * x;
  return x * (1.0 - s * (1.0 / 3 - s * (2.0 / 15 - s * (17.0 / 315 - s * (62.0 / 2835 - s * (1382.0 / 155925))))));
}

// x > 0 (the algorithm and coefficients of fdlibm); below 2.3e-308 as there.
template <class V>
V Log(V x) {
  x = x < 2.3e-308 ? V{} + 2.3e-308 : x;
  constexpr std::int64_t root = 0x3fe6a09e667f3bcd;
  const auto from = Bits(x) - root;
  const V n = Number((from >> 52) + Bits(V{} + kMagic), x) - kMagic;
  const V f = Number((from & 0xfffffffffffff) + root, x) - 1.0, s = f / (2.0 + f), z = s * s, w = z * z, h = f * f * 0.5;
  const V t1 = w * (3.999999999940941908e-01 + w * (2.222219843214978396e-01 + w * 1.531383769920937332e-01));
  const V t2 = z * (6.666666666666735130e-01 +
                    w * (2.857142874366239149e-01 + w * (1.818357216161805012e-01 + w * 1.479819860510658591e-01)));
  return x != x ? x : n * kLn2High - ((h - (s * (h + (t1 + t2)) + n * kLn2Low)) - f);
}

// |x| < pi / 2, by that of x / 2
template <class V>
V Tan(V x) {
  const V h = x * 0.5, z = h * h, z2 = z * z, z4 = z2 * z2;
  const V s0 = (1.0 - z * (1.0 / 6)) + z2 * (1.0 / 120 - z * (1.0 / 5040));
  const V s1 = (1.0 / 362880 - z * (1.0 / 39916800)) + z2 * (1.0 / 6227020800 - z * (1.0 / 1307674368000));
  const V c0 = (1.0 - z * (1.0 / 2)) + z2 * (1.0 / 24 - z * (1.0 / 720));
  const V c1 = (1.0 / 40320 - z * (1.0 / 3628800)) + z2 * (1.0 / 479001600 - z * (1.0 / 87178291200));
  const V t = h * (s0 + z4 * s1) / (c0 + z4 * c1);
  return 2.0 * t / (1.0 - t * t);
}

// the algorithm and coefficients of fdlibm, reduced to |x| < tan(pi / 8)
template <class V>
V Atan(V x) {
  const auto sign = Bits(x) & INT64_MIN;
  V y = Number(Bits(x) & INT64_MAX, x);
  const auto big = y > 1.0;
  y = big ? 1.0 / y : y;
  const auto high = y > 0.4142135623730951;
  y = high ? (y - 1.0) / (y + 1.0) : y;
  const V z = y * y, w = z * z;
  const V a = z * (3.33333333333329318027e-01 + w * (1.42857142725034663711e-01 + w * (9.09088713343650656196e-02 +
              w * (6.66107313738753120669e-02 + w * (4.97687799461593236017e-02 + w * 1.62858201153657823623e-02)))));
  const V b = w * (-1.99999999998764832476e-01 + w * (-1.11111104054623557880e-01 + w * (-7.69187620504482999495e-02 +
              w * (-5.83357013379057348645e-02 + w * -3.65315727442169155270e-02))));
  V r = y - y * (a + b);
  r = high ? 0.7853981633974483 + r : r;
  r = big ? 1.5707963267948966 - r : r;
  return Number(Bits(r) | sign, x);
}

}  // namespace elementary

#ifdef MRDAMP_LANES
#define MRDAMP_FUNCTION(name, f) \
  inline Real name(Real x) { return Real(elementary::f<Vector>(x.a)); }
#else
#define MRDAMP_FUNCTION(name, f) \
  inline double name(double x) { return elementary::f<double>(x); }
#endif
MRDAMP_FUNCTION(exp, Exp)
MRDAMP_FUNCTION(expm1, Expm1)
MRDAMP_FUNCTION(TanhFar, Tanh)
MRDAMP_FUNCTION(TanhNear, TanhNear)
MRDAMP_FUNCTION(log, Log)
MRDAMP_FUNCTION(tan, Tan)
MRDAMP_FUNCTION(atan, Atan)
#undef MRDAMP_FUNCTION

inline Real tanh(Real x) {
  const Mask near = fabs(x) < 0.06;
  const Real y = TanhNear(x);
  return All(near) ? y : Select(near, y, TanhFar(x));
}
inline Real log1p(Real x) {
  const Real u = 1 + x;
  return Select(u == 1, x, log(u) + (x - (u - 1)) / u);
}
inline Real atanh(Real x) { return 0.5 * log1p(2 * x / (1 - x)); }
// x >= 0
inline Real pow(Real x, Real y) { return Select(x <= 0, Select(y == 0, 1, 0), exp(y * log(x))); }

// f(lane) of each lane, and f(lane, value) of the first `count`.
template <class F>
Real Gather(F&& f) {
  alignas(Real) double values[kLanes];
  for (int l = 0; l < kLanes; l++) values[l] = f(l);
  Real x;
  std::memcpy(&x, values, sizeof x);
  return x;
}
template <class F>
void Scatter(const Real& x, int count, F&& f) {
  alignas(Real) double values[kLanes];
  std::memcpy(values, &x, sizeof x);
  for (int l = 0; l < count; l++) f(l, values[l]);
}

// to = from `here`, for structs of numbers.
template <class T>
void Keep(Mask here, T* to, const T& from) {
  if (!Any(here)) return;
  Real* now = reinterpret_cast<Real*>(to);
  const Real* old = reinterpret_cast<const Real*>(&from);
  for (std::size_t i = 0; i < sizeof(T) / sizeof(Real); i++) now[i] = Select(here, old[i], now[i]);
}

// Of frequencies that are the same in each step: by the library, lane by lane.
inline Real Each(double (*f)(double), Real x) {
#ifdef MRDAMP_LANES
  for (int l = 0; l < kLanes; l++) x.Set(l, f(x[l]));
  return x;
#else
  return f(x);
#endif
}

inline Real Either(Real given, Real own) { return Select(isnan(given), own, given); }

}  // namespace mrdamp

#endif  // MRDAMP_CORE_REAL_H_
