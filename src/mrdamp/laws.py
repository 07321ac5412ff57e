"""Search spaces of the force laws: the free coordinates of a fit, their ranges, and the parameters they stand for.

A fit moves coordinates that are scaled by the records (force, velocity, stroke, command), positive ones as
logarithms, and without the redundancy of the Bouc-Wen laws: z is scaled to end at 1, so A = beta + gamma is the
reciprocal of the yield displacement and alpha is a force.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mrdamp.core import Array
from mrdamp.errors import InputError
from mrdamp.records import Record


@dataclass(frozen=True)
class Scales:
    """What the records span: RMS force (N), velocity (m/s) and stroke amplitude (m), largest command."""

    force: float
    velocity: float
    stroke: float
    command: float

    @classmethod
    def of(cls, records: Sequence[Record]) -> Scales:
        """Scales of a set of records; InputError where the force or the displacement is constant."""
        force = math.sqrt(float(np.mean([np.var(record.channel("force_N")) for record in records])))
        velocity = math.sqrt(float(np.mean([np.mean(record.velocity() ** 2) for record in records])))
        stroke = max(float(np.ptp(record.displacement)) for record in records) / 2
        command = max(float(np.abs(record.command).max()) for record in records)
        for name, value in (("force_N", force), ("displacement_m", stroke), ("displacement_m", velocity)):
            if not value > 0:
                raise InputError(
                    f"{records[0].label}: channel {name} is constant; nothing can be identified from it"
                )
        return cls(force, velocity, stroke, command)


@dataclass(frozen=True)
class Coordinate:
    """One free number of a fit: start and bounds in its own unit; `log`: positive, searched as a logarithm."""

    name: str
    start: float
    low: float
    high: float
    log: bool = False

    def pack(self, value: float) -> float:
        """To the unit interval."""
        if self.log:
            return math.log(value / self.low) / math.log(self.high / self.low)
        return (value - self.low) / (self.high - self.low)

    def unpack(self, share: float) -> float:
        """From the unit interval."""
        if self.log:
            return self.low * math.exp(share * math.log(self.high / self.low))
        return self.low + share * (self.high - self.low)


Expand = Callable[[Mapping[str, float]], dict[str, float]]


@dataclass(frozen=True)
class Space:
    """Coordinates of a law (and of effects fitted with it) and how they make attributes."""

    law: str
    coordinates: tuple[Coordinate, ...]
    expand: Expand

    def attributes(self, point: Array) -> dict[str, float]:
        """Attributes of a point of the unit cube (coordinates,)."""
        values = {c.name: c.unpack(float(p)) for c, p in zip(self.coordinates, point, strict=True)}
        return self.expand(values)

    @property
    def start(self) -> Array:
        """The starting point in the unit cube."""
        return np.array([c.pack(c.start) for c in self.coordinates])


def _linear(name: str, unit: float, s: Scales, zero: float, slope: float) -> list[Coordinate]:
    """A parameter that follows the command in a straight line; no slope where the command is always zero."""
    out = [Coordinate(f"{name}a", zero * unit, 0.0, 8 * unit)]
    if s.command > 0:
        out.append(Coordinate(f"{name}b", slope * unit / s.command, 0.0, 12 * unit / s.command))
    return out


def _bingham(s: Scales) -> tuple[list[Coordinate], Expand]:
    c, f = s.force / s.velocity, s.force
    coordinates = [
        *_linear("c0", c, s, 0.3, 0.2),
        *_linear("fy", f, s, 0.3, 0.8),
        Coordinate("v_ref", 0.1 * s.velocity, 1e-3 * s.velocity, 3 * s.velocity, log=True),
    ]
    return coordinates, lambda p: {"c0b": 0.0, "fyb": 0.0, **p}


def _bouc_wen(s: Scales) -> tuple[list[Coordinate], Expand]:
    coordinates = [
        *_linear("c0", s.force / s.velocity, s, 0.3, 0.2),
        *_linear("alpha_", s.force, s, 0.3, 0.8),
        Coordinate("yield_displacement", 0.05 * s.stroke, 1e-4 * s.stroke, 2 * s.stroke, log=True),
        Coordinate("beta_share", 0.5, 0.02, 1.0),
        Coordinate("k0", 0.05 * s.force / s.stroke, 0.0, 3 * s.force / s.stroke),
    ]
    return coordinates, lambda p: _hysteresis(p) | {"x0": 0.0}


def _modified_bouc_wen(s: Scales) -> tuple[list[Coordinate], Expand]:
    c = s.force / s.velocity
    coordinates = [
        *_linear("c0", c, s, 0.3, 0.2),
        Coordinate("c1a", 5 * c, 0.2 * c, 500 * c, log=True),
        *([Coordinate("c1b", 5 * c / s.command, 0.0, 500 * c / s.command)] if s.command > 0 else []),
        *_linear("alpha_", s.force, s, 0.3, 0.8),
        Coordinate("yield_displacement", 0.02 * s.stroke, 1e-4 * s.stroke, 2 * s.stroke, log=True),
        Coordinate("beta_share", 0.5, 0.02, 1.0),
        Coordinate("k0", 0.05 * s.force / s.stroke, 0.0, 3 * s.force / s.stroke),
        Coordinate("k1", 0.02 * s.force / s.stroke, 0.0, 3 * s.force / s.stroke),
    ]
    return coordinates, lambda p: {"c1b": 0.0} | _hysteresis(p) | {"x0": 0.0}


def _hyperbolic_tangent(s: Scales) -> tuple[list[Coordinate], Expand]:
    c, k, f = s.force / s.velocity, s.force / s.stroke, s.force
    coordinates = [
        Coordinate("k0a", 0.05 * k, 0.0, 3 * k),
        Coordinate("k1a", 5 * k, 0.05 * k, 2000 * k, log=True),
        *([Coordinate("k1b", 5 * k / s.command, 0.0, 2000 * k / s.command)] if s.command > 0 else []),
        *_linear("c0", c, s, 0.3, 0.2),
        *_linear("c1", c, s, 0.3, 0.2),
        Coordinate(
            "m0",
            1e-3 * f / (s.velocity**2 / s.stroke),
            1e-6 * f * s.stroke / s.velocity**2,
            f * s.stroke / s.velocity**2,
            log=True,
        ),
        *_linear("f0", f, s, 0.3, 0.8),
        Coordinate("v_ref", 0.1 * s.velocity, 1e-3 * s.velocity, 3 * s.velocity, log=True),
    ]
    zero = dict.fromkeys(("k0b", "k1b", "c0b", "c1b", "f0b"), 0.0)
    return coordinates, lambda p: {**zero, **p}


def _hysteresis(p: Mapping[str, float]) -> dict[str, float]:
    slope, share = 1 / p["yield_displacement"], p["beta_share"]
    rest = {key: value for key, value in p.items() if key not in ("yield_displacement", "beta_share")}
    zero = {"c0b": 0.0, "alpha_b": 0.0}
    return zero | rest | {"A": slope, "beta": share * slope, "gamma": (1 - share) * slope, "n": 2.0}


_LAWS = {
    "bingham": _bingham,
    "bouc_wen": _bouc_wen,
    "hyperbolic_tangent": _hyperbolic_tangent,
    "modified_bouc_wen": _modified_bouc_wen,
}

#: Effects that a plain identification may fit along with the law: sensor or preload offset, driver lag, saturation.
EXTRAS = ("offset", "driver_lag", "saturation", "gas_spring", "channel_shift")


def space(law: str, scales: Scales, extras: Sequence[str] = (), sample_time: float = 1e-3) -> Space:
    """Search space of a parametric law with some of `EXTRAS`; InputError for an unknown name."""
    if law not in _LAWS:
        raise InputError(f"law '{law}' has no search space; allowed: {', '.join(_LAWS)}")
    coordinates, expand = _LAWS[law](scales)
    stiffness = scales.force / scales.stroke
    known = {
        "offset": [Coordinate("gas_spring_f0", 0.0, -2 * scales.force, 2 * scales.force)],
        "driver_lag": [Coordinate("driver_lag_tau", 0.005, 1e-4, 0.2, log=True)],
        "saturation": [
            Coordinate("saturation_i_s", scales.command, 0.1 * scales.command, 20 * scales.command, log=True)
        ],
        "gas_spring": [Coordinate("gas_spring_k", 0.0, -3 * stiffness, 3 * stiffness)],
        "channel_shift": [Coordinate("channel_shift_d", 0.0, -5 * sample_time, 5 * sample_time)],
    }
    for extra in extras:
        if extra not in known:
            raise InputError(f"'{extra}' cannot be fitted along; allowed: {', '.join(known)}")
        if scales.command > 0 or extra not in ("driver_lag", "saturation"):
            coordinates = [*coordinates, *known[extra]]
    return Space(law, tuple(coordinates), expand)
