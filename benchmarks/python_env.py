"""The frame's environment with its damper in Python, and how far the forces of either are from the converged ones."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass

import mujoco
import numpy as np

from benchmarks.frames import DYKE
from benchmarks.python_law import PythonDamper
from mrdamp.envs import FrameEnv
from mrdamp.envs.frame_rows import FrameRows
from mrdamp.envs.frame_xml import frame_xml
from mrdamp.envs.loads import RecordedMotions
from mrdamp.envs.plants import Plants
from mrdamp.model.core import Array
from mrdamp.motions import TIME_SCALE, kanai_tajimi

#: One long motion with no end in a round, so that no reset is timed.
MOTIONS = RecordedMotions([kanai_tajimi(0, duration=400.0, sample_time=0.02, plateau=400.0)], compression=TIME_SCALE)


def without_damper(xml: str, timestep: float, *, sensors: bool = True) -> mujoco.MjModel:
    """The frame of `frame_xml` at another step (s), without its damper; sensors: with those of the engine."""
    root = ET.fromstring(xml)
    parts = {part.tag: part for part in root}
    for group in (parts["actuator"], parts["sensor"]):
        for item in [i for i in group if i.tag == "plugin" or i.get("actuator") == "damper"]:
            group.remove(item)
    root.remove(parts["extension"])
    if not sensors:
        root.remove(parts["sensor"])
    parts["option"].set("timestep", repr(timestep))
    return mujoco.MjModel.from_xml_string(ET.tostring(root, encoding="unicode"))


class PythonPlants(Plants):
    """The frame of `Plants` whose damper is Python: the law called, and the engine stepped, one by one.

    law: with its command and force at each step in `qfrc_applied`, which is cheaper than a callback of the engine.
    finer: steps of the engine for each of the plugin's, of which the first is recorded; the ground moves in each.
    """

    def __init__(self, plants: Plants, xml: str, law: PythonDamper, finer: int = 1) -> None:
        self.__dict__.update(plants.__dict__)
        self.damper, self.parts = law, [k / finer for k in range(1, finer)]
        self.bare = without_damper(xml, plants.timestep / finer)
        self.data = mujoco.MjData(self.bare)
        self.law = law.control(self.data, 1, self.bare.opt.timestep)
        self.after = np.zeros((1, len(self.record["sensordata"][0, 0])))

    def start(self, row: int, load: Array, sample_time: float, steps: int) -> None:
        super().start(row, load, sample_time, steps)
        mujoco.mj_resetData(self.bare, self.data)

    def _own(self) -> tuple[float, ...]:
        """The present values of `SIGNALS`; it stands behind the engine's sensors."""
        damper, d = self.damper, self.data
        force = damper.force
        return force, force, d.qpos.item(1), d.qvel.item(1), damper.current, -force

    def advance(self, commands: Array) -> tuple[dict[str, Array], dict[str, Array]]:
        model, data, damper, step = self.bare, self.data, self.damper, mujoco.mj_step
        damper.command = commands.item(0)
        if self.step[0] == 0:
            self.law = damper.control(data, 1, model.opt.timestep)
            self.law(model, data)
        law, record = self.law, self.record["sensordata"][0]
        load = self.loads_at(np.zeros(1, np.int64), self.step[:, None] + self._ahead)[0, :, 0].tolist()
        push, sensors, own = data.ctrl, data.sensordata, []
        frame = record[:, : len(sensors)]
        for k in range(self.inner):
            push[0] = load[k]
            own.append(self._own())
            step(model, data)
            frame[k] = sensors
            law(model, data)
            for part in self.parts:
                push[0] = load[k] + part * (load[k + 1] - load[k])
                step(model, data)
                law(model, data)
        record[:, len(sensors) :] = own
        self.step += self.inner
        push[0] = load[-1]
        mujoco.mj_forward(model, data)
        self.after[0] = *sensors, *self._own()
        return self.record, {"sensordata": self.after}


def python_env(law: PythonDamper, finer: int = 1) -> FrameEnv:
    """The frame's environment, everything as it is but for its plants."""
    env = FrameEnv(motions=MOTIONS)
    rows = env.task.rows
    assert isinstance(rows, FrameRows)
    rows.plants = PythonPlants(rows.plants, frame_xml(rows.structure.models, rows.plants.timestep), law, finer)
    return env


def forces(env: FrameEnv, amplitude: float, steps: int = 400) -> Array:
    """(steps,) of the damper, N, under the benchmark's motion and commands that change every 20 ms."""
    env.reset(seed=0, options={"amplitude": amplitude})
    observer, found = env.task.observer, np.empty(steps)
    at = observer.signals.index("force")
    for k, action in enumerate(np.random.default_rng(1).uniform(-1, 1, steps // 4).repeat(4)):
        seen = env.step(np.array([action], np.float32))[0]
        found[k] = observer.scales[at] * seen[at]
    return found


@dataclass(frozen=True)
class Loop:
    """A way to run the law in Python: the engine's steps for each of the plugin's, inner steps of the law."""

    what: str
    finer: int
    inner: int
    abreast: bool
    target: str = ""

    def env(self) -> FrameEnv:
        return python_env(PythonDamper(DYKE.attributes(), self.inner, self.abreast), self.finer)


LOOPS = (
    Loop("both at 0.5 ms, velocity of the engine", 1, 3, abreast=False),
    Loop(
        "equal accuracy: both at 0.5 ms, velocity extrapolated by half a step",
        1,
        3,
        abreast=True,
        target=">= 5",
    ),
    Loop("the same with five inner steps of the law for three", 1, 5, abreast=True, target=">= 5"),
    Loop("Python at 0.1 ms, velocity of the engine", 5, 1, abreast=False, target=">= 5"),
)
#: Factors on the motion of 3.4 m/s2: as it is, the strongest of the environment's own motions, and one beyond.
AMPLITUDES = (1.0, 2.35, 5.0)
