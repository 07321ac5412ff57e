"""One damper case: the true rig, the nominal simulator, records with noise, tests without."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from studies.blindtest import causes, dampers, excitation, recorder, unknown
from studies.blindtest.bench import Truth, damper_channels, nominal_damper
from studies.blindtest.causes import Cause
from studies.blindtest.excitation import Excitation
from studies.blindtest.recorder import Noise
from studies.blindtest.rig import RATE_HZ, Array, Numbers, run_damper
from studies.blindtest.scale import Scale
from studies.blindtest.sizing import Task, gap_by_cause, goal, must_show, pooled, relative, size_for

#: Causes that require a second force channel to be separated from the nominal parameters.
_NEED_REFERENCE = ("sensor_gain", "sensor_offset", "auto_range", "cell_hysteresis", "clipped_range")
#: Tests on which causes are sized.
TELLING = ("steps", "random", "sine_random")


def make(task: Task, folder: Path, tests: Path, seed: np.random.SeedSequence) -> dict[str, Any]:
    """Writes the case folder and the file of its tests; returns its label with the true parameters."""
    rng = np.random.default_rng(seed)
    device = dampers.draw(rng, mounted=task.mounted)
    heats = "heating" in task.parts
    inputs = excitation.damper_tests(rng, device.machine, long=heats or bool(rng.random() < 0.6))
    held_out = excitation.held_out_damper_tests(rng, device.machine, long=heats)
    plain = Truth(device.numbers, filtered=bool(rng.random() < 0.5))
    scale = measure(device, inputs)
    noise = recorder.damper_noise(rng, scale.force, scale.command)
    few = [test for test in inputs if test.kind in (*TELLING, *(["long"] if heats else []))]
    level = noise["force_N"].deviation / scale.force
    found = [_cause(rng, task, part, scale) for part in task.parts]
    parts = {c.label: c.sized(sized_to(plain, c, few, goal(rng, weak=task.weak, noise=level))) for c in found}
    for tests_of_it in (few, list(held_out.values())):
        must_show(gaps_of_causes(plain, parts, tests_of_it), level)
    numbers = causes.merged(list(parts.values()))
    truth = plain.having(numbers)
    parameters = _nominal_parameters(rng, task, device, plain, few)
    nominal_parameters = {**plain.numbers, **parameters}
    records = recorded(rng, truth, inputs, noise, chosen_channels(rng, task))
    recorder.write_case(folder, "damper", {"law": device.law, "parameters": parameters}, records)
    clean = {name: _clean(truth, nominal_parameters, test) for name, test in held_out.items()}
    recorder.write_tests(tests, clean)
    return {
        "label": task.label,
        "rig": task.rig,
        "stages": sorted({c.stage for c in found}) or (["fluid"] if task.label == "parameters" else []),
        "gap": pooled([relative(t["nominal_N"], t["force_N"]) for t in clean.values()]),
        "weak": task.weak,
        "noise": level,
        "law": device.law,
        "true_parameters": device.parameters,
        "numbers": numbers,
    }


def measure(device: dampers.Device, inputs: Sequence[Excitation]) -> Scale:
    """Scales of a damper without causes on its tests with a random command."""
    force, power, stroke, acceleration = [], [], [], []
    for test in (t for t in inputs if t.kind in ("sine_random", "random")):
        motion = test.spline()
        v = motion(test.time, 1)
        out = run_damper(device.numbers, motion(test.time), v, test.fine(test.command))
        force.append(out["force"])
        power.append(np.abs(out["force"] * v[::2]))
        stroke.append(motion(test.time))
        acceleration.append(motion(test.time[:: 2 * RATE_HZ // 1000], 2))

    def rms(parts: list[Array]) -> float:
        return float(np.sqrt(np.mean(np.concatenate(parts) ** 2)))

    mean_power = float(np.mean(np.concatenate(power)))
    piston = device.piston(rms(force))
    return Scale(rms(force), mean_power, rms(stroke), rms(acceleration), device.machine.command, piston)


def _cause(rng: np.random.Generator, task: Task, part: str, scale: Scale) -> Cause:
    return unknown.draw(rng, part, scale) if task.outside else causes.draw(rng, part, scale)


def sized_to(plain: Truth, cause: Cause, tests: Sequence[Excitation], target: float) -> float:
    """The size of the cause on a rig without other causes for a given gap."""
    predicted = [nominal_damper(plain.numbers, plain, test) for test in tests]
    reads = any(name.startswith("reading.") for name in cause.sized(1.0))

    def gap(size: float) -> float:
        truth = plain.having(cause.sized(size))
        gaps = []
        for test, before in zip(tests, predicted, strict=True):
            measured = damper_channels(truth, test, test.rng)["force_N"]
            gaps.append(relative(nominal_damper(plain.numbers, truth, test) if reads else before, measured))
        return pooled(gaps)

    return size_for(gap, target)


def gaps_of_causes(plain: Truth, parts: Mapping[str, Numbers], tests: Sequence[Excitation]) -> dict[str, float]:
    """Gap (relative to the RMS) due to each of a case's causes on tests: the reduction of the residual
    without it."""

    def residuals(names: Sequence[str]) -> list[tuple[Array, Array]]:
        truth = plain.having(causes.merged([parts[name] for name in names]))
        forces = [damper_channels(truth, test, test.rng)["force_N"] for test in tests]
        return [(f, f - nominal_damper(plain.numbers, truth, t)) for f, t in zip(forces, tests, strict=True)]

    return gap_by_cause(list(parts), residuals)


def _nominal_parameters(
    rng: np.random.Generator, task: Task, device: dampers.Device, plain: Truth, tests: Sequence[Excitation]
) -> dict[str, float]:
    @cache
    def measured() -> list[Array]:
        return [nominal_damper(plain.numbers, plain, test) for test in tests]

    def gap(parameters: Numbers) -> float:
        numbers = {**plain.numbers, **parameters}
        pairs = zip(tests, measured(), strict=True)
        return pooled([relative(nominal_damper(numbers, plain, test), force) for test, force in pairs])

    return dampers.nominal_parameters(rng, task, device, gap, slight=(0.4, 0.04))


def chosen_channels(rng: np.random.Generator, task: Task) -> list[str]:
    """Optional channels of this bench."""
    shares = {"reference_force_N": 0.4, "current_A": 0.15, "temperature_C": 0.1}
    names = [name for name, share in shares.items() if rng.random() < share]
    if "reference_force_N" not in names and any(part in _NEED_REFERENCE for part in task.parts):
        names.insert(0, "reference_force_N")
    return ["displacement_m", "command", "force_N", *names]


def recorded(
    rng: np.random.Generator,
    truth: Truth,
    inputs: Sequence[Excitation],
    noise: Mapping[str, Noise],
    channels: Sequence[str],
) -> dict[str, dict[str, Array]]:
    """Records by file name; the last one repeats the sine with a random command."""
    again = excitation.again(next(test for test in inputs if test.kind == "sine_random"))
    kinds = [*((test.kind, test) for test in inputs), ("repeat", again)]
    records = {}
    for number, (kind, test) in enumerate(kinds, 1):
        clean = damper_channels(truth, test, test.rng)
        records[f"{number:02d}_{kind}.csv.gz"] = {
            name: noise[name].onto(clean[name], rng) if name in noise else clean[name] for name in channels
        }
    return records


def _clean(truth: Truth, nominal_parameters: Numbers, test: Excitation) -> dict[str, Array]:
    channels = damper_channels(truth, test, test.rng)
    kept = {name: channels[name] for name in ("displacement_m", "command", "force_N")}
    return {**kept, "nominal_N": nominal_damper(nominal_parameters, truth, test)}
