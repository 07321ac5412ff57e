"""Search spaces of the force laws: the free coordinates of a fit, their ranges, and the parameters they stand for.

A fit moves coordinates that are scaled by the records (force, velocity, stroke, command), wide ones as logarithms,
and without the redundancy of the Bouc-Wen laws: z is scaled to end at 1, so A = beta + gamma is the reciprocal of
the yield displacement and alpha is a force. A coefficient that follows the command is searched by its values at
two to four commands in the records' range, so that it stays positive there whatever sign its slope has.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from mrdamp.errors import InputError
from mrdamp.model.attributes import attributes, law_parameters, law_row, laws
from mrdamp.model.core import Array
from mrdamp.records import Record

#: How a coefficient may follow the command u, and how many different commands that needs: p_a; p_a + p_b u;
#: p_a + p_b u + p_c u^2; p_a + p_e (1 - exp(-p_r u)); and all of these terms, for a curve that bends both ways.
#: The rate p_r is one for all coefficients: it is the field that saturates.
DEPENDENCES = {"constant": 1, "linear": 2, "quadratic": 3, "saturating": 3, "quadratic_saturating": 4}
_KNOTS = {"quadratic": 3, "quadratic_saturating": 4}
#: A name of `DEPENDENCES`, or constant commands at each of which a coefficient has a value of its own.
Dependence = str | tuple[float, ...]

#: The coefficients that follow the command in the foam-damper paper, Eqs. (7) and (8), where a law has others too.
PAPER_FOLLOWS: Mapping[str, tuple[str, ...]] = {"hyperbolic_tangent": ("k0", "k1", "c1", "f0")}

#: Effects that a plain identification may fit along with the law.
EXTRAS = ("offset", "driver_lag", "command_delay", "saturation", "gas_spring", "channel_shift")
#: Of these, what only commands that vary show.
OF_COMMAND = ("driver_lag", "command_delay")

#: s, the most that a displacement channel may be late or early, and a command late.
_SHIFT, _DELAY = 0.02, 0.1
#: Share of the largest command by which commands must differ to count as two.
_SAME_COMMAND = 0.05


@dataclass(frozen=True)
class Scales:
    """What the records span: RMS force (N), velocity (m/s) and stroke amplitude (m), largest command.

    low: the smallest command, by its size as the fluid feels it; levels: how many different commands there are
    (counted up to 4). preload: mean force (N) where it is larger than the RMS about it, else 0.
    """

    force: float
    velocity: float
    stroke: float
    command: float
    low: float = 0.0
    levels: int = 4
    preload: float = 0.0

    @classmethod
    def of(cls, records: Sequence[Record]) -> Scales:
        """Scales of a set of records; InputError where the force or the displacement is constant."""
        force = math.sqrt(float(np.mean([np.var(record.channel("force_N")) for record in records])))
        velocity = math.sqrt(float(np.mean([np.mean(record.velocity() ** 2) for record in records])))
        stroke = max(float(np.ptp(record.displacement)) for record in records) / 2
        size = [np.abs(record.command) for record in records]
        command = max(float(u.max()) for u in size)
        for name, value in (("force_N", force), ("displacement_m", stroke), ("displacement_m", velocity)):
            if not value > 0:
                raise InputError(
                    f"{records[0].label}: channel {name} is constant; nothing can be identified from it"
                )
        low = min(float(u.min()) for u in size)
        mean = float(np.mean([np.mean(record.channel("force_N")) for record in records]))
        return cls(force, velocity, stroke, command, low, levels(records), mean if abs(mean) > force else 0.0)

    def knots(self, dependence: Dependence) -> tuple[float, ...]:
        """Commands at which a coefficient's values are the coordinates."""
        if not isinstance(dependence, str):
            return dependence
        high = max(self.command, self.low)
        if dependence == "constant" or not high > self.low:
            return (0.0,)
        return tuple(float(u) for u in np.linspace(self.low, high, _KNOTS.get(dependence, 2)))


def levels(records: Sequence[Record]) -> int:
    """Number of clearly different commands in the records, counted up to 4."""
    values = np.unique(np.concatenate([np.unique(np.abs(record.command)) for record in records]))
    limit, count, last = _SAME_COMMAND * max(float(np.abs(values).max()), 1e-12), 1, float(values[0])
    for value in values:
        if value - last > limit:
            count, last = count + 1, float(value)
    return min(count, 4)


