"""The "real" frame that a controller meets: the reference rig with an effect that the simulator does not have.

The rig (`studies.blindtest`) shares no code with the plugin: another integrator and step, other forms of the effects.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from mrdamp import sets
from mrdamp.control.base import Controller
from mrdamp.errors import InputError
from mrdamp.gap import Scenario
from mrdamp.model import Model
from mrdamp.motions import GroundMotion
from mrdamp.simulation.criteria import Criteria
from mrdamp.simulation.stepping import FrameRun
from mrdamp.structures import dyke1996
from studies.blindtest.rig import INPUT_RATE_HZ, LAWS, RATE_HZ, Array, Numbers, run_frame_controlled

#: Effects by the catalogue's names: numbers of the rig, and of a storey (from 1; relative for mass and stiffness).
EFFECTS: Mapping[str, tuple[Mapping[str, float], Mapping[tuple[int, str], float]]] = {
    "driver_lag": ({"lag_form": 1.0, "lag_tau": 0.012, "lag_tau2": 0.006}, {}),
    "saturation": ({"sat_form": 1.0, "sat_level": 1.2}, {}),
    "seal_friction": (
        {"seal_form": 1.0, "seal_coulomb": 130.0, "seal_static": 1.3, "seal_v": 0.005, "seal_slide": 3e-5},
        {},
    ),
    "storey_stiffness@1": ({}, {(1, "stiffness"): -0.3}),
    "joint_friction@2": ({}, {(2, "friction_form"): 1.0, (2, "friction"): 60.0}),
    "floor_mass@3": ({}, {(3, "mass"): 0.3}),
    "sensor_gain": ({"cell_gain": 0.1}, {}),
    "sensor_lag": ({"cell_lag": 0.003}, {}),
}
#: The rig without an effect: the simulator, but for what the two programs differ by.
NONE = "none"
#: Hz of the logger: every instant of a control period of 1 ms is one of its own, but for a delay.
LOG_HZ = 5000.0
#: Steps of the rig from such an instant to the logger's sample. It so has the new command and what that does, and a
#: reading that jumps with the command does so in the middle between two samples, where a sum over samples has it.
_AFTER = 2
#: White noise of a sample: share of the channel's RMS. A tenth of its power is left at 500 Hz, 1 %.
_NOISE = 0.03
#: s, of what a run returns.
_SAMPLE = 1e-3


@dataclass(frozen=True)
class RealFrame:
    """The real frame with its damper: the nominal model (`nominal`, without effects) and a cause.

    damper: parameters of `rig.c` if the real damper has another law than the nominal one.
    """

    nominal: Model
    cause: str
    damper: Numbers | None = None
    numbers: Mapping[str, float] = field(init=False)
    storeys: tuple[Mapping[str, float], ...] = field(init=False)

    def __post_init__(self) -> None:
        if self.cause not in (*EFFECTS, NONE):
            raise InputError(f"gap: no effect '{self.cause}'; allowed: {', '.join(EFFECTS)}")
        structure = self.nominal.structure
        if structure is None or structure.storeys != 3 or self.nominal.effects:
            raise InputError(f"{self.nominal.name}: the rig takes a frame of three storeys without effects")
        numbers, changes = EFFECTS.get(self.cause, ({}, {}))
        damper = self.damper
        if damper is None:
            own = {k: v for k, v in self.nominal.parameters.items() if not k.startswith("command_")}
            damper = {"law": float(LAWS.index(self.nominal.law)), **own}
        storeys: list[dict[str, float]] = [
            {"mass": m, "stiffness": k, "damping": c}
            for m, k, c in zip(structure.mass, structure.stiffness, structure.damping, strict=True)
        ]
        for (storey, name), value in changes.items():
            row = storeys[storey - 1]
            row[name] = row[name] * (1 + value) if name in ("mass", "stiffness") else value
        object.__setattr__(self, "numbers", {**damper, **numbers})
        object.__setattr__(self, "storeys", tuple(storeys))

    def run(self, motion: GroundMotion, controller: Controller) -> tuple[FrameRun, dict[str, Array]]:
        """A ground motion (already as fast as it is to be) under a controller: the run at 1 ms, and the rig's own log
        at `RATE_HZ`."""
        structure = self.nominal.structure
        assert structure is not None
        assert structure.damper_between is not None
        steps = int(motion.duration * RATE_HZ)
        fine = np.arange(2 * steps + 1) / INPUT_RATE_HZ
        controller.reset()
        names = [(f"acceleration_{k}", f"acceleration{k}") for k in (1, 2, 3)]
        names += [(f"displacement_{k}", f"displacement{k}") for k in (1, 2, 3)]
        names += [(n, n) for n in ("stroke", "stroke_velocity", "force")]
        largest = self.nominal.attributes["command_max"]

        def command(t: float, measured: dict[str, float]) -> float:
            u = controller.command(t, {ours: measured[theirs] for ours, theirs in names})
            return min(max(u, 0.0), largest)

        every = round(controller.period * RATE_HZ)
        ground = np.interp(fine, motion.time, motion.acceleration)
        log = run_frame_controlled(
            self.numbers, self.storeys, structure.damper_between, ground, every, command
        )
        log["ground"] = ground[::2]
        at = slice(None, None, round(_SAMPLE * RATE_HZ))
        x = np.column_stack([log[f"displacement{k}"][at] for k in (1, 2, 3)])
        run = FrameRun(
            time=_SAMPLE * np.arange(len(x), dtype=np.float64),
            drift=np.diff(x, axis=1, prepend=0.0),
            acceleration=np.column_stack([log[f"acceleration{k}"][at] for k in (1, 2, 3)]),
            force=log["force"][at],
            stroke=log["stroke"][at],
            command=log["command"][at],
            current=log["current"][at],
        )
        return run, log


def record(log: Mapping[str, Array], rng: np.random.Generator) -> dict[str, Array]:
    """The log as a frame record's channels at `LOG_HZ`, with noise on what is measured.

    A force that jumps with the command has to stand beside the command that made it jump: where a controller switches
    in a quarter of its periods, a fifth of a millisecond is a gap of several percent.
    """
    at = slice(_AFTER, None, round(RATE_HZ / LOG_HZ))
    channels = {"ground_acceleration_m_s2": log["ground"][at], "command": log["command"][at]}
    measured = {f"floor{k}_acceleration_m_s2": log[f"acceleration{k}"][at] for k in (1, 2, 3)}
    measured |= {f"floor{k}_displacement_m": log[f"displacement{k}"][at] for k in (1, 2, 3)}
    measured["force_N"] = log["force"][at]
    for name, values in measured.items():
        size = _NOISE * float(np.sqrt(np.mean(values**2)))
        channels[name] = values + size * rng.standard_normal(len(values))
    return {"time_s": np.arange(len(log["ground"][at])) / LOG_HZ, **channels}


def nominal_frame() -> Model:
    """The nominal simulator: the frame and the damper of Dyke et al. (1996), no effect."""
    found = sets.load("dyke1996_3kN")
    return Model(found.law, dict(found.parameters), rig="frame", structure=dyke1996(), name="frame")


class RigScenario(Scenario):
    """A controller's workplace with real frames beside the simulators."""

    def criteria(self, plant: Any, controller: Controller | None, load: GroundMotion) -> Criteria:
        if not isinstance(plant, RealFrame):
            return super().criteria(plant, controller, load)
        assert controller is not None
        return self.of(plant.run(load, controller)[0])
