// The force laws of core/attributes.def behind one switch.
#ifndef MRDAMP_LAWS_LAW_H_
#define MRDAMP_LAWS_LAW_H_

#define MRDAMP_LAW_HEADERS
#include "core/attributes.def"

namespace mrdamp {

// f(type of the law); a network has no such type and counts as PlainLaw.
template <class F>
auto OfLaw(Law law, F&& f) {
  switch (law) {
#define MRDAMP_LAW(name, Type, ...) case Law::k##Type: return f(Type());
#include "core/attributes.def"
    default: return f(PlainLaw());
  }
}

inline LawKind Is(Law law) {
  return OfLaw(law, [](auto own) { return own.kIs; });
}

// turned: the velocity by which the direction counts, where it is not v.
inline Coefficients Evaluate(const Params& p, Law law, const Fluid& f, Real v, Real turned = kUnset) {
  Coefficients k{};
  const Real thin = Thinning(p, v), thin_series = 1 + p.shear_thinning_series * (thin - 1);
  k.c0 = Follow(p.c0a, p.c0b, p.c0c, p.c0e, p.c0r, f.b) * f.viscosity * thin;
  OfLaw(law, [&](auto own) { own.Fill(p, f, thin_series, &k); });
  if (Head(p.asymmetry_yield) != 0 || Head(p.asymmetry_viscous) != 0) {
    const Real side = tanh(Either(turned, v) / p.asymmetry_width);
    k.yield *= 1 + p.asymmetry_yield * side;
    k.c0 *= 1 + p.asymmetry_viscous * side;
  }
  return k;
}

}  // namespace mrdamp

#endif  // MRDAMP_LAWS_LAW_H_
