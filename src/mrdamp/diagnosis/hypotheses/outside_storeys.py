"""Causes outside the catalogue in a frame's structure and ground channel (see `hypotheses.outside`): nonlinear storey
springs, a foundation that sways or rocks, a ground acceleration that is recorded late or early.

The frame's C entry has such springs and foundations only for this purpose; the plugin has no attribute for them.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from mrdamp.diagnosis.hypotheses.outside import rival
from mrdamp.diagnosis.hypotheses.terms import Coordinate, Term, linear, positive
from mrdamp.model.core import Array, FrameInput
from mrdamp.structures import ShearFrame

#: Damping ratio at which a foundation's search starts, and the multiple of the first storey's stiffness.
_RATIO, _STIFFER = 0.05, 5.0
#: s, largest delay of the ground channel.
_LATE = 0.05
#: Largest loss of a softening spring at the largest drift, as a share of the storey's stiffness.
_SOFTEST = 0.3


def storey_rivals(s: ShearFrame, places: Iterable[int], drift: Array, largest: Array) -> Iterator[Term]:
    """Rivals of the storeys at `places` (from 1). drift, largest (storeys,): RMS and largest drift (m)."""
    for j in places:
        k, d, peak = float(s.stiffness[j - 1]), float(drift[j - 1]), float(largest[j - 1])
        at = partial(rival, place=j)
        share = linear("crack_share", 0.1, 0.0, 0.95)
        yield at("storey_crack:at a positive drift", (share,), (0.15,), (0.5,), fixed={"crack_side": 1.0})
        yield at("storey_crack:at a negative drift", (share,), (0.15,), (0.5,), fixed={"crack_side": -1.0})
        yields = linear("yield_share", 0.1, 0.0, 0.95), positive("yield_drift", d, 0.02 * d, 4 * d)
        yield at("storey_yield", yields, (0.3, 0.4 * d), (0.3, 1.2 * d))
        unit = 0.1 * k / d**2
        yield at("storey_hardening", (linear("cubic", unit, -_SOFTEST * k / peak**2, 100 * unit),), (unit,))


def base_rivals(s: ShearFrame, sample_time: float) -> Iterator[Term]:
    """Rivals of the whole frame: its foundation and its ground channel. sample_time (s): of the records."""
    whole, n = float(np.sum(s.mass)), s.storeys
    # A push at the top moves the top alike by both.
    sway = _foundation(s, "sway", float(s.mass[0]), 1.0, whole)
    rock = _foundation(s, "rock", whole, n**2, whole * n**2 / 3)
    for form, parts in (("that sways", sway), ("that rocks", rock), ("that sways and rocks", (*sway, *rock))):
        yield rival(f"foundation:{form}", parts, tuple(c.start for c in parts))
    yield ground_delay(sample_time)


def _foundation(s: ShearFrame, how: str, mass: float, lever: float, moved: float) -> tuple[Coordinate, ...]:
    """Mass, stiffness and damping of a foundation's motion. lever: of its stiffness; moved: mass that moves with it."""
    k = _STIFFER * float(s.stiffness[0]) * lever
    c = 2 * _RATIO * float(np.sqrt(k * moved))
    return (
        positive(f"{how}_mass", mass, 0.01 * mass, 30.0 * mass),
        positive(f"{how}_stiffness", k, 0.02 * k, 200.0 * k),
        positive(f"{how}_damping", c, 1e-3 * c, 100.0 * c),
    )


def ground_delay(sample_time: float) -> Term:
    """The ground channel is recorded late."""
    late = linear("ground_delay", sample_time, -_LATE, _LATE)
    return rival("ground_delay", (late,), (2 * sample_time,), (-2 * sample_time,), stage="sensor")


def shaken(settings: Mapping[str, float], ground: Array, sample_time: float) -> Array:
    """The ground acceleration (n,) of a rig whose channel is recorded late, from the channel."""
    late = settings.get("outside_ground_delay", 0.0)
    t = sample_time * np.arange(len(ground))
    return np.interp(t + late, t, ground) if late else ground


def bent(settings: Mapping[str, float], frame: FrameInput) -> FrameInput:
    """The frame with the storey springs and the foundation of a rival's settings."""
    for how in ("sway", "rock"):
        if f"outside_{how}_stiffness" in settings:
            mass, k, c = (settings[f"outside_{how}_{of}"] for of in ("mass", "stiffness", "damping"))
            frame = replace(frame, sway=(mass, k, c)) if how == "sway" else replace(frame, rock=(mass, k, c))
    places = {int(name.partition("@")[2]) for name in settings if "@" in name}
    for j in sorted(places):
        frame = _bent(settings, frame, j)
    return frame


def _bent(settings: Mapping[str, float], frame: FrameInput, j: int) -> FrameInput:
    k = float(frame.stiffness[j - 1])
    if f"outside_crack_share@{j}" in settings:
        lost = settings[f"outside_crack_share@{j}"] * k
        if settings[f"outside_crack_side@{j}"] > 0:
            return replace(frame, one_sided=_at(frame.one_sided, j, -lost, frame))
        stiffness = _at(frame.stiffness, j, k - lost, frame)
        return replace(frame, stiffness=stiffness, one_sided=_at(frame.one_sided, j, lost, frame))
    if f"outside_yield_share@{j}" in settings:
        # Part of the spring slides, the more the nearer it is to a drift: dry friction with a presliding
        # distance.
        slides, drift = settings[f"outside_yield_share@{j}"] * k, settings[f"outside_yield_drift@{j}"]
        return replace(
            frame,
            stiffness=_at(frame.stiffness, j, k - slides, frame),
            friction=_at(frame.friction, j, slides * drift, frame),
            friction_width=_at(frame.friction_width, j, 0.0, frame),
            friction_presliding=_at(frame.friction_presliding, j, drift, frame),
        )
    return replace(frame, cubic=_at(frame.cubic, j, settings[f"outside_cubic@{j}"], frame))


def _at(values: Array | None, j: int, value: float, frame: FrameInput) -> Array:
    out = np.zeros(len(frame.mass)) if values is None else values.copy()
    out[j - 1] = value
    return out
