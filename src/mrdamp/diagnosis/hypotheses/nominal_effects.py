"""Effects in the nominal simulator: their parameters are free like those of the law and part of every
hypothesis.

A catalogue term of the same effect begins at the nominal values: what has changed since may be that effect itself.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from mrdamp.diagnosis.hypotheses.terms import Coordinate, Term
from mrdamp.model import Effect

#: Range of a positive parameter of a nominal effect (factor to either side) and the prior's standard
#: deviation in units of search, as for the nominal parameters (`damper_effects.nominal_coordinates`).
_RANGE, _SCALE, _PRIOR = 8.0, 0.1, 3.0
#: Start of a changed nominal effect on either side of its value, in units of search.
_AWAY = 1.0


def setting_name(effect: str, key: str, place: int | None) -> str:
    """Name of an effect's setting: `EFFECT_PARAMETER`, with `@PLACE` if the effect has a place."""
    return f"{effect}_{key}" if place is None else f"{effect}_{key}@{place}"


def own_settings(effects: Sequence[Effect]) -> dict[str, float]:
    """Settings of effects by name."""
    return {setting_name(e.name, key, e.place): float(v) for e in effects for key, v in e.parameters.items()}


def effect_coordinates(effects: Sequence[Effect], terms: Sequence[Term]) -> tuple[Coordinate, ...]:
    """Coordinates of nominal effects about their nominal values. Parameters that only select a form (a
    direction, a capacity) stay fixed."""
    own = own_settings(effects)
    known: dict[str, Coordinate] = {}
    for term in terms:
        for c in term.coordinates:
            known.setdefault(c.name, c)
    return tuple(_about(known[name], value) for name, value in own.items() if name in known)


def _about(c: Coordinate, value: float) -> Coordinate:
    if c.log and value > 0:
        low, high = min(c.low, value / _RANGE), max(c.high, value * _RANGE)
        return replace(
            c,
            start=value,
            low=max(low, value / _RANGE),
            high=min(high, value * _RANGE),
            scale=_SCALE,
            prior=_PRIOR,
        )
    low, high = min(c.low, value), max(c.high, value)
    return replace(c, start=value, low=low, high=high, log=False, prior=_PRIOR)


def about_nominal(terms: Sequence[Term], effects: Sequence[Effect]) -> tuple[Term, ...]:
    """The catalogue beside nominal effects. A term of such an effect (and place) starts from its nominal values, and is
    omitted if its form differs."""
    own = own_settings(effects)
    taken = {(e.name, e.place) for e in effects}
    out = []
    for term in terms:
        if (term.effect, term.place) not in taken:
            out.append(term)
        elif _agrees(term.fixed, own):
            out.append(_from(term, own))
    return tuple(t for t in out if t.starts)


def _from(term: Term, own: Mapping[str, float]) -> Term:
    """The term about nominal values: with those and its own starts of what is new; if nothing is, from either side."""
    own = {c.name: own[c.name] for c in term.coordinates if c.name in own and not (c.log and own[c.name] <= 0)}
    coordinates = tuple(_around(c, own[c.name]) if c.name in own else c for c in term.coordinates)
    new = [k for k, c in enumerate(coordinates) if c.name not in own]
    if new:
        # Linear ones at zero would be the nominal effect again.
        kept = [s for s in term.starts if any(coordinates[k].log or s[k] != coordinates[k].start for k in new)]
        starts = [tuple(own.get(c.name, v) for c, v in zip(coordinates, s, strict=True)) for s in kept]
    else:
        first, *others = coordinates
        starts = [(first.value(q), *(c.start for c in others)) for q in (_AWAY, -_AWAY)]
    return replace(term, coordinates=coordinates, starts=tuple(dict.fromkeys(starts)))


def _around(c: Coordinate, value: float) -> Coordinate:
    return replace(c, start=value, low=min(c.low, value), high=max(c.high, value))


def _agrees(fixed: Mapping[str, float], own: Mapping[str, float]) -> bool:
    return all(own.get(name, value) == value for name, value in fixed.items())


def merged(effects: Sequence[Effect], found: Sequence[Effect]) -> tuple[Effect, ...]:
    """The nominal effects, updated parameter by parameter with the fitted ones, and new effects."""
    new = {(e.name, e.place): e for e in found}
    out = []
    for e in effects:
        more = new.pop((e.name, e.place), None)
        out.append(e if more is None else replace(e, parameters={**e.parameters, **more.parameters}))
    return (*out, *new.values())
