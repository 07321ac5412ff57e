"""Effects that the nominal simulator already has: free as the law's numbers are, and part of every hypothesis.

A catalogue term of the same effect then stands for what the nominal simulator lacks of it: its coordinates are those
that the nominal effect does not have.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from mrdamp.diagnosis.hypotheses.terms import Coordinate, Term
from mrdamp.model import Effect

#: Range of a positive number of a nominal effect (factor to either side) and the prior's width in units of search:
#: those of the law's own numbers (`damper_effects.nominal_coordinates`).
_RANGE, _SCALE, _PRIOR = 8.0, 0.1, 3.0


def own_settings(effects: Sequence[Effect]) -> dict[str, float]:
    """Settings by name (`EFFECT_PARAMETER`, with `@PLACE` where it has one) of effects."""
    out: dict[str, float] = {}
    for e in effects:
        place = "" if e.place is None else f"@{e.place}"
        out |= {f"{e.name}_{key}{place}": float(value) for key, value in e.parameters.items()}
    return out


def effect_coordinates(effects: Sequence[Effect], terms: Sequence[Term]) -> tuple[Coordinate, ...]:
    """Coordinates of the nominal effects' numbers that the catalogue has as coordinates, about their nominal values;
    what only makes a form (a direction, a capacity) stays fixed."""
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


def beside_own(terms: Sequence[Term], effects: Sequence[Effect]) -> tuple[Term, ...]:
    """The catalogue beside nominal effects: of a term whose effect (and place) the nominal simulator has, only the
    coordinates that are not among the nominal ones; none where nothing is left, or where its form is another one."""
    own = own_settings(effects)
    taken = {(e.name, e.place) for e in effects}
    out = []
    for term in terms:
        if (term.effect, term.place) not in taken:
            out.append(term)
            continue
        keep = [k for k, c in enumerate(term.coordinates) if c.name not in own]
        if not keep or not _agrees(term.fixed, own):
            continue
        starts = tuple(tuple(start[k] for k in keep) for start in term.starts)
        coordinates = tuple(term.coordinates[k] for k in keep)
        neutral = tuple(c.start for c in coordinates)
        starts = tuple(dict.fromkeys(s for s in starts if s != neutral or coordinates[0].log))
        if starts:
            out.append(replace(term, coordinates=coordinates, starts=starts))
    return tuple(out)


def _agrees(fixed: Mapping[str, float], own: Mapping[str, float]) -> bool:
    return all(own.get(name, value) == value for name, value in fixed.items())


def merged(effects: Sequence[Effect], found: Sequence[Effect]) -> tuple[Effect, ...]:
    """The nominal effects with what was found in their place, number by number, and the effects that are new."""
    new = {(e.name, e.place): e for e in found}
    out = []
    for e in effects:
        more = new.pop((e.name, e.place), None)
        out.append(e if more is None else replace(e, parameters={**e.parameters, **more.parameters}))
    return (*out, *new.values())
