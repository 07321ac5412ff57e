"""One frame case: a shear frame of three storeys with a damper on a shaking table, and its nominal simulator.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from studies.blindtest import causes, dampers, excitation, frame_causes, recorder
from studies.blindtest.bench import Truth, felt_ground, frame_channels
from studies.blindtest.causes import Cause
from studies.blindtest.excitation import Excitation
from studies.blindtest.frame_causes import FrameScale
from studies.blindtest.recorder import Noise
from studies.blindtest.rig import Array, Numbers, run_frame
from studies.blindtest.scale import Scale
from studies.blindtest.sizing import Task, gap_by_cause, goal, must_show, pooled, relative, size_for

#: Masses (kg), stiffnesses (N/m) and damping (N s/m) of the frame of Dyke et al. 1996, doi:10.1088/0964-1726/5/5/006.
_MASS, _STIFFNESS, _DAMPING = (98.3, 98.3, 98.3), (5.16e5, 6.84e5, 6.84e5), (125.0, 50.0, 50.0)
_SPREAD = 0.12
_MEASURED = tuple(f"floor{k}_acceleration_m_s2" for k in (1, 2, 3))
_TELLING = ("quake_off", "quake_random", "quake_bang")


def make(task: Task, folder: Path, tests: Path, seed: np.random.SeedSequence) -> dict[str, Any]:
    """Writes the case folder and the file of its tests; returns its label with the true parameters."""
    rng = np.random.default_rng(seed)
    device = dampers.draw(rng, frame=True, mounted=task.mounted)
    plain = Truth(device.numbers, {}, bool(rng.random() < 0.5), drawn_storeys(rng), drawn_damper_floors(rng))
    inputs = excitation.frame_tests(rng, device.machine.command)
    held_out = excitation.held_out_frame_tests(rng, device.machine.command)
    few = informative(inputs)
    scale = measure(device, plain, few)
    noise = recorder.frame_noise(rng)
    level = noise[_MEASURED[0]].deviation / float(np.mean(scale.acceleration))
    found = [frame_causes.draw(rng, part, scale, outside=task.outside) for part in task.parts]
    parts = {c.label: c.sized(sized_to(plain, c, few, goal(rng, weak=task.weak, noise=level))) for c in found}
    for tests_of_it in (few, list(held_out.values())):
        must_show(gaps_of_causes(plain, parts, tests_of_it), level)
    numbers = causes.merged(list(parts.values()))
    truth = plain.having(numbers)
    parameters = _nominal_parameters(rng, task, device, plain, few)
    nominal_parameters = replace(plain, numbers={**plain.numbers, **parameters})
    nominal = {"law": device.law, "parameters": parameters, **structure_of(plain)}
    recorder.write_case(folder, "frame", nominal, recorded(rng, truth, inputs, noise))
    clean = {name: _clean(truth, nominal_parameters, test) for name, test in held_out.items()}
    recorder.write_tests(tests, clean)
    return {
        "label": task.label,
        "rig": task.rig,
        "stages": sorted({c.stage for c in found}) or (["fluid"] if task.label == "parameters" else []),
        "gap": pooled([_gap_of(t) for t in clean.values()]),
        "weak": task.weak,
        "noise": level,
        "law": device.law,
        "true_parameters": device.parameters,
        "numbers": numbers,
    }


def measure(device: dampers.Device, plain: Truth, inputs: Sequence[Excitation]) -> FrameScale:
    """Scales of a frame without causes on some of its tests."""
    runs = []
    for test in inputs:
        u = test.fine(test.command)
        runs.append(run_frame(plain.numbers, plain.storeys, plain.damper_floors, test.fine(test.motion), u))

    def rms(of: Sequence[Array]) -> float:
        return float(np.sqrt(np.mean(np.concatenate(of) ** 2)))

    def drift(out: Mapping[str, Array], k: int) -> Array:
        return out[f"displacement{k}"] - (out[f"displacement{k - 1}"] if k > 1 else 0.0)

    def rate(values: Array) -> Array:
        return np.gradient(values, 1 / 25_000)

    stroke = [out["stroke"] for out in runs]
    power = [np.abs(out["force"] * rate(out["stroke"])) for out in runs]
    force = rms([out["force"] for out in runs])
    damper = Scale(
        force,
        float(np.mean(np.concatenate(power))),
        rms(stroke),
        rms([out["acceleration1"] for out in runs]),
        device.machine.command,
        device.piston(force),
    )
    floors = frame_causes.STOREYS
    return FrameScale(
        damper,
        tuple(rms([drift(out, k) for out in runs]) for k in floors),
        tuple(rms([rate(drift(out, k)) for out in runs]) for k in floors),
        tuple(rms([out[f"acceleration{k}"] for out in runs]) for k in floors),
        tuple(s["stiffness"] for s in plain.storeys),
        tuple(s["damping"] for s in plain.storeys),
        tuple(s["mass"] for s in plain.storeys),
    )


def drawn_storeys(rng: np.random.Generator) -> tuple[dict[str, float], ...]:
    def drawn(value: float) -> float:
        return value * float(rng.uniform(1 - _SPREAD, 1 + _SPREAD))

    rows = zip(_MASS, _STIFFNESS, _DAMPING, strict=True)
    return tuple({"mass": drawn(m), "stiffness": drawn(k), "damping": drawn(c)} for m, k, c in rows)


def drawn_damper_floors(rng: np.random.Generator) -> tuple[int, int]:
    return (0, 1) if rng.random() < 0.8 else (1, 2)


def structure_of(plain: Truth) -> dict[str, Any]:
    names = {"mass": "mass_kg", "stiffness": "stiffness_n_m", "damping": "damping_n_s_m"}
    structure = {long: [s[short] for s in plain.storeys] for short, long in names.items()}
    return {"structure": structure, "damper_between": list(plain.damper_floors)}


def informative(inputs: Sequence[Excitation]) -> list[Excitation]:
    """One test of each kind that shows causes."""
    return [next(test for test in inputs if test.kind == kind) for kind in _TELLING]


def sized_to(plain: Truth, cause: Cause, tests: Sequence[Excitation], target: float) -> float:
    predicted = [frame_channels(plain, test, test.rng) for test in tests]
    reads = any(name.startswith("ground.") for name in cause.sized(1.0))

    def gap(size: float) -> float:
        truth = plain.having(cause.sized(size))
        gaps = []
        for test, before in zip(tests, predicted, strict=True):
            said = frame_channels(plain, test, test.rng, felt_ground(truth, test)) if reads else before
            gaps.append(_error(said, frame_channels(truth, test, test.rng)))
        return pooled(gaps)

    return size_for(gap, target)


def gaps_of_causes(plain: Truth, parts: Mapping[str, Numbers], tests: Sequence[Excitation]) -> dict[str, float]:
    """Gap (relative to the RMS) due to each of a case's causes on tests: the reduction of the residual
    without it."""

    def residuals(names: Sequence[str]) -> list[tuple[Array, Array]]:
        truth = plain.having(causes.merged([parts[name] for name in names]))
        measured = [frame_channels(truth, test, test.rng) for test in tests]
        said = [frame_channels(plain, test, test.rng, felt_ground(truth, test)) for test in tests]
        return [(m[n], m[n] - s[n]) for m, s in zip(measured, said, strict=True) for n in _MEASURED]

    return gap_by_cause(list(parts), residuals)


def _nominal_parameters(
    rng: np.random.Generator, task: Task, device: dampers.Device, plain: Truth, tests: Sequence[Excitation]
) -> dict[str, float]:
    none = np.random.default_rng(0)

    @cache
    def measured() -> list[dict[str, Array]]:
        return [frame_channels(plain, test, none) for test in tests]

    def gap(parameters: Numbers) -> float:
        other = replace(plain, numbers={**plain.numbers, **parameters})
        pairs = zip(tests, measured(), strict=True)
        return pooled([_error(frame_channels(other, test, none), m) for test, m in pairs])

    return dampers.nominal_parameters(rng, task, device, gap, slight=(0.3, 0.03))


def recorded(
    rng: np.random.Generator, truth: Truth, inputs: Sequence[Excitation], noise: Mapping[str, Noise]
) -> dict[str, dict[str, Array]]:
    """Records by file name; the last one repeats the last ground motion."""
    records = {}
    kinds = [*((t.kind, t) for t in inputs), ("repeat", excitation.again(inputs[-1]))]
    for number, (kind, test) in enumerate(kinds, 1):
        clean = frame_channels(truth, test, test.rng)
        records[f"{number:02d}_{kind}.csv.gz"] = {
            name: noise[name].onto(values, rng) if name in noise else values for name, values in clean.items()
        }
    return records


def _clean(truth: Truth, nominal_parameters: Truth, test: Excitation) -> dict[str, Array]:
    channels = frame_channels(truth, test, test.rng)
    nominal = frame_channels(nominal_parameters, test, test.rng, felt_ground(truth, test))
    said = {name.replace("floor", "nominal_floor").removesuffix("_m_s2"): nominal[name] for name in _MEASURED}
    return {**channels, **said, "nominal_N": nominal["force_N"]}


def _error(simulated: Mapping[str, Array], measured: Mapping[str, Array]) -> float:
    return pooled([relative(simulated[name], measured[name]) for name in _MEASURED])


def _gap_of(test: Mapping[str, Array]) -> float:
    said = (name.replace("floor", "nominal_floor").removesuffix("_m_s2") for name in _MEASURED)
    return pooled([relative(test[s], test[name]) for s, name in zip(said, _MEASURED, strict=True)])
