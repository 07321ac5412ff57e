"""Environments: rows of a batch against a loop over single ones, and the plugin against the law in Python."""

from __future__ import annotations

import mujoco
import mujoco.batch
import numpy as np
from gymnasium.vector import SyncVectorEnv

from benchmarks.accuracy import error
from benchmarks.python_env import AMPLITUDES, LOOPS, MOTIONS, forces, without_damper
from benchmarks.result import Figure, Section, of_ratio
from benchmarks.timing import Effort, Task, clock, interleave, ratio
from mrdamp.envs import AmbientLoads, CableEnv, FrameEnv
from mrdamp.envs.frame_rows import FrameRows
from mrdamp.envs.frame_xml import frame_xml
from mrdamp.envs.vector import CableVectorEnv, FrameVectorEnv, PlantVectorEnv

ROWS = 8
LOADS = AmbientLoads(duration=12.0)


def single(env: FrameEnv | CableEnv, steps: int) -> Task:
    """Cost of a step with an action that changes, us."""
    actions = np.random.default_rng(0).uniform(-1, 1, (steps, 1)).astype(np.float32)

    def run() -> float:
        env.reset(seed=0)
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
        found.append(of_ratio(what, r, ">= 1.3"))
    return tuple(found)


def engine(env: FrameEnv, steps: int) -> Task:
    """Cost of the engine and its calls in a step of an environment, us."""
    plants = env.task.rows.plants
    batch, pushes = mujoco.batch.Batch(plants.model, nsim=1, nthread=1), np.zeros((1, plants.inner, 2))
    batch.bind("sensordata")
    record = batch.rollout(plants.inner, pushes, record=("sensordata",))

    def run() -> float:
        begin = clock()
        for k in range(steps):
            pushes[:] = k % 3 - 1.0
            batch.rollout(plants.inner, pushes, record=("sensordata",), out=record)
            batch.forward()
        return (clock() - begin) / steps

    return run


def bare_frame(env: FrameEnv, steps: int) -> Task:
    """Cost of the engine's steps in a step of an environment that has neither damper nor sensors, us."""
    rows = env.task.rows
    assert isinstance(rows, FrameRows)
    model = without_damper(frame_xml(rows.structure.models, rows.plants.timestep), rows.plants.timestep, sensors=False)
    data = mujoco.MjData(model)

    def run() -> float:
        begin = clock()
        for k in range(steps):
            data.ctrl[0] = k % 3 - 1.0
            mujoco.mj_step(model, data, rows.plants.inner)
            mujoco.mj_forward(model, data)
        return (clock() - begin) / steps

    return run


def python_rows(effort: Effort) -> tuple[Figure, ...]:
    """The environment against itself with the law in Python, and the errors of their forces."""
    steps = max(effort.steps // 20, 10)
    env = FrameEnv(motions=MOTIONS)
    tasks = {
        "one": single(env, steps),
        "engine": engine(env, steps),
        "bare": bare_frame(env, steps),
        "row": many(FrameVectorEnv(ROWS, motions=MOTIONS), max(steps // ROWS, 2)),
        **{loop.what: single(loop.env(), steps) for loop in LOOPS},
    }
    costs = interleave(tasks, effort.rounds)
    converged = [forces(FrameEnv(motions=MOTIONS, timestep=2.5e-5), a) for a in AMPLITUDES]

    def errors(env: FrameEnv) -> str:
        found = [error(forces(env, a), exact) for a, exact in zip(AMPLITUDES, converged, strict=True)]
        return " / ".join(f"{e:.2%}" for e in found)

    rows = []
    for loop in LOOPS:
        r, note = ratio(costs[loop.what], costs["one"]), f"force errors {errors(loop.env())}"
        rows.append(of_ratio(loop.what, r, loop.target, note))
    r, own = ratio(costs[LOOPS[1].what], costs["row"]), errors(FrameEnv(motions=MOTIONS))
    what = f"equal accuracy, over a row of {ROWS} in a batch"
    rows.append(of_ratio(what, r, note=f"the plugin's force errors {own}"))
    for what, name in (("with damper and sensors", "engine"), ("without both", "bare")):
        rows.append(Figure(f"the engine's part of a step, frame {what}", float(np.median(costs[name])), "us"))
    return tuple(rows)


def measure(effort: Effort) -> list[Section]:
    """Both tables."""
    return [
        Section(
            "Vector environments",
            "`mrdamp.envs.vector` on the engine's `Batch`, one thread, against Gymnasium's "
            "`SyncVectorEnv`, with the same results to the bit.",
            vector_rows(effort),
        ),
        Section(
            "A step of the frame's environment against the law in Python",
            "`mrdamp/Frame-v0`, control period 5 ms. Force errors: against the environment at 0.025 ms, for peak "
            "ground accelerations of 3.4, 8 (strongest default motion) and 17 m/s2.",
            python_rows(effort),
        ),
    ]