def dependence_for(requested: Dependence | None, scales: Scales, where: str = "the records") -> Dependence:
    """The dependence that a fit uses: as given, or linear if the command varies and constant if it does not.

    Raises InputError for an unknown name, and for one that so few different commands cannot show.
    """
    if requested is None:
        return "linear" if scales.levels > 1 else "constant"
    if not isinstance(requested, str):
        return requested
    if requested not in DEPENDENCES:
        raise InputError(f"dependence '{requested}' is unknown; allowed: {', '.join(DEPENDENCES)}, compare")
    need = DEPENDENCES[requested]
    if scales.levels < need:
        what = (
            "the command never varies"
            if scales.levels == 1
            else f"there are {scales.levels} different commands"
        )
        raise InputError(
            f"{where}: {what}; a {requested} dependence on the command needs {need} different ones"
        )
    return requested


@dataclass(frozen=True)
class Coordinate:
    """One free number of a fit: start and bounds in its own unit; `log`: positive, searched as a logarithm."""

    name: str
    start: float
    low: float
    high: float
    log: bool = False

    def pack(self, value: float) -> float:
        """To the unit interval; a value outside the bounds goes to the nearer one."""
        value = min(max(value, self.low), self.high)
        if self.log:
            return math.log(value / self.low) / math.log(self.high / self.low)
        return (value - self.low) / (self.high - self.low)

    def unpack(self, share: float) -> float:
        """From the unit interval."""
        if self.log:
            return self.low * math.exp(share * math.log(self.high / self.low))
        return self.low + share * (self.high - self.low)


@dataclass(frozen=True)
class Map:
    """A coefficient that follows the command: attribute stem, start at the smallest and largest command, bounds.

    at_zero: it must be within its bounds at no command too, though the records may hold none so small. constant: it
    is one number for all commands.
    """

    stem: str
    zero: float
    full: float
    low: float
    high: float
    log: bool = False
    at_zero: bool = False
    constant: bool = False

    def coordinates(self, knots: Sequence[float]) -> list[Coordinate]:
        """Its values at the knots."""
        knots = self.own(knots)
        starts = np.linspace(self.zero, self.full, len(knots)) if len(knots) > 1 else [self.zero + self.full]
        if self.log:
            starts = np.clip(starts, 1.001 * self.low, 0.999 * self.high)
        return [
            Coordinate(
                f"{self.stem.rstrip('_')} at {u:.4g}" if len(knots) > 1 else self.stem.rstrip("_"),
                float(start),
                self.low,
                self.high,
                self.log,
            )
            for u, start in zip(knots, starts, strict=True)
        ]

    def expand(self, values: Sequence[float], knots: Sequence[float], rate: float | None) -> dict[str, float]:
        """Attributes of the curve through the values (knots,)."""
        knots = self.own(knots)
        a, b = f"{self.stem}a", f"{self.stem}b"
        if len(knots) == 1:
            return {a: values[0], b: 0.0}
        if rate is not None and len(knots) == 4:
            u = np.array(knots)
            terms = np.column_stack([np.ones(4), u, u * u, -np.expm1(-rate * u)])
            parts = np.linalg.solve(terms, np.array(values))
            return {f"{self.stem}{part}": float(x) for part, x in zip("abce", parts, strict=True)} | {
                f"{self.stem}r": rate
            }
        if rate is not None:
            start, end = (1 - math.exp(-rate * u) for u in knots)
            e = (values[1] - values[0]) / (end - start)
            return {a: values[0] - e * start, b: 0.0, f"{self.stem}e": e, f"{self.stem}r": rate}
        slope = (values[1] - values[0]) / (knots[1] - knots[0])
        if len(knots) == 2:
            return {a: values[0] - slope * knots[0], b: slope}
        bend = ((values[2] - values[1]) / (knots[2] - knots[1]) - slope) / (knots[2] - knots[0])
        # Newton's form, written out in powers of the command.
        return {
            a: values[0] - slope * knots[0] + bend * knots[0] * knots[1],
            b: slope - bend * (knots[0] + knots[1]),
            f"{self.stem}c": bend,
        }

    def values(self, attributes: Mapping[str, float], knots: Sequence[float]) -> list[float]:
        """The coefficient at the knots, from attributes of any dependence."""
        a, b, c, e = (attributes.get(f"{self.stem}{part}", 0.0) for part in "abce")
        rate = attributes.get(f"{self.stem}r", 1.0)
        return [a + b * u + c * u * u + e * (1 - math.exp(-rate * u)) for u in self.own(knots)]

    def own(self, knots: Sequence[float]) -> Sequence[float]:
        """The commands at which its values are coordinates."""
        if self.constant:
            return (0.0,)
        return (0.0, *knots[1:]) if self.at_zero and knots[0] > 0 else knots


