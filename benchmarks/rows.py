"""Rows of closed loops on the chain against the environments in MuJoCo; threads; cost and memory by number of rows."""

from __future__ import annotations

import os
import time
import tracemalloc
from collections.abc import Callable

import numpy as np
from gymnasium.vector import SyncVectorEnv

from benchmarks.python_env import MOTIONS
from benchmarks.result import Figure, Section, of_ratio
from benchmarks.timing import Effort, Task, clock, interleave, ratio
from mrdamp.envs import AmbientLoads, CableEnv, CableTask, FrameEnv, FrameTask
from mrdamp.envs.task import Task as Rows
from mrdamp.envs.vector import CableVectorEnv, FrameVectorEnv, PlantVectorEnv
from mrdamp.motions import kanai_tajimi

ROWS = 64
SIZES = (1, 8, 64, 512, 4096)
LOADS = AmbientLoads(duration=25.0)


def wall() -> float:
    """us that have gone by: what threads are for."""
    return time.perf_counter_ns() * 1e-3


def stepping(env: SyncVectorEnv | PlantVectorEnv, steps: int) -> Task:
    """Cost of a step of one row, us, no reset among them."""
    env.reset(seed=0)
    actions = np.random.default_rng(0).uniform(-1, 1, (steps, env.num_envs, 1)).astype(np.float32)

    def run() -> float:
        begin = clock()
        for action in actions:
            env.step(action)
        return float((clock() - begin) / steps / env.num_envs)

    return run


def advancing(task: Rows, steps: int, now: Callable[[], float]) -> Task:
    """Cost of the C entry's part of it, us."""
    actions = np.random.default_rng(0).uniform(-1, 1, (steps, task.n, 1))

    def run() -> float:
        begin = now()
        for action in actions:
            task.rows.advance(task.commands(action))
        return float((now() - begin) / steps / task.n)

    return run


def against_the_engine(effort: Effort) -> list[Figure]:
    """64 rows, one thread each."""
    few, some, many = (max(effort.steps // k, 2) for k in (500, 200, 20))
    cases = {
        "frame": (
            SyncVectorEnv([lambda: FrameEnv(motions=MOTIONS)] * ROWS),
            FrameVectorEnv(ROWS, motions=MOTIONS),
            FrameVectorEnv(ROWS, motions=MOTIONS, engine="chain"),
        ),
        "cable": (
            SyncVectorEnv([lambda: CableEnv(loads=LOADS)] * ROWS),
            CableVectorEnv(ROWS, loads=LOADS),
            CableVectorEnv(ROWS, loads=LOADS, engine="chain"),
        ),
    }
    found = []
    for name, (loop, batch, chain) in cases.items():
        tasks = {"loop": stepping(loop, few), "batch": stepping(batch, some), "chain": stepping(chain, many)}
        costs = interleave(tasks, effort.rounds)
        for other, target in (("loop", ">= 15"), ("batch", ">= 8")):
            title = {"loop": "SyncVectorEnv", "batch": "Batch"}[other]
            r = ratio(costs[other], costs["chain"])
            found.append(of_ratio(f"{name}, {ROWS} rows over {title}", r, target))
    return found


def threads(effort: Effort) -> list[Figure]:
    """Two threads over one, in wall-clock time."""
    if len(os.sched_getaffinity(0)) < 2:
        return [Figure("two threads over one", target=">= 1.8", skipped="one core alone")]
    steps, found = max(effort.steps // 20, 5), []
    cases = (("frame", FrameTask, ROWS), ("frame", FrameTask, 1024), ("cable", CableTask, ROWS))
    for name, make, rows in cases:
        tasks = {}
        for count in (1, 2):
            task = make(rows, engine="chain", threads=count)
            load = {"motion": MOTIONS.draw(np.random.default_rng(0))} if make is FrameTask else {}
            task.reset(range(rows), [np.random.default_rng(k) for k in range(rows)], load)
            tasks[str(count)] = advancing(task, max(steps * ROWS // rows, 2), wall)
        costs = interleave(tasks, effort.rounds)
        r = ratio(costs["1"], costs["2"])
        found.append(of_ratio(f"{name}, {rows} rows, two threads over one", r, ">= 1.8"))
    return found


def sizes(effort: Effort) -> list[Figure]:
    """Cost and memory of a row; every row under a motion of its own, of 5 s."""
    motion = kanai_tajimi(1, duration=25.0, pga=3.0).compressed(5.0)
    found, tasks, memory = [], {}, {}
    for n in SIZES:
        tracemalloc.start()
        task = FrameTask(n, engine="chain")
        rngs = [np.random.default_rng(k) for k in range(n)]
        for row in range(n):
            task.reset([row], rngs, {"motion": motion, "amplitude": 1 + 1e-3 * row})
        memory[n] = tracemalloc.get_traced_memory()[0] / 1024 / n
        tracemalloc.stop()
        steps = max(effort.steps * 4 // n, 1)
        actions = np.random.default_rng(0).uniform(-1, 1, (steps, n, 1))

        def run(task: Rows = task, actions: np.ndarray = actions, n: int = n) -> float:
            begin = clock()
            for action in actions:
                task.step(action)
            return (clock() - begin) / len(actions) / n

        tasks[str(n)] = run
    costs = interleave(tasks, effort.rounds)
    for n in SIZES:
        note = f"{memory[n]:.0f} KiB a row"
        found.append(
            Figure(f"frame, {n} rows, a step of one", float(np.median(costs[str(n)])), "us", detail=note)
        )
    return found


def measure(effort: Effort) -> list[Section]:
    """One table."""
    return [
        Section(
            "Rows on the chain",
            '`engine="chain"` over MuJoCo. Control period 5 ms; '
            "steps of 0.5 ms (frame), 0.125 ms (cable). Rows on threads: wall-clock time of the C "
            "entry's part, two idle cores; the others: one thread.",
            (*against_the_engine(effort), *threads(effort), *sizes(effort)),
        )
    ]
