"""The nominal simulator of a rig: identified on commissioning records by the fit of `mrdamp identify`."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mrdamp.identify import identify
from mrdamp.model import Model
from mrdamp.records import Record
from mrdamp.simulation.predict import INPUTS, free_run
from studies.blindtest import excitation
from studies.blindtest.bench import SAMPLE_RATE_HZ, Truth, damper_channels
from studies.blindtest.excitation import Excitation, Machine
from studies.blindtest.misfit import Recipe
from studies.blindtest.misfit_score import PARTED
from studies.blindtest.recorder import Noise
from studies.blindtest.rig import Array
from studies.blindtest.sizing import Faint

#: Least and largest error of an identified simulator on tests that it was not fitted to, relative to the RMS.
MISFIT = (0.03, 0.15)
#: Size at which most recipes give an error of about a tenth: start of the search.
_TENTH = 0.7
#: Largest number of sizes tried; factor by which the error may differ from the drawn one.
_TRIES, _NEAR = 4, 1.5
#: s, length of a commissioning record and start of its fitted part: seven records, and a fit within seconds.
_LENGTH, _FIT_FROM = 3.6, 0.3
_STARTS = 2


@dataclass(frozen=True)
class Commissioned:
    """A rig and its simulator: the size of its recipe, the remaining error, the identification records, and
    the channels of the tests for the error."""

    truth: Truth
    model: Model
    size: float
    misfit: float
    records: Mapping[str, Mapping[str, Array]]
    held_out: Mapping[str, Mapping[str, Array]]


def commission(
    rng: np.random.Generator,
    recipe: Recipe,
    plain: Truth,
    machine: Machine,
    noise: Mapping[str, Noise],
    held_out: Callable[[Truth], Mapping[str, Mapping[str, Array]]],
    left: Callable[[Model, Mapping[str, Mapping[str, Array]]], float],
) -> Commissioned:
    """A rig whose identified simulator has an error drawn from 3 to 6 or from 6 to 15 %.

    plain: the damper without the recipe. held_out: channels of a rig's tests that are not used in the fit.
    left: error of a simulator on them. Raises Faint if the error is out of reach.
    """
    low, high = (MISFIT[0], PARTED) if rng.random() < 0.5 else (PARTED, MISFIT[1])
    target = float(np.exp(rng.uniform(np.log(1.1 * low), np.log(0.95 * high))))
    tests = [_short(test) for test in excitation.damper_tests(rng, machine, long=False)]
    noises = [int(k) for k in rng.integers(2**32, size=len(tests))]
    best: Commissioned | None
    size, start, seed = _TENTH * target / 0.1, None, int(rng.integers(2**31))
    best, before = None, 0.0
    for attempt in range(_TRIES):
        truth = plain.having(recipe.numbers(size))
        records = _records(truth, tests, noise, noises)
        model = identified(recipe, records, start, seed, 1 if attempt else _STARTS)
        tested = held_out(truth)
        misfit = left(model, tested)
        found = Commissioned(truth, model, size, misfit, records, tested)
        if best is None or abs(np.log(misfit / target)) < abs(np.log(best.misfit / target)):
            best = found
        if target / _NEAR < misfit < target * _NEAR and low <= misfit <= high:
            break
        if before > high and misfit > 0.9 * before:  # the law alone leaves too much
            break
        before = misfit
        start = model.attributes
        size = float(np.clip(size * np.clip(target / misfit, 0.3, 3.0), 0.03, 2.5))
    if best is None or not low <= best.misfit <= high:
        raise Faint(f"the simulator leaves {best.misfit if best else np.nan:.3f}, out of {low} to {high}")
    return best


def identified(
    recipe: Recipe,
    records: Mapping[str, Mapping[str, Array]],
    start: Mapping[str, float] | None,
    seed: int,
    starts: int,
) -> Model:
    """The simulator by `mrdamp.identify`, on a part of each record."""
    train = [_as_record(name, channels).part(_FIT_FROM, _LENGTH) for name, channels in records.items()]
    fit = identify(
        recipe.law,
        train,
        extras=recipe.extras,
        dependence=recipe.dependence,
        start=start,
        starts=starts,
        seed=seed,
        threads=1,
    )
    return fit.model


def predicted(model: Model, channels: Mapping[str, Array]) -> dict[str, Array]:
    """Simulated channels, as `mrdamp predict` gives them for a record of these channels."""
    inputs = {name: channels[name] for name in INPUTS[model.rig][1:]}
    return free_run(model, _as_record("test", inputs))


def nominal(model: Model) -> dict[str, Any]:
    """The simulator in the form of `case.json`."""
    effects = [{"name": e.name, "place": e.place, "parameters": dict(e.parameters)} for e in model.effects]
    return {
        "law": model.law,
        "parameters": dict(model.parameters),
        **({"effects": effects} if effects else {}),
    }


def in_frame(model: Model, structure: Mapping[str, Any]) -> Model:
    """The damper's simulator in a frame. structure: in the form of `case.json`."""
    data = {"format": 1, "rig": "frame", "nominal": {**nominal(model), **structure}}
    return replace(Model.from_dict(data), sample_rate_hz=SAMPLE_RATE_HZ)


def _short(test: Excitation) -> Excitation:
    """The first part of a test."""
    kept = round(_LENGTH * excitation.GRID_HZ) + 1
    return replace(test, motion=test.motion[:kept], command=test.command[:kept])


def _records(
    truth: Truth, tests: Sequence[Excitation], noise: Mapping[str, Noise], seeds: Sequence[int]
) -> dict[str, dict[str, Array]]:
    out = {}
    for number, (test, seed) in enumerate(zip(tests, seeds, strict=True), 1):
        rng = np.random.default_rng(seed)
        clean = damper_channels(truth, test, test.rng)
        out[f"baseline_{number:02d}_{test.kind}.csv.gz"] = {
            name: noise[name].onto(values, rng) if name in noise else values for name, values in clean.items()
        }
    return out


def _as_record(name: str, channels: Mapping[str, Array]) -> Record:
    return Record(name, None, 1 / SAMPLE_RATE_HZ, channels)
