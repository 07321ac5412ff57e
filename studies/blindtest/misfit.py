"""Rigs whose law is not the simulator's: parts of their dampers that no law of the simulator contains.

A recipe is drawn for a damper and a scale; its parts grow with one size. Each part lists the effects of the
catalogue that it resembles (`also`): stick-slip friction may be called part of the law or seal friction, and
naming it or not counts as right.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from studies.blindtest import dampers
from studies.blindtest.dampers import Device
from studies.blindtest.excitation import Machine
from studies.blindtest.rig import Numbers
from studies.blindtest.scale import Scale, Sized
from studies.blindtest.sizing import Task

#: Law of the rig -> laws of its simulator, its own included if other parts can make it wrong. Pairs with an
#: error above 15 % on most dampers are excluded (Bingham for any hysteresis, Bouc-Wen for a damper with
#: mass).
NOMINAL: Mapping[str, tuple[str, ...]] = {
    "bouc_wen": ("hyperbolic_tangent", "bouc_wen", "modified_bouc_wen"),
    "hyperbolic_tangent": ("hyperbolic_tangent", "modified_bouc_wen"),
    "modified_bouc_wen": ("bouc_wen", "hyperbolic_tangent", "hyperbolic_tangent", "bingham"),
    "bingham": ("bouc_wen", "bingham"),
    "sigmoid": ("bouc_wen", "hyperbolic_tangent"),
}
#: Share of the dampers with a law that the simulator does not have.
_SIGMOID = 0.2
#: Bench damper of about 1 kN with the law of Kwok et al. 2006, doi:10.1088/0964-1726/15/4/015.
_KWOK = {
    "c0a": 700,
    "c0b": 800,
    "fya": 70,
    "fyb": 620,
    "k0": 900,
    "v_ref": 0.03,
    "hook_v": 0.006,
    "hook_x": 0.003,
}
#: Share of the RMS force from which on a stiffness that a Bingham simulator lacks counts as an effect.
_STIFF = 0.03


@dataclass(frozen=True)
class Part:
    """An addition to the rig's law: parameters of `rig.c` by size, and the effects that it resembles."""

    name: str
    sized: Sized
    also: tuple[str, ...]


@dataclass(frozen=True)
class Recipe:
    """Errors of a rig's simulator.

    law: of the simulator. extras, dependence: what `identify` frees in addition to the law's parameters. lag:
    of the driver (rig's parameters), which the simulator has too.
    """

    law: str
    parts: tuple[Part, ...]
    extras: tuple[str, ...]
    dependence: str
    lag: Numbers
    also: tuple[str, ...]

    def numbers(self, size: float) -> dict[str, float]:
        """Parameters of the rig in addition to its law's."""
        out = dict(self.lag)
        for part in self.parts:
            out |= part.sized(size)
        return out

    @property
    def of(self) -> list[str]:
        """Names of the parts."""
        return [part.name for part in self.parts]


def device(rng: np.random.Generator, *, frame: bool, mounted: bool) -> Device:
    """A damper with a law of the simulators, or with one that none of them has."""
    if mounted or rng.random() >= _SIGMOID:
        return dampers.draw(rng, frame=frame, mounted=mounted)
    drawn = {k: v * float(rng.uniform(0.8, 1.25)) for k, v in _KWOK.items()}
    machine = Machine(0.012 * float(rng.uniform(0.9, 1.3)), float(rng.uniform(0.15, 0.3)), 1.0)
    return Device("sigmoid", drawn, machine)


def draw(rng: np.random.Generator, task: Task, rig: Device, scale: Scale) -> Recipe:
    """A simulator's law and one to three parts, none of which resembles the effect of the case."""
    wanted = {part.partition("@")[0] for part in task.parts}
    law = str(rng.choice(NOMINAL[rig.law]))
    parts = [form(rng, scale, rig) for form in (_map, _slip, _rate)]
    parts = [part for part in parts if not wanted & set(part.also)]
    number = int(rng.choice([1, 2, 3], p=[0.35, 0.4, 0.25]))
    chosen = [parts[k] for k in sorted(rng.permutation(len(parts))[:number])]
    own_lag = "driver_lag" not in wanted and rng.random() < 0.25
    tau = float(rng.uniform(0.004, 0.015))
    lag = {"lag_form": 1, "lag_tau": tau, "lag_tau2": 0.4 * tau} if own_lag else {}
    preload = rig.parameters.get("x0", 0.0) != 0
    extras = [*(["offset"] if preload or rng.random() < 0.5 else []), *(["driver_lag"] if own_lag else [])]
    also = {name for part in chosen for name in part.also} | ({"driver_lag"} if own_lag else set())
    also |= set(_of_law(rig, law, scale)) - wanted
    dependence = str(rng.choice(["linear", "quadratic"], p=[0.75, 0.25]))
    return Recipe(law, tuple(chosen), tuple(extras), dependence, lag, tuple(sorted(also)))


def _of_law(rig: Device, law: str, scale: Scale) -> list[str]:
    """Effects in the rig's law for which the simulator's law has no parameter."""
    if law != "bingham" or rig.law == "bingham":
        return []
    p = rig.parameters
    stiffness = p.get("k0", 0.0) + p.get("k0a", 0.0) + (p["k1"] if rig.law == "modified_bouc_wen" else 0.0)
    spring = ["gas_spring"] if stiffness * scale.stroke > _STIFF * scale.force else []
    return ["mount_compliance", *spring] if rig.law != "sigmoid" else spring


Drawn = Callable[[np.random.Generator, Scale, Device], Part]


def _map(r: np.random.Generator, c: Scale, rig: Device) -> Part:
    """The yield force follows the current along an S: small slope at small currents, saturation at large
    ones."""
    share, steep, centre = r.uniform(0.5, 1.0), r.uniform(5.0, 10.0), r.uniform(0.35, 0.65)
    fixed = {"map_form": 1, "map_span": c.command, "map_steep": steep, "map_centre": centre}
    return Part("current_map", lambda s: {**fixed, "map_share": min(share * s, 1.0)}, ("saturation",))


def _slip(r: np.random.Generator, c: Scale, rig: Device) -> Part:
    """Maxwell-slip elements parallel to the law: hysteresis in the stroke, from the fluid or from friction.
    """
    force, travel = c.force * r.uniform(0.2, 0.4), c.stroke * r.uniform(0.3, 1.2)
    field = float(r.choice([0.0, r.uniform(0.5, 1.0)]))
    fixed = {"slip_field": field, "slip_span": c.command, "slip_travel": travel}
    return Part("slip_elements", lambda s: {**fixed, "slip_force": force * s}, ("seal_friction",))


def _rate(r: np.random.Generator, c: Scale, rig: Device) -> Part:
    """A yield force that grows or falls with the shear rate, at once or with the fluid's structure."""
    share, v = r.choice([-1.0, 1.0]) * r.uniform(0.25, 0.5), rig.machine.velocity * r.uniform(0.08, 0.3)
    form, time = int(r.integers(1, 3)), r.uniform(0.03, 0.15)
    fixed = {"rate_form": form, "rate_v": v, "rate_time": time}
    most = 0.9
    sized = lambda s: {**fixed, "rate_share": float(np.clip(share * s, -most, most))}  # noqa: E731
    return Part("rate_dependent_yield", sized, ("shear_thinning",))


def stages(also: Sequence[str], of: Mapping[str, str]) -> list[str]:
    """Stages at which a rig differs from its simulator without another cause: the fluid, and those of the
    effects it resembles."""
    return sorted({"fluid", *(of[name] for name in also)})
