"""Catalogue of a frame: effects of storeys, floors and floor sensors, and the structure's nominal parameters.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import partial

import numpy as np

from mrdamp.diagnosis.hypotheses.damper_effects import rms, sensor_terms
from mrdamp.diagnosis.hypotheses.terms import Coordinate, Sizes, Term, catalogue, linear, positive, term
from mrdamp.model import FLOOR_SENSOR_EFFECTS, STRUCTURE_EFFECTS, Effect
from mrdamp.records import Record
from mrdamp.structures import ShearFrame


def structure_coordinates(s: ShearFrame) -> tuple[Coordinate, ...]:
    """Masses, stiffnesses and damping, free about their nominal values: range of a factor of 4, prior of a
    third."""
    out = []
    for kind in ("mass", "stiffness", "damping"):
        for j, value in enumerate(getattr(s, kind), start=1):
            size = float(value) or float(np.max(s.damping)) or 1.0
            out.append(Coordinate(f"{kind}@{j}", size, size / 4, 4 * size, 0.1, log=True, prior=3.0))
    return tuple(out)


def frame_terms(s: ShearFrame, records: Sequence[Record], sizes: Sizes) -> tuple[Term, ...]:
    """Effects of each storey, floor and accelerometer, from the ground up."""
    out: list[Term] = []
    for j in range(1, s.storeys + 1):
        shear, acceleration = _sizes(s, records, j)
        dashpot = float(s.damping[j - 1]) / (sizes.velocity or 1.0)
        out += _storey(j, float(s.mass[j - 1]), shear, dashpot)
        out += sensor_terms(acceleration, sizes.sample_time, j)
    # A relative change of zero damping has no effect.
    return catalogue(t for t in out if t.effect != "storey_damping" or s.damping[(t.place or 1) - 1] > 0)


def _storey(j: int, mass: float, shear: float, dashpot: float) -> Iterator[Term]:
    """mass (kg) of floor j; shear (N): force in its storey; dashpot (N s2/m2): its damping over a velocity."""
    at = partial(term, place=j)
    yield at("storey_stiffness", (linear("e", 0.05, -0.8, 3.0),), (0.05,), (-0.2,))
    damping = linear("e", 0.3, -0.99, 60.0)
    quadratic = damping, linear("quadratic", 0.3 * dashpot, 0.0, 300 * dashpot)
    yield at("storey_damping", (damping,), (0.3,), (3.0,), (-0.4,))
    yield at("storey_damping:quadratic", quadratic, (0.3, 0.3 * dashpot), (1.0, 3 * dashpot))
    friction = linear("coulomb", 0.02 * shear, 0.0, 2 * shear)
    little, more = 0.02 * shear, 0.1 * shear
    slipping = friction, positive("width", 2e-3, 5e-5, 0.1)
    bristle = friction, positive("presliding", 3e-5, 1e-6, 2e-3)
    yield at("joint_friction", slipping, (little, 2e-3), (more, 2e-3))
    yield at("joint_friction:building up", bristle, (little, 3e-5), (more, 1e-4))
    yield at("floor_mass", (linear("dm", 0.03 * mass, -0.8 * mass, 3 * mass),), (0.03 * mass,), (0.2 * mass,))


def _sizes(s: ShearFrame, records: Sequence[Record], j: int) -> tuple[float, float]:
    """RMS force (N) in storey j, from the floors above, and RMS acceleration (m/s2) of floor j."""
    floors = range(j, s.storeys + 1)
    shear, acceleration = [], []
    for r in records:
        a = [
            r.channels.get(f"floor{k}_acceleration_m_s2", r.channel("ground_acceleration_m_s2"))
            for k in floors
        ]
        shear.append(rms(np.sum([s.mass[k - 1] * x for k, x in zip(floors, a, strict=True)], axis=0)))
        acceleration.append(rms(np.asarray(a[0])))
    return float(np.mean(shear)), float(np.mean(acceleration))


def placed_effects(settings: Mapping[str, float]) -> list[Effect]:
    """Effects with a place, from settings `EFFECT_PARAMETER@PLACE`."""
    found: dict[tuple[str, int], dict[str, float]] = {}
    for key, value in settings.items():
        head, _, place = key.partition("@")
        for name in (*STRUCTURE_EFFECTS, *FLOOR_SENSOR_EFFECTS):
            if place and head.startswith(f"{name}_"):
                found.setdefault((name, int(place)), {})[head.removeprefix(f"{name}_")] = value
    return [Effect(name, parameters, place) for (name, place), parameters in found.items()]
