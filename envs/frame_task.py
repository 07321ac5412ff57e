"""The task of the frame: ground motions, its default observation, and its reward."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mrdamp.control.observe import Observer
from mrdamp.envs.chain_rows import FRAMES, of_engine
from mrdamp.envs.frame_rows import command_range
from mrdamp.envs.frame_xml import Position, sensor_name
from mrdamp.envs.loads import MotionSource, SyntheticMotions, cut
from mrdamp.envs.plant import placed
from mrdamp.envs.reward import FrameReward, Reference, Score, reference_run
from mrdamp.envs.task import References, Task, check_options, observer_of
from mrdamp.errors import InputError
from mrdamp.model import Model, core
from mrdamp.motions import GroundMotion, read_motion
from mrdamp.structures import ShearFrame

Array = NDArray[np.float64]

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
        observer: Observer | Mapping[str, Any] | None = None,
        signals: Sequence[str] | None = None,
        history: int = 1,
        action_in_observation: bool = True,
        memory: Sequence[float] = (),
        peaks: Mapping[str, float] | None = None,
        full_state: bool = False,
        noise: Mapping[str, float] | None = None,
        period: float = 5e-3,
        timestep: float | None = None,
        command_max: float | Sequence[float] | None = None,
        duration: float | None = None,
        engine: str = "mujoco",
        threads: int = 1,
    ) -> None:
        structures, step = of_engine(FRAMES, engine)
        if isinstance(model, str | Path):
            model = Model.read(model)
        self.models = placed(model, structure, damper_between)
        maximum = command_range(self.models, command_max)
        self.frame_rows = structures(
            self.models, period, step if timestep is None else timestep, maximum, n, threads
        )
        self._references = References[Reference]()
        seen = observer_of(
            observer, frame_observer, self.models, maximum, signals, history, action_in_observation, memory,
            full_state, peaks,
        )  # fmt: skip
        weights = reward if isinstance(reward, FrameReward) else FrameReward.from_dict(reward or {})
        if weights.reference == "passive-on" and len(self.models) > 1:
            raise InputError("reward: reference passive-on is for one damper; allowed here: uncontrolled")
        self.motions = SyntheticMotions() if motions is None else motions
        self.weights, self.duration = weights, duration
        self.frame_score = Score(weights, n)
        super().__init__(self.frame_rows, self.frame_score, seen, maximum, noise)

    @property
    def structure(self) -> ShearFrame:
        return self.frame_rows.structure

    drawn_size = 0.10

    def reference_motion(self, row: int) -> float:
        """Peak drift, m."""
        return float(self.frame_score.values[row, 0])

    def begin(self, row: int, rng: np.random.Generator, options: Mapping[str, Any]) -> dict[str, Any]:
        motion = self._motion(rng, options)
        ground = self.frame_rows.start(row, motion)
        dt = self.frame_rows.plants.timestep
        every = max(1, round(1e-3 / dt))
        reference = self.reference(ground[::every].copy(), every * dt)
        self.frame_score.start(row, reference)
        return {
            "motion": motion.name,
            "pga": motion.pga,
            "duration": motion.duration,
            "reference_drift": reference.drift,
            "reference_acceleration": reference.acceleration,
        }

    def reference(self, ground: Array, dt: float) -> Reference:
        """What the reward is measured by, of ground acceleration (samples,) m/s2 every dt."""
        return self._references.of(
            ground,
            lambda: reference_run(self.models[0], ground, dt, self.weights.reference, self.command_max[0]),
        )

    def _motion(self, rng: np.random.Generator, options: Mapping[str, Any]) -> GroundMotion:
        check_options(options, "motion", "amplitude")
        motion = options.get("motion")
        if motion is None:
            motion = self.motions.draw(rng)
        elif not isinstance(motion, GroundMotion):
            motion = read_motion(motion)
        return cut(motion.scaled(float(options.get("amplitude", 1.0))), self.duration)


def frame_observer(
    models: Sequence[Model],
    command_max: Array,
    signals: Sequence[str] | None = None,
    history: int = 1,
    action_in_observation: bool = True,
    memory: Sequence[float] = (),
    full_state: bool = False,
    peaks: Mapping[str, float] | None = None,
) -> Observer:
    """What the frame's sensors give: floor accelerations, stroke and force of every damper.

    full_state: displacements, velocities and coil currents instead of strokes. The scales are those of a strong
    motion: 5 m/s2, the motion of the first mode with that acceleration, and the damper's force in it at the largest
    command.
    """
    structure = models[0].structure
    assert structure is not None
    floors, dampers = range(1, structure.storeys + 1), range(len(models))
    if signals is None:
        signals = [f"acceleration_{j}" for j in floors]
        if full_state:
            signals += [f"displacement_{j}" for j in floors] + [f"velocity_{j}" for j in floors]
            signals += [sensor_name("current", k) for k in dampers]
        else:
            signals += [sensor_name("stroke", k) for k in dampers]
        signals += [sensor_name("force", k) for k in dampers]
    w = 2 * math.pi * float(structure.frequencies[0])
    scale = {"acceleration": _STRONG, "stroke_velocity": _STRONG / w, "velocity": _STRONG / w}
    scale |= dict.fromkeys(("displacement", "drift", "stroke"), _STRONG / w**2)
    found = []
    for name in signals:
        stem, _, number = name.rpartition("_") if name[-1].isdigit() else (name, "", "1")
        which = int(number) - 1
        if stem == "current" and which < len(models):
            found.append(float(command_max[which]))
        elif stem in ("force", "true_force") and which < len(models):
            found.append(largest_force(models[which], _STRONG / w**2, w, float(command_max[which])))
        elif stem in scale:
            found.append(scale[stem])
        else:
            raise InputError(f"observer: no measurement {name!r} in a frame of {structure.storeys} storeys")
    return Observer(
        tuple(signals), tuple(found), history, action_in_observation, tuple(command_max), memory=tuple(memory),
        peaks=peaks or {},
    )  # fmt: skip


def largest_force(model: Model, stroke: float, w: float, command: float) -> float:
    """N, of the damper moved by a sine of `stroke` (m) and w (rad/s) at a command."""
    t = np.linspace(0.0, 4 * math.pi / w, 801)
    x, v = stroke * np.sin(w * t), stroke * w * np.cos(w * t)
    out = core.run(model.law, model.attributes, float(t[1]), x, v, u=command, narx=model.narx)
    largest = float(np.abs(out["force"]).max())
    return largest if largest > 0 else 1.0
