"""A structure of one's own under loads that its source draws: one run, what is kept of it, and what tuning tries."""

from __future__ import annotations

import hashlib
import math
import secrets
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from mrdamp.compare.bench import ELECTRIC, TUNED, WINDOW, Measure, PlantBench, PlantRun
from mrdamp.control.told import knowledge
from mrdamp.envs.linear import LinearStructure
from mrdamp.envs.linear_rows import forces_of
from mrdamp.envs.loads import played
from mrdamp.errors import InputError
from mrdamp.model.core import Array
from mrdamp.motions import TIME_SCALE

_SEED, _MANY = 9_000_401, 6  # of the loads of the evaluation, for judging alone


@dataclass(frozen=True)
class GoalBench(PlantBench):
    """A structure with goals. Raises InputError."""

    of: LinearStructure
    compression: float = TIME_SCALE  # of the time of motion files
    unseen_amplitudes: ClassVar[tuple[float, ...]] = (1.0,)

    @property
    def structure(self) -> LinearStructure:
        return self.of

    @cached_property
    def measures(self) -> tuple[Measure, ...]:  # type: ignore[override]
        goals = (Measure(name, name, ratio=True) for name in self.structure.goals)
        return (*goals, *ELECTRIC, Measure("dissipated_energy", "dissipated (J)"))

    @property
    def headline(self) -> tuple[str, ...]:  # type: ignore[override]
        return (*self.structure.goals, "mean_command", "switching_rate")

    @property
    def claimed(self) -> tuple[str, ...]:  # type: ignore[override]
        return (*self.structure.goals, "mean_command")

    @property
    def tuned(self) -> Mapping[str, str]:
        return {name: kind for name, kind in TUNED.items() if kind != "skyhook" or self.structure.rod}

    def uncontrolled(self, load: Any) -> dict[str, Any]:
        return dict(zip(self.structure.goals, self.structure.uncontrolled(load, WINDOW).tolist(), strict=True))

    def kept(self, run: PlantRun) -> dict[str, Any]:
        found = {}
        for name, goal in self.structure.goals.items():
            column = run.of_period[:, self.structure.column(goal)]
            found[name] = float(column.mean() if goal.how == "rms" else column.max())
        return {**found, "dissipated_energy": float(run.of_period[:, -1].sum())}

    def values(self, kept: Mapping[str, Any], uncontrolled: Mapping[str, Any]) -> Mapping[str, float]:
        ratios = {name: kept[name] / uncontrolled[name] for name in self.structure.goals}
        squares = [name for name, goal in self.structure.goals.items() if goal.how == "rms"]
        return {**kept, **ratios, **{name: math.sqrt(ratios[name]) for name in squares}}

    def effort(self, kind: str) -> tuple[int, int]:
        return 1, 100_000 if kind == "force-tracking" else 400_000

    def read(self, files: Sequence[Path], speed: float) -> Sequence[Any]:
        return [played(motion, self.compression) for motion in super().read(files, speed)]

    def unseen_loads(self) -> list[Any]:
        return self.structure.some(np.random.default_rng(_SEED), _MANY)

    def own_identity(self) -> list[Any]:
        s = self.structure
        loads = hashlib.sha256(b"".join(self.forces(load).tobytes() for load in self.tuning_loads())).hexdigest()
        own = s.identity, repr(s.goals), s.strong, s.rod, loads
        return [*own, s.models[0].to_dict()["model"], self.period, self.timestep]

    def forces(self, load: Any) -> Array:
        """As of every bench, of a load that can be run at several amplitudes."""
        forces = forces_of(self.structure, load).copy()
        twice = forces_of(self.structure, load.scaled(2.0))
        said = "scaled(2) has not twice the forces"
        if not np.array_equal(forces_of(self.structure, load), forces):
            said = "scaled(2) changes the load itself"
        elif np.allclose(twice, 2.0 * forces, rtol=1e-6, atol=1e-9 * np.abs(forces).max()):
            return forces
        raise InputError(f"{load.name}: {said}; allowed: a new load with twice the forces")

    def key(self, spec: str, load: Any, amplitude: float) -> str:
        """Another one at every call: its code may read anything, so that no run is kept for later."""
        return secrets.token_hex(16)

    def about(self) -> str:
        model = self.structure.models[0]
        return (
            f"{model.name} in {self.structure.name}, {self.structure.first / (2 * math.pi):.2f} Hz, control period "
            f"{1e3 * self.period:g} ms; {knowledge(model)}"
        )
