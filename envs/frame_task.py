"""The task of the frame: ground motions, its default observation, and its reward."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import astuple
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mrdamp.envs.chain_rows import FRAMES
from mrdamp.envs.frame_xml import Position, sensor_name
from mrdamp.envs.loads import MotionSource, SyntheticMotions, cut, played
from mrdamp.envs.options import TaskOptions
from mrdamp.envs.plant import placed
from mrdamp.envs.reward import FrameReward, reference_run
from mrdamp.envs.task import Task, check_options
from mrdamp.envs.weights import Score
from mrdamp.errors import InputError, require_kind, require_positive
from mrdamp.model import Model, core
from mrdamp.motions import GroundMotion
from mrdamp.structures import ShearFrame

Array = NDArray[np.float64]

#: RMS over the scales under the default loads and commands that change evenly between none and the largest.
_TYPICAL = {
    "acceleration": 0.25, "displacement": 0.2, "velocity": 0.2, "drift": 0.1, "stroke": 0.1, "stroke_velocity": 0.1,
    "force": 0.13, "true_force": 0.13, "current": 0.6,
}  # fmt: skip
_STRONG = 5.0  # m/s2: floor acceleration that the scales of the observation belong to


class FrameTask(Task):
    """n frames under ground motions; arguments as in `FrameEnv`."""

    def __init__(
        self,
        n: int = 1,
        *,
        model: Model | Sequence[Model] | Path | str | None = None,
        structure: ShearFrame | None = None,
        damper_between: Position | Sequence[Position] | None = None,
        motions: MotionSource | None = None,
        reward: FrameReward | Mapping[str, Any] | None = None,
        duration: float | None = None,
        **options: Any,
    ) -> None:
        given = TaskOptions(**options)
        require_kind("a Model, its file, or one a damper", (Model, str, Path, list, tuple), model=model)
        require_kind("a ShearFrame", ShearFrame, structure=structure)
        require_kind("a source of motions", MotionSource, motions=motions)
        if duration is not None:
            require_positive("motions", duration=duration)
        if isinstance(model, str | Path):
            model = Model.read(model)
        self.models = placed(model, structure, damper_between)
        rows = given.rows(FRAMES, self.models, self.models, n=n)
        self.weights, self.duration = FrameReward.of(reward), duration
        if self.weights.reference == "passive-on" and len(self.models) > 1:
            raise InputError("reward: reference passive-on is for one damper; allowed here: uncontrolled")
        self.motions = SyntheticMotions() if motions is None else motions
        maximum = rows.command_max
        observer = given.observes(lambda full: frame_sensors(self.models, maximum, full), maximum, _TYPICAL)
        super().__init__(rows, Score(self.weights, n), observer, maximum, given.noise)

    @property
    def structure(self) -> ShearFrame:
        assert self.models[0].structure is not None
        return self.models[0].structure

    drawn_size = 0.10

    def reference_motion(self, row: int) -> float:
        """Peak drift, m."""
        return float(self.score.values[row, 0])

    def begin(
        self, row: int, rng: np.random.Generator, options: Mapping[str, Any], drawn: Mapping[str, float]
    ) -> dict[str, Any]:
        motion = self._motion(rng, options)
        every = max(1, round(1e-3 / self.rows.plants.timestep))
        ground, dt = self.rows.start(row, motion)[::every].copy(), every * self.rows.plants.timestep
        model, largest = self.rows.of(row).models[0], float(self.command_max[0])
        reference = self._references.of(
            ground, drawn, lambda: reference_run(model, ground, dt, self.weights.reference, largest)
        )
        self.score.start(row, astuple(reference), int(self.rows.steps[row]))
        return {
            "motion": motion.name,
            "pga": motion.pga,
            "duration": motion.duration,
            "speed": motion.speed,
            "reference_drift": reference.drift,
            "reference_acceleration": reference.acceleration,
        }

    def _motion(self, rng: np.random.Generator, options: Mapping[str, Any]) -> GroundMotion:
        amplitude = check_options(options, "motion", "compression")
        given = options.get("motion")
        motion = self.motions.draw(rng) if given is None else played(given, options.get("compression"))
        return cut(motion.scaled(amplitude), self.duration)


def frame_sensors(
    models: Sequence[Model], command_max: Array, full_state: bool
) -> tuple[list[str], dict[str, float]]:
    """Signals of a frame's sensors: floor accelerations, stroke and force of every damper.

    full_state: displacements, velocities and coil currents instead of strokes. Returns the signals, and the scale of
    every measurement (SI): those of a strong motion, which is 5 m/s2, the motion of the first mode with that
    acceleration, and the damper's force in it at the largest command.
    """
    structure = models[0].structure
    assert structure is not None
    floors, dampers = range(1, structure.storeys + 1), range(len(models))

    def of_dampers(name: str) -> list[str]:
        return [sensor_name(name, k) for k in dampers]

    signals = [f"acceleration_{j}" for j in floors]
    if full_state:
        signals += [f"displacement_{j}" for j in floors] + [f"velocity_{j}" for j in floors]
    signals += of_dampers("current" if full_state else "stroke") + of_dampers("force")
    w = 2 * math.pi * float(structure.frequencies[0])
    velocity, displacement = _STRONG / w, _STRONG / w**2
    scale = dict.fromkeys((f"acceleration_{j}" for j in floors), _STRONG)
    scale |= dict.fromkeys((f"velocity_{j}" for j in floors), velocity)
    scale |= dict.fromkeys(
        (f"{what}_{j}" for what in ("displacement", "drift") for j in floors), displacement
    )
    for k, (model, largest) in enumerate(zip(models, command_max.tolist(), strict=True)):
        force = largest_force(model, displacement, w, largest)
        own = (
            ("stroke", displacement),
            ("stroke_velocity", velocity),
            ("current", largest),
            ("force", force),
        )
        scale |= {sensor_name(name, k): value for name, value in (*own, ("true_force", force))}
    return signals, scale


def largest_force(model: Model, stroke: float, w: float, command: float) -> float:
    """N, of the damper moved by a sine of `stroke` (m) and w (rad/s) at a command."""
    t = np.linspace(0.0, 4 * math.pi / w, 801)
    x, v = stroke * np.sin(w * t), stroke * w * np.cos(w * t)
    out = core.run(model.law, model.attributes, float(t[1]), x, v, u=command, narx=model.narx)
    largest = float(np.abs(out["force"]).max())
    return largest if largest > 0 else 1.0