@dataclass(frozen=True)
class Space:
    """Coordinates of a law (and of effects fitted with it) and how they make attributes."""

    law: str
    maps: tuple[Map, ...]
    knots: tuple[float, ...]
    plain: tuple[Coordinate, ...]  # constants of the law and effects, by attribute name
    rate: Coordinate | None = None  # of a saturating dependence
    each: bool = False  # a value of its own at each knot, which are constant commands
    fixed: Mapping[str, float] = field(default_factory=dict)  # attributes that are not free

    @property
    def coordinates(self) -> tuple[Coordinate, ...]:
        """All free numbers, in the order of a point."""
        followed = [c for m in self.maps for c in m.coordinates(self.knots)]
        return (*followed, *([self.rate] if self.rate else []), *self.plain)

    def attributes(self, point: Array, command: float | None = None) -> dict[str, float]:
        """Attributes of a point of the unit cube (coordinates,).

        command: with `each`, of the knot nearest to it; None: of the straight lines through the values at the knots.
        """
        numbers = [c.unpack(float(p)) for c, p in zip(self.coordinates, point, strict=True)]
        out: dict[str, float] = {}
        first = len(numbers) - len(self.plain)
        rate = numbers[first - 1] if self.rate else None
        k = 0
        for m in self.maps:
            values = numbers[k : k + len(m.own(self.knots))]
            k += len(values)
            if not self.each or len(values) == 1:
                out |= m.expand(values, self.knots, rate)
            elif command is None:
                slope, zero = np.polyfit(self.knots, values, 1)
                out |= {f"{m.stem}a": float(zero), f"{m.stem}b": float(slope)}
            else:
                nearest = int(np.argmin(np.abs(np.subtract(self.knots, command))))
                out |= {f"{m.stem}a": values[nearest], f"{m.stem}b": 0.0}
        out |= {c.name: value for c, value in zip(self.plain, numbers[first:], strict=True)} | dict(self.fixed)
        return _hysteresis(out) if "yield_displacement" in out else out

    def point(self, attributes: Mapping[str, float]) -> Array:
        """The point of the unit cube (coordinates,) nearest to a law's attributes: the way back of `attributes`."""
        known = dict(attributes)
        if "A" in known:
            known = _without_redundancy(known)
        numbers = [value for m in self.maps for value in m.values(known, self.knots)]
        if self.rate:
            numbers.append(
                next((known[f"{m.stem}r"] for m in self.maps if f"{m.stem}r" in known), self.rate.start)
            )
        numbers += [known.get(c.name, c.start) for c in self.plain]
        return np.array([c.pack(value) for c, value in zip(self.coordinates, numbers, strict=True)])

    @property
    def start(self) -> Array:
        """The starting point in the unit cube."""
        return np.array([c.pack(c.start) for c in self.coordinates])


def _hysteresis(p: Mapping[str, float]) -> dict[str, float]:
    slope, share = 1 / p["yield_displacement"], p["beta_share"]
    rest = {key: value for key, value in p.items() if key not in ("yield_displacement", "beta_share")}
    return rest | {"A": slope, "beta": share * slope, "gamma": (1 - share) * slope, "x0": 0.0}


def _without_redundancy(p: dict[str, float]) -> dict[str, float]:
    """Scales z to end at 1: alpha becomes a force, and A a reciprocal displacement."""
    both = p["beta"] + p["gamma"]
    end = (p["A"] / both) ** (1 / p.get("n", 2.0)) if both > 0 and p["A"] > 0 else 1.0
    scaled = {k: v * end if k in ("alpha_a", "alpha_b", "alpha_c", "alpha_e") else v for k, v in p.items()}
    share = p["beta"] / both if both > 0 else 0.5
    return scaled | {"yield_displacement": end / max(p["A"], 1e-12), "beta_share": share}


