"""True dampers: the laws with parameters drawn around published and measured values."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from mrdamp import sets
from studies.blindtest.excitation import Machine
from studies.blindtest.rig import ALL_LAWS, RATE_HZ, Numbers
from studies.blindtest.sizing import Task, goal, size_for

#: Never drawn: shape parameters, and positions.
_FIXED = ("n", "x0", "v_ref", "m0")

#: Dampers of about 1 kN on a bench, in addition to the published sets: law, parameters, largest command (A),
#: stroke (m).
_BENCH: Mapping[str, tuple[str, dict[str, float], float, float]] = {
    "bench bouc_wen": (
        "bouc_wen",
        {
            "c0a": 760,
            "c0b": 890,
            "alpha_a": 21e3,
            "alpha_b": 119e3,
            "gamma": 1.1e6,
            "beta": 1.1e6,
            "A": 155,
            "n": 2,
            "k0": 240,
            "x0": 0,
        },
        1.0,
        0.012,
    ),
    "bench hyperbolic_tangent": (
        "hyperbolic_tangent",
        {
            "k0a": 760,
            "k0b": 430,
            "k1a": 9.2e4,
            "k1b": 9.7e4,
            "c0a": 550,
            "c0b": 700,
            "c1a": 780,
            "c1b": 520,
            "m0": 1.5,
        }
        | {"f0a": 66, "f0b": 680, "v_ref": 0.02},
        1.0,
        0.012,
    ),
    "bench bingham": ("bingham", {"c0a": 700, "c0b": 800, "fya": 70, "fyb": 620, "v_ref": 0.008}, 1.0, 0.012),
}
#: Published sets that a rig can be made of, with their stroke (m) and relative frequency among cases.
_PUBLISHED = {"dyke1996_3kN": 0.012, "spencer1997_3kN": 0.012, "lai_liao2002_rd1005": 0.012}
_WEIGHTS = {
    "bench bouc_wen": 6,
    "bench hyperbolic_tangent": 6,
    "bench bingham": 1,
    "dyke1996_3kN": 4,
    "spencer1997_3kN": 1,
    "lai_liao2002_rd1005": 2,
}


@dataclass(frozen=True)
class Device:
    """A damper: law, its parameters by the contract's names, and the limits of its machine."""

    law: str
    parameters: dict[str, float]
    machine: Machine

    @property
    def numbers(self) -> dict[str, float]:
        """Parameters in the form of the rig."""
        return {"law": float(ALL_LAWS.index(self.law)), **self.parameters}

    def piston(self, force: float) -> float:
        """Mass (kg) of a piston behind a mount that deflects by 10 um under an RMS force (N).

        The integration step of the rig requires a mass that outweighs the damping and stiffness of the mount
        and of the damper before it yields.
        """
        p, step = self.parameters, 1 / RATE_HZ

        def top(name: str) -> float:
            return p.get(f"{name}a", 0.0) + p.get(f"{name}b", 0.0) * self.machine.command

        damping = top("c1" if self.law == "hyperbolic_tangent" else "c0") + 0.3 * force
        stiffness = top("alpha_") * p.get("A", 0.0) + top("k1") + force / 1e-5
        return max(damping * step / 1.2, stiffness * step**2 / 1.5**2)


def draw(rng: np.random.Generator, *, frame: bool = False, mounted: bool = False) -> Device:
    """A damper around one of the sets. frame: with zero force at rest. mounted: no stiffer than the rig's
    step allows."""
    names = [
        n
        for n in _WEIGHTS
        if not frame or n in ("dyke1996_3kN", "bench bouc_wen", "bench hyperbolic_tangent")
    ]
    names = [n for n in names if not mounted or n != "bench bingham"]
    weights = np.array([3.0 * _WEIGHTS[n] if frame and n in _PUBLISHED else _WEIGHTS[n] for n in names])
    name = str(rng.choice(names, p=weights / weights.sum()))
    if name in _PUBLISHED:
        published = sets.load(name)
        law, top, stroke = published.law, 1.5, _PUBLISHED[name]
        parameters = {k: v for k, v in published.parameters.items() if not k.startswith("command_")}
        if not frame and name == "dyke1996_3kN" and rng.random() < 0.5:
            parameters["x0"] = 0.02
    else:
        law, parameters, top, stroke = _BENCH[name]
    drawn = {k: v if k in _FIXED else v * float(rng.uniform(0.8, 1.25)) for k, v in parameters.items()}
    machine = Machine(stroke * float(rng.uniform(0.9, 1.3)), float(rng.uniform(0.15, 0.3)), top)
    return Device(law, drawn, machine)


def nominal_parameters(
    rng: np.random.Generator,
    task: Task,
    device: Device,
    gap: Callable[[Numbers], float],
    slight: tuple[float, float],
) -> dict[str, float]:
    """The nominal parameters: wrong if that is the label, slightly wrong in some of the other cases.

    gap: function from the simulator's parameters to its gap, relative to the RMS. slight: share of the other
    cases with slightly wrong parameters, and their size (see `perturbed`).
    """
    way = direction(rng, device.parameters)
    if task.label == "parameters":
        target = goal(rng, weak=False, noise=0.0)
        size = size_for(lambda size: gap(perturbed(device.parameters, way, size)), target)
        return perturbed(device.parameters, way, size)
    share, size = slight
    slightly = task.parts and not task.weak and not task.outside and rng.random() < share
    return perturbed(device.parameters, way, size if slightly else 0.0)


def perturbed(parameters: Numbers, direction: Mapping[str, float], size: float) -> dict[str, float]:
    """Parameters multiplied by exp(size * direction); those without a direction are unchanged."""
    return {k: v * float(np.exp(size * direction.get(k, 0.0))) for k, v in parameters.items()}


def direction(rng: np.random.Generator, parameters: Numbers) -> dict[str, float]:
    """Direction in which the parameters of a simulator are wrong: some of them, each by its own share."""
    names = [k for k, v in parameters.items() if k not in _FIXED and v != 0.0]
    wrong = rng.permutation(names)[: max(3, len(names) * 2 // 3)]
    return {str(k): float(rng.normal()) for k in wrong}
