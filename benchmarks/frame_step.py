"""Step time of the frame with the damper and its force sensor over that of the frame alone, and where it goes."""

from __future__ import annotations

import numpy as np

from benchmarks.frames import DYKE, Stepper, frame, profiling_clock
from benchmarks.result import Figure, Section, of_ratio
from benchmarks.timing import Effort, interleave, ratio

TARGET = "<= 2"


def compare(effort: Effort, timestep: float, *, bare: bool, clock: bool) -> Figure:
    """One row: a time step (s), the shipped frame or a bare one, with or without the engine's profiling clock."""
    with profiling_clock(clock):
        tasks = {
            "with": Stepper(frame(timestep, bare=bare), effort.steps),
            "without": Stepper(frame(timestep, damper=False, bare=bare), effort.steps),
        }
        costs = interleave(tasks, effort.rounds)
    what = f"{'bare' if bare else 'shipped'} frame, {timestep * 1e3:g} ms, {'with' if clock else 'no'} engine clock"
    return of_ratio(what, ratio(costs["with"], costs["without"]), TARGET)


def breakdown(effort: Effort) -> tuple[Figure, ...]:
    """Microseconds added by each part, by leaving it out: the bare frame at 0.5 ms without the engine's clock."""
    linear = ("bingham", {"c0a": 2100.0, "c0b": 350.0, "fya": 0.0, "fyb": 0.0, "v_ref": 0.01})
    models = {
        "frame": frame(5e-4, damper=False, bare=True),
        "linear": frame(5e-4, sensor=False, bare=True, law=linear),
        "law": frame(5e-4, sensor=False, bare=True),
        "sensor": frame(5e-4, bare=True),
    }
    with profiling_clock(False):
        costs = interleave({name: Stepper(m, effort.steps) for name, m in models.items()}, effort.rounds)
    parts = (
        ("frame alone", "frame", "", "the engine's own step"),
        (
            "adapter",
            "linear",
            "frame",
            "a law without state: the engine's calls, M^-1 J', the solve of the step",
        ),
        (
            "the law",
            "law",
            "linear",
            "hysteresis and driver lag, at every trial of the solve and once to catch up",
        ),
        (
            "force sensor",
            "sensor",
            "law",
            "the plugin, and the accelerations the engine works out for any such sensor",
        ),
    )
    return tuple(
        Figure(what, float(np.median(costs[a] - costs[b] if b else costs[a])), "us", detail=detail)
        for what, a, b, detail in parts
    )


def measure(effort: Effort) -> list[Section]:
    """Both tables."""
    rows = [
        compare(effort, timestep, bare=bare, clock=clock)
        for clock in (True, False)
        for bare in (False, True)
        for timestep in (5e-4, 1e-3)
    ]
    return [
        Section(
            "Frame with damper over frame without",
            f"With {DYKE.id}, driver lag and force sensor. `shipped`: "
            "models_xml/frame3; `bare`: without visual elements and accelerometers. Engine clock: of its profiler, "
            "which `import mujoco` installs.",
            tuple(rows),
        ),
        Section(
            "Where the time goes",
            "Differences of runs with and without a part. Bare frame, 0.5 ms, no engine clock.",
            breakdown(effort),
        ),
    ]