def _law(law: str, s: Scales) -> tuple[tuple[Map, ...], tuple[Coordinate, ...]]:
    """What follows the command, and what is constant: the `search` of the law's row in the C table."""
    if str(law) not in parametric():
        raise InputError(f"law {str(law)[:40]!r} has no search space; allowed: {', '.join(parametric())}")
    f, v, stroke = s.force, s.velocity, s.stroke
    scales = {
        "N": f, "m": stroke, "m/s": v, "N/m": f / stroke, "N s/m": f / v, "kg": 0.02 * f * stroke / v**2, "1": 1.0
    }  # fmt: skip
    units = {row.name: row.unit.partition(" per ")[0] for row in attributes()}
    units |= {"yield_displacement": "m", "beta_share": "1"}
    maps, plain = [], []
    for entry in law_row(law, "search").split("; "):
        name, *words = entry.split()
        log, at_zero = "log" in words, "at_zero" in words
        numbers = [float(word) for word in words if word not in ("log", "at_zero")]
        if f"{name}a" in law_parameters(law):
            zero, full, low, high = (x * scales[units[f"{name}a"]] for x in numbers)
            maps.append(Map(name, zero, full, low, high, log, at_zero))
        else:
            # Of k0 in the order of rounding that the fits of the documentation were made in.
            start, low, high = (x * f / stroke if name == "k0" else x * scales[units[name]] for x in numbers)
            plain.append(Coordinate(name, start, low, high, log))
    return tuple(maps), tuple(plain)


@functools.cache
def parametric() -> tuple[str, ...]:
    """The laws that have a search space."""
    return tuple(law for law in laws() if law_row(law, "search"))


def space(
    law: str,
    scales: Scales,
    extras: Sequence[str] = (),
    dependence: Dependence | None = None,
    follows: Sequence[str] | None = None,
) -> Space:
    """Search space of a parametric law with some of `EXTRAS`; InputError for an unknown name.

    dependence: one of `DEPENDENCES`; None is linear, or constant where the command never varies; or constant commands,
    at each of which the coefficients have values of their own. follows: the coefficients that follow the command, such
    as "c0" and "alpha"; the others are one number for all commands. None: all that can.
    """
    maps, plain = _law(law, scales)
    can = [m.stem.rstrip("_") for m in maps]
    if unknown := set(follows or ()) - set(can):
        raise InputError(f"{law}: no coefficient {min(unknown)} that may follow the command; allowed: {', '.join(can)}")
    maps = tuple(
        replace(m, constant=follows is not None and name not in follows) for m, name in zip(maps, can, strict=True)
    )
    dependence = dependence_for(dependence, scales)
    stiffness = scales.force / scales.stroke
    known = {
        "offset": Coordinate(
            "gas_spring_f0", scales.preload, scales.preload - 2 * scales.force, scales.preload + 2 * scales.force
        ),
        "driver_lag": Coordinate("driver_lag_tau", 0.005, 1e-4, 0.2, log=True),
        "command_delay": Coordinate("command_delay_d", 0.002, 0.0, _DELAY),
        "saturation": Coordinate(
            "saturation_i_s", scales.command, 0.1 * scales.command, 20 * scales.command, log=True
        ),
        "gas_spring": Coordinate("gas_spring_k", 0.0, -3 * stiffness, 3 * stiffness),
        "channel_shift": Coordinate("channel_shift_d", 0.0, -_SHIFT, _SHIFT),
    }
    for extra in extras:
        if extra not in known:
            raise InputError(f"'{extra}' cannot be fitted along; allowed: {', '.join(known)}")
        if scales.levels > 1 or extra not in (*OF_COMMAND, "saturation"):
            plain = (*plain, known[extra])
    knots = scales.knots(dependence)
    if not isinstance(dependence, str):
        return Space(law, tuple(replace(m, at_zero=False) for m in maps), knots, plain, each=True)
    rate = None
    if dependence.endswith("saturating") and len(knots) > 1:
        span = knots[-1] - knots[0]
        # Where the smallest command saturates the field already, no two commands differ by it.
        most = min(30 / span, 5 / knots[0]) if knots[0] > 0 else 30 / span
        rate = Coordinate(
            "field_rate", min(1.5 / span, 0.5 * most), 0.05 * min(1 / span, most), most, log=True
        )
    return Space(law, maps, knots, plain, rate)
