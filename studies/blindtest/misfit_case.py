"""A case whose law is not the rig's: identified without the cause, recorded with it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mrdamp.model import Model
from studies.blindtest import (
    causes,
    commissioning,
    damper_case,
    excitation,
    frame_case,
    frame_causes,
    misfit,
    recorder,
    unknown,
)
from studies.blindtest.bench import Truth, damper_channels, frame_channels
from studies.blindtest.causes import Cause
from studies.blindtest.commissioning import Commissioned, predicted
from studies.blindtest.excitation import Excitation, Machine
from studies.blindtest.rig import ALL_LAWS, Array, Numbers
from studies.blindtest.sizing import OWN, Faint, Task, pooled, relative, total

#: Gap due to a cause relative to the law's own error: near the limit of visibility, and the least value if
#: well above. A cause as large as the law's error increases the gap to 1.4 times the base.
_NEAR, _CLEAR = (0.4, 0.8), 1.0
#: Least and largest gap due to a cause, relative to the RMS, and the least as a multiple of the noise.
_LEAST, _MOST, _NOISE = 0.05, 0.35, 4.0
#: Share of the least gap that must be present on tests outside the case.
_SHOWN = 0.6
#: Number of other forms that are drawn if a cause is not visible.
_FORMS = 4
#: Share of the cases with records of the rig in the commissioning state.
BASELINE = 0.4
#: Peak over RMS up to which a damper for a frame is commissioned.
_PEAKS = 3.0
#: Tests of a frame in the commissioning state.
_BEFORE = ("sweep_off", "quake_random", "quake_bang")
_FLOORS = tuple(f"floor{k}_acceleration_m_s2" for k in (1, 2, 3))


Tested = Mapping[str, Mapping[str, Array]]
Run = Callable[[Truth, Excitation], dict[str, Array]]


@dataclass(frozen=True)
class Bench:
    """A rig for cases: its tests, its simulator, and functions that draw and measure causes.

    held_out: tests outside the case. level: noise relative to the RMS. outputs: channel -> the simulated one
    in a test file.
    """

    made: Commissioned
    model: Model
    held_out: Mapping[str, Excitation]
    level: float
    outputs: Mapping[str, str]
    run: Run
    cause: Callable[[], Cause]
    size: Callable[[Cause, float], float]
    gaps_of_causes: Callable[[Mapping[str, Numbers], Sequence[Excitation]], dict[str, float]]
    records: Callable[[Truth], dict[str, dict[str, Array]]]
    nominal: Mapping[str, Any]
    recipe: misfit.Recipe


def make(task: Task, folder: Path, tests: Path, seed: np.random.SeedSequence) -> dict[str, Any]:
    """Writes the case folder and the file of its tests; returns its label with the true parameters. Raises
    Faint."""
    rng = np.random.default_rng(seed)
    bench = (_damper if task.rig == "damper" else _frame)(rng, task)
    stage, numbers, tested = _sized(rng, task, bench)
    baseline = bool(rng.random() < BASELINE)
    records = bench.records(bench.made.truth.having(numbers))
    before = _baseline(task, bench, next(iter(records.values()))) if baseline else {}
    recorder.write_case(folder, task.rig, bench.nominal, records, before)
    own, clean = (
        [_clean(bench, channels) for channels in of.values()] for of in (bench.made.held_out, tested)
    )
    recorder.write_tests(tests, dict(zip(tested, clean, strict=True)))
    stages = {name: of for name, (of, _) in causes.EFFECTS.items()}
    return {
        "label": task.label,
        "also": list(bench.recipe.also),
        "stages": [stage] if stage else misfit.stages(bench.recipe.also, stages),
        "gap": total(_gaps(bench, clean)),
        "base": total(_gaps(bench, own)),
        "size": numbers,
        "misfit": pooled(_gaps(bench, own)),
        "misfit_of": bench.recipe.of,
        "misfit_size": bench.made.size,
        "rig": task.rig,
        "weak": task.weak,
        "noise": bench.level,
        "baseline": baseline,
        "law": ALL_LAWS[int(bench.made.truth.numbers["law"])],
        "nominal_law": bench.model.law,
        "extras": list(bench.recipe.extras),
    }


def _damper(rng: np.random.Generator, task: Task) -> Bench:
    device = misfit.device(rng, frame=False, mounted=task.mounted)
    heats = "heating" in task.parts
    inputs = excitation.damper_tests(rng, device.machine, long=heats or bool(rng.random() < 0.6))
    held_out = excitation.held_out_damper_tests(rng, device.machine, long=heats)
    scale = damper_case.measure(device, inputs)
    noise = recorder.damper_noise(rng, scale.force, scale.command)
    recipe = misfit.draw(rng, task, device, scale)
    plain = Truth(device.numbers, filtered=bool(rng.random() < 0.5))

    def run(truth: Truth, test: Excitation) -> dict[str, Array]:
        return damper_channels(truth, test, test.rng)

    def left(model: Model, tested: Tested) -> float:
        return pooled([relative(predicted(model, c)["force_N"], c["force_N"]) for c in tested.values()])

    made = commissioning.commission(
        rng, recipe, plain, device.machine, noise, lambda truth: _runs(run, truth, held_out), left
    )
    few = [t for t in inputs if t.kind in ("random", "sine_random", *(["long"] if heats else []))]
    channels = damper_case.chosen_channels(rng, task)

    def cause() -> Cause:
        part = task.parts[0]
        return unknown.draw(rng, part, scale) if task.outside else causes.draw(rng, part, scale)

    return Bench(
        made,
        made.model,
        held_out,
        noise["force_N"].deviation / scale.force,
        {"force_N": "nominal_N"},
        run,
        cause,
        lambda found, target: damper_case.sized_to(made.truth, found, few, target),
        lambda parts, on: damper_case.gaps_of_causes(made.truth, parts, on),
        lambda truth: damper_case.recorded(rng, truth, inputs, noise, channels),
        commissioning.nominal(made.model),
        recipe,
    )


def _frame(rng: np.random.Generator, task: Task) -> Bench:
    device = misfit.device(rng, frame=True, mounted=task.mounted)
    damper_floors = frame_case.drawn_damper_floors(rng)
    plain = Truth(device.numbers, {}, bool(rng.random() < 0.5), frame_case.drawn_storeys(rng), damper_floors)
    inputs = excitation.frame_tests(rng, device.machine.command)
    held_out = excitation.held_out_frame_tests(rng, device.machine.command)
    few = frame_case.informative(inputs)
    scale = frame_case.measure(device, plain, few)
    recipe = misfit.draw(rng, task, device, scale.damper)
    speed = _PEAKS * scale.rate[max(damper_floors) - 1]
    machine = Machine(_PEAKS * scale.damper.stroke, speed, device.machine.command)
    on_bench = recorder.damper_noise(rng, scale.damper.force, scale.damper.command)
    structure = frame_case.structure_of(plain)

    def run(truth: Truth, test: Excitation) -> dict[str, Array]:
        return frame_channels(truth, test, test.rng)

    def left(model: Model, tested: Tested) -> float:
        framed = commissioning.in_frame(model, structure)
        said = [(predicted(framed, c), c) for c in tested.values()]
        return pooled([relative(p[name], c[name]) for p, c in said for name in _FLOORS])

    made = commissioning.commission(
        rng, recipe, plain, machine, on_bench, lambda truth: _runs(run, truth, held_out), left
    )
    noise = recorder.frame_noise(rng)

    def cause() -> Cause:
        return frame_causes.draw(rng, task.parts[0], scale, outside=task.outside)

    return Bench(
        made,
        commissioning.in_frame(made.model, structure),
        held_out,
        noise[_FLOORS[0]].deviation / float(np.mean(scale.acceleration)),
        {name: name.replace("floor", "nominal_floor").removesuffix("_m_s2") for name in _FLOORS},
        run,
        cause,
        lambda found, target: frame_case.sized_to(made.truth, found, few, target),
        lambda parts, on: frame_case.gaps_of_causes(made.truth, parts, on),
        lambda truth: frame_case.recorded(rng, truth, inputs, noise),
        {**commissioning.nominal(made.model), **structure},
        recipe,
    )


def _runs(run: Run, truth: Truth, tests: Mapping[str, Excitation]) -> Tested:
    return {name: run(truth, test) for name, test in tests.items()}


def _sized(rng: np.random.Generator, task: Task, bench: Bench) -> tuple[str, dict[str, float], Tested]:
    """Stage and parameters of the cause (empty without one), and the tests outside the case with it.

    Raises Faint if no form of it is visible.
    """
    if task.label == OWN:
        return "", {}, bench.made.held_out
    base, least = bench.made.misfit, _NOISE * bench.level
    low, high = (_NEAR[0] * base, _NEAR[1] * base) if task.weak else (max(_LEAST, _CLEAR * base), _MOST)
    for _ in range(_FORMS):
        target = max(float(np.exp(rng.uniform(np.log(low), np.log(high)))), least)
        cause = bench.cause()
        numbers = dict(cause.sized(bench.size(cause, target)))
        tested = _runs(bench.run, bench.made.truth.having(numbers), bench.held_out)
        if _opened(bench, cause.label, numbers, tested) >= max(_SHOWN * low, 0.5 * least):
            return cause.stage, numbers, tested
    raise Faint(f"{task.label}: no form of it opens a gap of {low:.3f}")


def _opened(bench: Bench, label: str, numbers: Numbers, tested: Tested) -> float:
    """The gap due to a cause on the tests outside the case, relative to the RMS."""
    if any(name.startswith(("reading.", "ground.")) for name in numbers):  # the simulator's inputs change too
        return bench.gaps_of_causes({label: numbers}, list(bench.held_out.values()))[label]
    plain = bench.made.held_out
    return pooled([relative(plain[test][k], c[k]) for test, c in tested.items() for k in bench.outputs])


def _baseline(task: Task, bench: Bench, channels: Mapping[str, Array]) -> dict[str, dict[str, Array]]:
    """Records of the rig in the commissioning state, with the case's channels: a damper's commissioning
    records, or separate ones of a frame."""
    if task.rig == "damper":
        return {
            file: {name: record[name] for name in channels} for file, record in bench.made.records.items()
        }
    records = bench.records(bench.made.truth)
    kept = [name for name in records if any(kind in name for kind in _BEFORE)]
    return {f"baseline_{name}": records[name] for name in kept}


def _clean(bench: Bench, channels: Mapping[str, Array]) -> dict[str, Array]:
    """Channels of a test, without noise, with the nominal simulator's output for its inputs."""
    kept = {n: v for n, v in channels.items() if n not in ("reference_force_N", "current_A", "temperature_C")}
    said = predicted(bench.model, kept)
    return {**kept, **{name: said[output] for output, name in bench.outputs.items()}}


def _gaps(bench: Bench, tests: Sequence[Mapping[str, Array]]) -> list[float]:
    return [relative(t[name], t[output]) for t in tests for output, name in bench.outputs.items()]
