#include "core/packs.h"

#include <algorithm>
#include <cmath>

#include "laws/hysteresis.h"

namespace mrdamp {

namespace {

// In which of its ranges an attribute is: which terms and effects there are hangs on that alone.
int Range(int attribute, double value) {
  if (std::isnan(value)) return 9;
  const double usual = kAttributes[attribute].def;
  const int side = (value > usual) - (value < usual) + 1, sign = (value > 0) - (value < 0) + 1;
  return 3 * side + sign;
}

}  // namespace

bool Plain(const Params& p) {
#define MRDAMP_ATTRIBUTE(name, group, unit, def, lo, hi, meaning)
#define MRDAMP_EFFECT(name, group, unit, def, lo, hi, meaning) && p.name == def
  return true
#include "core/attributes.def"
      ;
}

std::string Alike(const Damper& d) {
  if (d.law == Law::kNarx || HasDelay(d.p)) return "";
  std::string text(reinterpret_cast<const char*>(&d.p.substep), sizeof d.p.substep);
  text += static_cast<char>('0' + static_cast<int>(d.law));
  text += d.hold ? 'h' : 'l';
  for (int i = 0; i < kParamCount; i++) text += static_cast<char>('0' + Range(i, d.p.data()[i]));
  for (const double n : {1.0, 2.0}) text += Exponent(d.p.n, n) ? 'e' : '-';
  return text;
}

}  // namespace mrdamp

#ifdef MRDAMP_PACKS  // see lanes/pack.cc
#ifdef __aarch64__  // NEON
#define MRDAMP_NARROW 2
#define MRDAMP_WIDE 2
#else
#define MRDAMP_NARROW 4
#define MRDAMP_WIDE 8
#endif
#define MRDAMP_JOINED(kind, lanes, Type) mrdamp_##kind##_##lanes##_k##Type
#define MRDAMP_PACK_OF(kind, lanes, Type) MRDAMP_JOINED(kind, lanes, Type)
#define MRDAMP_LAW(name, Type, ...)                                                                            \
  extern "C" const MrdampPack MRDAMP_PACK_OF(pack, MRDAMP_NARROW, Type), MRDAMP_PACK_OF(plain, MRDAMP_NARROW, Type); \
  extern "C" const MrdampPack MRDAMP_PACK_OF(pack, MRDAMP_WIDE, Type), MRDAMP_PACK_OF(plain, MRDAMP_WIDE, Type);
#include "core/attributes.def"

namespace mrdamp {

int Widest(int asked) {
  int most = 1;
#ifdef __aarch64__
  most = MRDAMP_WIDE;
#else
  if (__builtin_cpu_supports("avx2")) most = 4;
  if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl")) most = 8;
#endif
  if (asked > 0) most = std::min(most, asked);
  return most >= MRDAMP_WIDE ? MRDAMP_WIDE : most >= MRDAMP_NARROW ? MRDAMP_NARROW : 1;
}

const MrdampPack* PackFor(const std::vector<Damper>& dampers, int lanes) {
  static const MrdampPack* const packs[][2][2] = {
#define MRDAMP_LAW(name, Type, ...) \
  {{&MRDAMP_PACK_OF(pack, MRDAMP_NARROW, Type), &MRDAMP_PACK_OF(plain, MRDAMP_NARROW, Type)}, \
   {&MRDAMP_PACK_OF(pack, MRDAMP_WIDE, Type), &MRDAMP_PACK_OF(plain, MRDAMP_WIDE, Type)}},
#include "core/attributes.def"
  };
  bool plain = true;
  for (const Damper& d : dampers) {
    if (d.law != dampers[0].law || d.hold != dampers[0].hold || Alike(d).empty()) return nullptr;
    plain = plain && Plain(d.p);
  }
  if (lanes < MRDAMP_NARROW || dampers.empty()) return nullptr;
  return packs[static_cast<int>(dampers[0].law)][lanes == MRDAMP_WIDE][plain];
}

}  // namespace mrdamp
#else
namespace mrdamp {
int Widest(int) { return 1; }
const MrdampPack* PackFor(const std::vector<Damper>&, int) { return nullptr; }
}  // namespace mrdamp
#endif
