"""A frame case for tests: records that SciPy integrated (`frame_reference`), with noise, and a simulator."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache, partial
from pathlib import Path

import numpy as np

import frame_reference
from excitation import Array
from mrdamp.diagnosis.case.folder import Case
from mrdamp.model import Effect, Model
from mrdamp.records import Record
from mrdamp.structures import ShearFrame

DT, HOLD, SECONDS = 0.002, 0.1, 2.4
NOISE = {"acceleration": 0.01, "displacement": 3e-6, "force": 3.0}

LAW = {
    "c0a": 2100.0, "c0b": 350.0, "c1a": 28300.0, "c1b": 295.0, "k0": 4690.0, "k1": 500.0, "x0": 0.0,
    "alpha_a": 14000.0, "alpha_b": 69500.0, "gamma": 3.63e6, "beta": 3.63e6, "A": 301.0, "n": 2.0,
}  # fmt: skip


def believed(lag: bool = True, **changed: tuple[float, float, float]) -> Model:
    """The model of the frame that SciPy integrates; lag: with its driver's lag; changed: stiffness, damping, mass."""
    structure = {
        "mass": (98.3, 98.3, 98.3),
        "stiffness": (5.16e5, 6.84e5, 6.84e5),
        "damping": (125.0, 50.0, 50.0),
    } | changed
    mass, stiffness, damping = (np.array(structure[k]) for k in ("mass", "stiffness", "damping"))
    frame = ShearFrame(mass, stiffness, damping, (0, 1))
    effects = (Effect("driver_lag", {"tau": 1 / 190}),) if lag else ()
    return Model("modified_bouc_wen", LAW, effects, "frame", frame, name="frame", sample_rate_hz=1 / DT)


def ground(t: Array, seed: int) -> Array:
    """m/s2: sines below 12 Hz under an envelope."""
    rng = np.random.default_rng(seed)
    out = np.zeros_like(t)
    for f in rng.uniform(0.8, 12.0, 14):
        out += rng.normal() * np.sin(2 * np.pi * f * t + rng.uniform(0, 6))
    return np.asarray(out * np.sin(np.pi * np.clip(t / SECONDS, 0, 1)) ** 0.5)


@cache
def records(seed: int = 1) -> dict[str, Record]:
    """off, steps and repeat (the steps again, new noise), by name."""
    # Sampled half a step after the command may jump: a line between two samples then has its middle where the jump is.
    t: Array = np.linspace(0, SECONDS, round(2 * SECONDS / DT) + 1)
    read = slice(1, None, 2)
    rng = np.random.default_rng(seed)
    count = round(SECONDS / HOLD)
    out: dict[str, Record] = {}
    for number, (name, commands) in enumerate(
        {"off": np.zeros(count), "steps": rng.choice([0.0, 0.7, 1.8], count)}.items()
    ):
        a = ground(t, seed + number)
        run = frame_reference.solve(partial(_at, t, a), commands, HOLD, 0.5 * DT)
        held = np.append(np.repeat(commands, round(2 * HOLD / DT)), commands[-1])
        found = {kind: values[read] for kind, values in run.items()}
        for again in (name, "repeat") if name == "steps" else (name,):
            out[again] = _noisy(again, t[read] - t[1], a[read], held[read], found, rng)
    return out


def _at(t: Array, a: Array, when: float) -> float:
    return float(np.interp(when, t, a))


def _noisy(
    name: str, t: Array, a: Array, command: Array, run: Mapping[str, Array], rng: np.random.Generator
) -> Record:
    channels = {"time_s": t, "ground_acceleration_m_s2": a, "command": command}
    for kind, unit in (("acceleration", "_m_s2"), ("displacement", "_m")):
        for j in (1, 2, 3):
            values = run[kind][:, j - 1]
            channels[f"floor{j}_{kind}{unit}"] = values + rng.normal(0, NOISE[kind], len(t))
    channels["force_N"] = run["force"] + rng.normal(0, NOISE["force"], len(t))
    return Record(name, None, DT, channels)


def case_of(model: Model, found: dict[str, Record]) -> Case:
    return Case("frame", Path(), model, (found["off"], found["steps"]), ((found["repeat"], 1),))


def altered(found: dict[str, Record], change: Callable[[Array], Array], *channels: str) -> dict[str, Record]:
    return {
        name: r.with_channels({c: change(np.asarray(r.channel(c))) for c in channels}) for name, r in found.items()
    }


def without(found: dict[str, Record], *channels: str) -> dict[str, Record]:
    kept = {name: {c: v for c, v in r.channels.items() if c not in channels} for name, r in found.items()}
    return {name: Record(r.name, None, DT, kept[name]) for name, r in found.items()}


def late(samples: int) -> Callable[[Array], Array]:
    return lambda x: np.concatenate([np.full(samples, x[0]), x[:-samples]])
