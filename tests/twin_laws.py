"""The four parametric force laws as plain equations, written from their papers for tests alone.

bingham: Stanway, Sproston, Stevens (1987); bouc_wen: Bouc, Wen as in Spencer et al. (1997), Eq. (7);
modified_bouc_wen: Spencer et al. (1997), Eqs. (13)-(16); hyperbolic_tangent: Gavin (2001), as Eq. (5) of
Zapateiro et al. (2010). A law gives the force of its fluid and of the spring beside it, and the rates of its
states, for a piston at x (m) with velocity v (m/s). Field variable b: A or V.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol

State = list[float]


def value(p: Mapping[str, float], name: str, b: float) -> float:
    """``p_a + p_b b + p_c b^2 + p_e (1 - exp(-p_r b))``: a coefficient's dependence on the field."""
    saturating = p.get(f"{name}e", 0.0) * (1.0 - math.exp(-p.get(f"{name}r", 1.0) * b))
    return p[f"{name}a"] + p[f"{name}b"] * b + p.get(f"{name}c", 0.0) * b * b + saturating


@dataclass(frozen=True)
class Softening:
    """What effects do to the coefficients: heat to viscosity and yield, shear thinning to c0 and a share of c1."""

    viscous: float = 1.0
    yielding: float = 1.0
    thinning: Callable[[float], float] = lambda v: 1.0
    series: float = 0.0

    def inner(self, v: float) -> float:
        """Factor on the viscosity of the dashpot in series."""
        return self.viscous * (1.0 - self.series + self.series * self.thinning(v))


class Law(Protocol):
    """A law at one set of parameters."""

    @property
    def scales(self) -> tuple[float, ...]:
        """Typical size of each state, for absolute tolerances."""

    def start(self, x: float) -> State: ...

    def forces(self, s: State, x: float, v: float, b: float, soft: Softening) -> tuple[float, float]: ...

    def rates(self, s: State, x: float, v: float, b: float, soft: Softening) -> State: ...


def hysteresis_rate(p: Mapping[str, float], z: float, v: float, b: float) -> float:
    """``z'`` of Bouc and Wen for a velocity ``v`` across the element."""
    floor = p.get("hysteresis_floor", 0.0)
    factor = floor + (1.0 - floor) * math.exp(-p.get("hysteresis_rate", 0.0) * b)
    n, size = p["n"], abs(z)
    # |z|^(n-1) z, written so that z = 0 with n = 1 is no 0^0
    bent = math.copysign(size**n, z)
    rate = -factor * p["gamma"] * abs(v) * bent - factor * p["beta"] * v * size**n + p["A"] * v
    return float(rate)


def z_limit(p: Mapping[str, float]) -> float:
    """Largest |z| the law can reach at zero field."""
    total = p["gamma"] + p["beta"]
    return float((p["A"] / total) ** (1.0 / p["n"])) if total > 0.0 else 1.0


class Bingham:
    def __init__(self, p: Mapping[str, float]) -> None:
        self.p = p
        self.scales: tuple[float, ...] = ()

    def start(self, x: float) -> State:
        return []

    def forces(self, s: State, x: float, v: float, b: float, soft: Softening) -> tuple[float, float]:
        c0 = max(value(self.p, "c0", b), 0.0) * soft.viscous * soft.thinning(v)
        fy = max(value(self.p, "fy", b), 0.0) * soft.yielding
        width = self.p["v_ref"]
        sign = math.tanh(v / width) if width > 0.0 else float((v > 0.0) - (v < 0.0))
        return c0 * v + fy * sign, 0.0

    def rates(self, s: State, x: float, v: float, b: float, soft: Softening) -> State:
        return []


class BoucWen:
    def __init__(self, p: Mapping[str, float]) -> None:
        self.p = p
        self.scales: tuple[float, ...] = (z_limit(p),)

    def start(self, x: float) -> State:
        return [0.0]

    def forces(self, s: State, x: float, v: float, b: float, soft: Softening) -> tuple[float, float]:
        c0 = max(value(self.p, "c0", b), 0.0) * soft.viscous * soft.thinning(v)
        alpha = max(value(self.p, "alpha_", b), 0.0) * soft.yielding
        return c0 * v + alpha * s[0], self.p["k0"] * (x - self.p["x0"])

    def rates(self, s: State, x: float, v: float, b: float, soft: Softening) -> State:
        return [hysteresis_rate(self.p, s[0], v, b)]


class ModifiedBoucWen:
    def __init__(self, p: Mapping[str, float]) -> None:
        self.p = p
        self.scales: tuple[float, ...] = (z_limit(p), 0.01)

    def start(self, x: float) -> State:
        return [0.0, x]

    def _inner(self, s: State, x: float, v: float, b: float, soft: Softening) -> tuple[float, float]:
        c0 = max(value(self.p, "c0", b), 0.0) * soft.viscous * soft.thinning(v)
        c1 = max(value(self.p, "c1", b), 0.0) * soft.inner(v)
        alpha = max(value(self.p, "alpha_", b), 0.0) * soft.yielding
        z, y = s
        return c1, (alpha * z + c0 * v + self.p["k0"] * (x - y)) / (c0 + c1)

    def forces(self, s: State, x: float, v: float, b: float, soft: Softening) -> tuple[float, float]:
        c1, dy = self._inner(s, x, v, b, soft)
        return c1 * dy, self.p["k1"] * (x - self.p["x0"])

    def rates(self, s: State, x: float, v: float, b: float, soft: Softening) -> State:
        _, dy = self._inner(s, x, v, b, soft)
        return [hysteresis_rate(self.p, s[0], v - dy, b), dy]


class HyperbolicTangent:
    """States: plastic displacement g and its rate."""

    def __init__(self, p: Mapping[str, float]) -> None:
        self.p = p
        self.scales: tuple[float, ...] = (0.01, 0.1)

    def start(self, x: float) -> State:
        return [x, 0.0]

    def forces(self, s: State, x: float, v: float, b: float, soft: Softening) -> tuple[float, float]:
        k1 = max(value(self.p, "k1", b), 0.0)
        c1 = max(value(self.p, "c1", b), 0.0) * soft.inner(v)
        return k1 * (x - s[0]) + c1 * (v - s[1]), 0.0

    def rates(self, s: State, x: float, v: float, b: float, soft: Softening) -> State:
        p, (g, dg) = self.p, s
        c0 = max(value(p, "c0", b), 0.0) * soft.viscous * soft.thinning(v)
        f0 = max(value(p, "f0", b), 0.0) * soft.yielding
        drive, _ = self.forces(s, x, v, b, soft)
        inner = drive - value(p, "k0", b) * g - c0 * dg - f0 * math.tanh(dg / p["v_ref"])
        return [dg, inner / p["m0"]]


LAWS: Mapping[str, Callable[[Mapping[str, float]], Law]] = {
    "bingham": Bingham,
    "bouc_wen": BoucWen,
    "modified_bouc_wen": ModifiedBoucWen,
    "hyperbolic_tangent": HyperbolicTangent,
}
