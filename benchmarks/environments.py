"""Environments: rows of a batch against a loop over single ones, and the plugin against the law in Python."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import mujoco
import numpy as np
from gymnasium.vector import SyncVectorEnv

from benchmarks.frames import DYKE
from benchmarks.python_law import PythonDamper
from benchmarks.result import Figure, Section, of_ratio
from benchmarks.timing import Effort, Task, clock, interleave, ratio
from mrdamp.core import Array
from mrdamp.envs import AmbientLoads, CableEnv, FrameEnv
from mrdamp.envs.frame_xml import frame_xml
from mrdamp.envs.loads import RecordedMotions
from mrdamp.envs.plants import Plants
from mrdamp.envs.vector import CableVectorEnv, FrameVectorEnv, PlantVectorEnv
from mrdamp.motions import kanai_tajimi

ROWS = 8
#: One long motion with no end in a round, so that no reset is timed.
MOTIONS = RecordedMotions([kanai_tajimi(0, duration=400.0, sample_time=0.02, plateau=400.0)])
LOADS = AmbientLoads(duration=60.0)


class PythonPlants(Plants):
    """The frame of `Plants` whose damper is Python: the engine stepped one by one, the law a callback of it.

    finer: steps of the engine for each of the plugin's, of which the first is recorded. inner_law: inner steps of the
    law in each.
    """

    def __init__(self, plants: Plants, xml: str, finer: int, inner_law: int) -> None:
        root = ET.fromstring(xml)
        for group, kind in (("actuator", "plugin"), ("sensor", "plugin"), ("sensor", "actuatorfrc")):
            found = root.find(group)
            assert found is not None
            for item in found.findall(kind):
                found.remove(item)
        extension, option = root.find("extension"), root.find("option")
        assert extension is not None
        assert option is not None
        root.remove(extension)
        option.set("timestep", repr(plants.timestep / finer))
        self.__dict__.update(plants.__dict__)
        self.finer = finer
        self.bare = mujoco.MjModel.from_xml_string(ET.tostring(root, encoding="unicode"))
        self.data = mujoco.MjData(self.bare)
        self.damper = PythonDamper(DYKE.attributes(), inner_law)
        self.control = self.damper.control(self.data, 1, self.bare.opt.timestep)
        at = plants.sensors
        self.own = np.array(
            [at[name].start for name in ("force", "true_force", "stroke", "stroke_velocity", "pull")]
        )
        self.width = self.bare.nsensordata

    def _fill(self, row: Array) -> None:
        """One row of the record: the engine's sensors, and the damper's from its own numbers."""
        force, d = self.damper.force, self.data
        row[: self.width] = d.sensordata
        row[self.own] = force, force, d.qpos[1], d.qvel[1], -force

    def advance(self, commands: Array) -> tuple[dict[str, Array], dict[str, Array]]:
        k, load = int(self.step[0]), self._load[0]
        self.damper.command = float(commands[0, 0])
        record, model, data = self._record["sensordata"], self.bare, self.data
        push = data.ctrl
        mujoco.set_mjcb_control(self.control)
        try:
            for step in range(self.inner):
                push[0] = load[k + step, 0]
                mujoco.mj_step(model, data)
                self._fill(record[0, step])
                for _ in range(self.finer - 1):
                    mujoco.mj_step(model, data)
        finally:
            mujoco.set_mjcb_control(None)
        self.step += self.inner
        mujoco.mj_forward(model, data)
        now = np.zeros((1, record.shape[2]))
        self._fill(now[0])
        return self._record, {"sensordata": now}


def python_env(finer: int, inner_law: int) -> FrameEnv:
    """The frame's environment, everything as it is but for its plants."""
    env = FrameEnv(motions=MOTIONS)
    task = env.task
    rows = task.rows
    rows.plants = PythonPlants(rows.plants, frame_xml(rows.models, rows.plants.timestep), finer, inner_law)  # type: ignore[attr-defined]
    return env


def single(env: FrameEnv | CableEnv, steps: int) -> Task:
    """Cost of a step with an action that changes, us."""
    env.reset(seed=0)
    actions = np.random.default_rng(0).uniform(-1, 1, (steps, 1)).astype(np.float32)

    def run() -> float:
        begin = clock()
        for action in actions:
            env.step(action)
        return (clock() - begin) / steps

    return run


def many(env: SyncVectorEnv | PlantVectorEnv, steps: int) -> Task:
    """Cost of a step of one row, us."""
    env.reset(seed=0)
    actions = np.random.default_rng(0).uniform(-1, 1, (steps, ROWS, 1)).astype(np.float32)

    def run() -> float:
        begin = clock()
        for action in actions:
            env.step(action)
        return (clock() - begin) / steps / ROWS

    return run


def vector_rows(effort: Effort) -> tuple[Figure, ...]:
    """Rows of a batch against `SyncVectorEnv`, one thread each."""
    steps = max(effort.steps // 40, 5)
    pairs = {
        "frame": (
            SyncVectorEnv([lambda: FrameEnv(motions=MOTIONS)] * ROWS),
            FrameVectorEnv(ROWS, motions=MOTIONS),
        ),
        "cable": (SyncVectorEnv([lambda: CableEnv(loads=LOADS)] * ROWS), CableVectorEnv(ROWS, loads=LOADS)),
    }
    found = []
    for name, (loop, batch) in pairs.items():
        costs = interleave({"loop": many(loop, steps), "batch": many(batch, steps)}, effort.rounds)
        r = ratio(costs["loop"], costs["batch"])
        what = f"{name}, {ROWS} environments"
        found.append(of_ratio(what, r, "SyncVectorEnv", "batch", ">= 1.3", "a step of one environment"))
    return tuple(found)


def python_rows(effort: Effort) -> tuple[Figure, ...]:
    """The environment against itself with the law in Python."""
    steps = max(effort.steps // 20, 10)
    tasks = {
        "one": single(FrameEnv(motions=MOTIONS), steps),
        "row": many(FrameVectorEnv(ROWS, motions=MOTIONS), max(steps // ROWS, 2)),
        "python": single(python_env(1, 3), steps),
        "alike": single(python_env(5, 1), steps),
    }
    costs = interleave(tasks, effort.rounds)
    rows = (
        ("both at 0.5 ms, three inner steps of the law", "python", "one", ""),
        ("like accuracy, Python at 0.1 ms", "alike", "one", ">= 5"),
        (f"both at 0.5 ms, against a row of {ROWS} in a batch", "python", "row", ""),
        (f"like accuracy, against a row of {ROWS} in a batch", "alike", "row", ">= 5"),
    )
    return tuple(
        of_ratio(what, ratio(costs[a], costs[b]), "Python", "plugin", target) for what, a, b, target in rows
    )


def measure(effort: Effort) -> list[Section]:
    """Both tables."""
    return [
        Section(
            "Vector environments",
            "`mrdamp.envs.vector` on the engine's `Batch`, one thread, against Gymnasium's `SyncVectorEnv` over single "
            "environments; the numbers that come out are the same to the last bit.",
            vector_rows(effort),
        ),
        Section(
            "A step of the frame's environment against the law in Python",
            "`mrdamp/Frame-v0`, control period 5 ms, against the same environment whose damper is a `mjcb_control` "
            "callback (plain floats, as above), the engine stepped from Python: observation, reward and info are the "
            "same code. At 0.5 ms the callback's force in the frame is less accurate than the plugin's; at 0.1 ms they "
            "are alike (see the plugin against the law in Python).",
            python_rows(effort),
        ),
    ]
