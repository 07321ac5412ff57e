"""Samples per second of the C entry against stepping the test rig in MuJoCo."""

from __future__ import annotations

import math
from collections.abc import Mapping

import mujoco
import numpy as np

from benchmarks.frames import BLOCK, DYKE
from benchmarks.result import Section, of_ratio
from benchmarks.timing import Effort, clock, interleave, ratio
from mrdamp import models_xml
from mrdamp.model import core
from mrdamp.model.core import Array

TARGET = ">= 15"
STROKE, FREQUENCY = 0.01, 2.5  # m, Hz
YIELD_FORCE, EXPONENT, YIELDS = 1e3, 1.5, (1e-3, 1e-4, 1e-5)  # N, -, m


class Entry:
    """A record of a sine through `mrdamp_run`, one parameter set, one thread."""

    def __init__(
        self, dt: float, samples: int, law: str = DYKE.law, attributes: Mapping[str, float] | None = None
    ) -> None:
        t = np.arange(samples) * dt
        w = 2.0 * math.pi * FREQUENCY
        self.dt, self.x, self.v = dt, STROKE * np.sin(w * t), STROKE * w * np.cos(w * t)
        self.u: Array = 1.125 + 1.125 * np.sin(3.0 * t)
        self.law, self.params = law, core.vector(law, attributes or DYKE.attributes())

    def __call__(self) -> float:
        """Cost of a sample, us."""
        begin = clock()
        force = core.run_many(self.law, self.params, self.dt, self.x, self.u, v=self.v)
        cost = (clock() - begin) / len(self.x)
        if not np.isfinite(force).all():
            raise RuntimeError("the C entry gives forces that are not finite")
        return cost


class Rig:
    """The shipped rig on the same sine. driven: motion and command set before every step, as a record needs;
    otherwise BLOCK steps of the engine in one call."""

    def __init__(self, dt: float, steps: int, *, driven: bool) -> None:
        self.model = mujoco.MjModel.from_xml_path(str(models_xml.path("rig")))
        self.model.opt.timestep = dt
        self.data, self.every = mujoco.MjData(self.model), 1 if driven else BLOCK
        self.calls, self.now = max(steps // self.every, 1), 0
        w, period = 2.0 * math.pi * FREQUENCY, round(2.0 / FREQUENCY / dt)
        t = np.arange(0, period, self.every) * dt
        x, v = STROKE * np.sin(w * t), STROKE * w * np.cos(w * t)
        self.rows = list(zip(x.tolist(), v.tolist(), (1.125 + 1.125 * np.sin(3.0 * t)).tolist(), strict=True))

    def __call__(self) -> float:
        """Cost of a step, us."""
        m, d, rows, every, step = self.model, self.data, self.rows, self.every, mujoco.mj_step
        qpos, qvel, ctrl = d.qpos, d.qvel, d.ctrl
        begin = clock()
        for k in range(self.now, self.now + self.calls):
            qpos[0], qvel[0], ctrl[0] = rows[k % len(rows)]
            step(m, d, every)
        cost = (clock() - begin) / (self.calls * every)
        self.now += self.calls
        if not 1.0 < abs(d.sensor("damper_force").data[0]) < 1e5:
            raise RuntimeError(f"the rig's force is {d.sensor('damper_force').data[0]} N")
        return cost


def bouc_wen(travel: float) -> dict[str, float]:
    """A Bouc-Wen law that yields at YIELD_FORCE after about `travel` (m)."""
    rate = 0.5 * travel**-EXPONENT
    return {
        "c0a": 500.0,
        "c0b": 500.0,
        "alpha_a": YIELD_FORCE / travel,
        "alpha_b": 0.0,
        "gamma": rate,
        "beta": rate,
        "A": 1.0,
        "n": EXPONENT,
        "k0": 0.0,
        "x0": 0.0,
    }


def rigid(effort: Effort) -> Section:
    """Cost of a Bouc-Wen law that is nearly rigid before it yields, over that of a compliant one."""
    laws = {f"{t:g}": Entry(1e-3, 10 * effort.steps, "bouc_wen", bouc_wen(t)) for t in YIELDS}
    costs = interleave(laws, effort.rounds)
    first, *others = costs
    return Section(
        "Rigid Bouc-Wen laws",
        f"Cost of a sample at 1 ms of a Bouc-Wen law (exponent {EXPONENT:g}) by the travel at which it yields, "
        f"over that of a law that yields after {1e3 * YIELDS[0]:g} mm. Strokes are {1e3 * STROKE:g} mm.",
        tuple(
            of_ratio(
                f"yields after {1e3 * float(t):g} mm", ratio(costs[t], costs[first]), "rigid", "compliant"
            )
            for t in others
        ),
    )


def measure(effort: Effort) -> list[Section]:
    """The tables."""
    rows = []
    for dt in (5e-4, 1e-3):
        costs = interleave(
            {
                "entry": Entry(dt, 10 * effort.steps),
                "rig": Rig(dt, effort.steps, driven=True),
                "engine": Rig(dt, effort.steps, driven=False),
            },
            effort.rounds,
        )
        driven, engine = (ratio(costs[name], costs["entry"]) for name in ("rig", "engine"))
        rows += [
            of_ratio(f"rig driven by a record, {dt * 1e3:g} ms", driven, "rig step", "C entry", TARGET),
            of_ratio(f"the engine's steps alone, {dt * 1e3:g} ms", engine, "rig step", "C entry"),
        ]
    return [
        Section(
            "C entry against the rig in MuJoCo",
            f"Samples per second of `mrdamp_run` (one set of {DYKE.id}, one thread, called from "
            "Python) over steps per second of the shipped rig. The rig is driven by a record, with "
            "motion and command set from Python before every step, or the engine is stepped alone, "
            f"{BLOCK} steps per call at a constant velocity.",
            tuple(rows),
        ),
        rigid(effort),
    ]
