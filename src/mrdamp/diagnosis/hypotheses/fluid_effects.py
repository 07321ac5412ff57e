"""Catalogue of a damper's fluid effects: heat, asymmetry, shear thinning, trapped gas."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

from mrdamp.diagnosis.hypotheses.terms import Settings, Sizes, Term, linear, positive, term


def without_effect(settings: Settings) -> bool:
    """True for a heat that changes neither viscosity nor yield force by more than 1e-4 a kelvin."""
    return max(settings["heating_kappa"], settings["heating_kappa_yield"]) < 1e-4


#: Ratio of a viscosity at twice the RMS velocity to that at half of it, above which it does not thin: it is a wrong
#: parameter. Named in 31 opened cases it has .34 to .61, and in one .83; in a rig whose viscosity had fallen, .94.
_UNTHINNED = 0.9


def _is_viscosity(v: float, settings: Settings) -> bool:
    """True for a thinning that is the same at all speeds. v: RMS velocity (m/s)."""
    m, knee = settings["shear_thinning_m"], settings["shear_thinning_v_s"]
    shape = settings.get("shear_thinning_shape", 2.0)
    slow, fast = ((1 + (share * v / knee) ** shape) ** ((m - 1) / shape) for share in (0.5, 2.0))
    return bool(fast > _UNTHINNED * slow)


def fluid_terms(s: Sizes) -> Iterator[Term]:
    """Effects on the fluid's part of the force."""
    f, v, x = s.force, s.velocity, s.stroke
    capacity = {"capacity": s.heat / 10}  # gives a rise of about 10 K in the hottest record
    heat = (
        linear("kappa", 0.02, 0.0, 1.0),
        linear("kappa_yield", 0.02, 0.0, 1.0),
        positive("loss", 0.01 * s.heat / 10, 1e-4 * s.heat / 10, 3.0 * s.heat / 10),
    )
    rises = (0.02, 0.02, 0.01 * s.heat / 10), (0.03, 0.0, 0.2 * s.heat / 10)
    yield term("heating", heat, *rises, is_other=without_effect, fixed=capacity)
    bodies = (
        positive("link", 0.3 * s.heat / 10, 0.01 * s.heat / 10, 10 * s.heat / 10),
        positive("body", 2 * s.heat / 10, 0.1 * s.heat / 10, 100 * s.heat / 10),
        positive("shape", 3.0, 0.5, 30.0, 0.5),
    )
    rise = 0.03, 0.02, 0.01 * s.heat / 10, 0.3 * s.heat / 10, 2 * s.heat / 10, 3.0
    yield term("heating:two bodies", (*heat, *bodies), rise, is_other=without_effect, fixed=capacity)

    plain = linear("a", 0.05, -0.9, 0.9), positive("width", 0.1 * v, 1e-4, 3 * v)
    yield term("asymmetry", plain, (0.1, 0.05 * v), (-0.1, 0.3 * v))
    side = linear("a", 0.05, -0.8, 0.8)
    by_force = side, positive("force", 0.1 * f, 3e-3 * f, 3 * f), positive("time", 2e-3, 2e-4, 0.2)
    yield term("asymmetry:by the force", by_force, (0.1, 0.05 * f, 5e-4), (-0.1, 0.1 * f, 0.015))
    by_part = (
        linear("yield", 0.05, -0.9, 0.9),
        linear("viscous", 0.05, -0.9, 0.9),
        positive("width", 0.02 * v, 1e-4, 3 * v),
    )
    yield term("asymmetry:by the part", by_part, (0.1, 0.0, 0.02 * v), (0.0, 0.1, 0.02 * v))
    along = side, positive("travel", 0.03 * x, 1e-3 * x, x)
    yield term("asymmetry:along the stroke", along, (0.1, 0.03 * x), (0.1, 0.2 * x))

    thinning = linear("m", 0.1, 0.0, 1.0, 1.0), positive("v_s", v, 0.02 * v, 10 * v)
    thins = partial(term, is_other=partial(_is_viscosity, v))
    yield thins("shear_thinning", thinning, (0.6, 0.5 * v), (0.4, 1.5 * v))
    both = *thinning, positive("shape", 2.0, 0.5, 8.0, 0.3)
    yield thins("shear_thinning:both dashpots", both, (0.6, 0.5 * v, 2.0), (0.4, 1.5 * v, 1.2), fixed={"series": 1.0})
    yield from _gas_terms(f, v, x)


def _gas_terms(f: float, v: float, x: float) -> Iterator[Term]:
    """f (N), v (m/s), x (m): RMS force, RMS velocity, stroke. Gas is compressed in extension, or in compression."""
    turn = replace(positive("turn", 1e-5, 2e-6, max(0.02 * x, 4e-6), 2.0), rugged=True)
    width = positive("width", 0.02 * v, 1e-3 * v, v)
    # Of the force until the gas is compressed.
    loss = linear("d", 0.1, 0.0, 1.0), positive("s_g", 0.1 * x, 3e-3 * x, 2 * x)
    reach = positive("reach", 0.2 * x, 0.01 * x, 2 * x)
    in_time = positive("shape", 1.0, 0.5, 10.0, 0.3), positive("time", 0.1, 5e-3, 20.0)
    # Compression of gas in series with the fluid.
    pressed = (
        positive("force", 0.2 * f, 0.01 * f, 5 * f),
        positive("s_g", 0.1 * x, 1e-3 * x, 2 * x),
        positive("shape", 1.2, 0.5, 10.0, 0.3),
        positive("width", 0.05 * v, 2e-3 * v, v),
    )
    for form, coordinates, starts, fixed in (
        (
            "",
            (*loss, positive("shape", 2.0, 0.5, 10.0, 0.3), turn),
            [(0.3, share * x, 2.0, back) for share in (0.1, 0.4) for back in (5e-6, 2e-5)],
            {},
        ),
        (
            ", a pocket",
            (*loss, reach, positive("shape", 1.5, 0.5, 10.0, 0.3), width),
            [(0.3, 0.1 * x, 0.2 * x, 1.5, 0.02 * v), (0.3, 0.3 * x, 0.5 * x, 1.5, 0.02 * v)],
            {},
        ),
        (
            ", in its own time",
            (*loss, *in_time, width),
            [(0.3, share * x, 1.0, 0.2, 0.02 * v) for share in (0.15, 0.4)],
            {"end": 1.0},
        ),
        (", in series", pressed, [(0.2 * f, 0.07 * x, 1.2, 0.05 * v)], {"series": 1.0}),
    ):
        for side, way in (("extension", 1.0), ("compression", -1.0)):
            yield term(f"trapped_gas:{side}{form}", coordinates, *starts, fixed={"direction": way, **fixed})
