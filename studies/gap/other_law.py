"""A real damper whose law is not the simulator's, and its simulator, identified on bench records of that damper."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from mrdamp.errors import InputError
from mrdamp.model import Model
from studies.blindtest import commissioning, damper_case, excitation, misfit, recorder
from studies.blindtest.bench import Truth, damper_channels
from studies.blindtest.dampers import Device
from studies.blindtest.excitation import Machine
from studies.blindtest.rig import Array, Numbers
from studies.blindtest.sizing import Faint, Task, pooled, relative
from studies.gap.real import EFFECTS

#: Stroke (m) and speed (m/s) of the bench tests: what the damper of the nominal frame does in the tuning motions.
_STROKE, _SPEED = 3.5e-3, 0.16
#: Recipes tried until one's simulator has an error within the bench's limits.
_TRIES = 30


@dataclass(frozen=True)
class OtherLaw:
    """numbers: of the real damper (`rig.c`). nominal: the frame with the identified simulator of that damper. parts:
    what the real damper has in addition to its law. misfit: error of the simulator's force on bench tests outside the
    fit, relative to the RMS."""

    numbers: Numbers
    nominal: Model
    parts: tuple[str, ...]
    misfit: float


def other_law(frame: Model, seed: int) -> OtherLaw:
    """The damper of a frame with parts that no law of the simulator has, and its simulator with another law.

    The recipe is that of `studies.blindtest --misfit`, without parts that resemble an effect of a real frame: the same
    seed gives the same damper for all of them. Raises InputError if no recipe is within reach.
    """
    rng = np.random.default_rng([seed, 7])
    ends = {k: v for k, v in frame.parameters.items() if k.startswith("command_")}
    law = {k: v for k, v in frame.parameters.items() if k not in ends}
    machine = Machine(_STROKE, _SPEED, frame.attributes["command_max"])
    device = Device(frame.law, law, machine)
    inputs = excitation.damper_tests(rng, machine, long=False)
    tests = excitation.held_out_damper_tests(rng, machine, long=False)
    scale = damper_case.measure(device, inputs)
    noise = recorder.damper_noise(rng, scale.force, scale.command)
    task = Task("gap", "damper", "+".join(EFFECTS), misfit=True)
    for _ in range(_TRIES):
        recipe = replace(misfit.draw(rng, task, device, scale), extras=())
        try:
            made = commissioning.commission(
                rng, recipe, Truth(device.numbers), machine, noise, lambda truth: _channels(truth, tests), _error
            )
        except Faint:
            continue
        damper = replace(made.model, parameters={**made.model.parameters, **ends})
        nominal = replace(frame, law=damper.law, parameters=damper.parameters)
        return OtherLaw(made.truth.numbers, nominal, tuple(recipe.of), made.misfit)
    raise InputError(f"gap: no damper with another law for seed {seed}; try another seed")


def _channels(truth: Truth, tests: Mapping[str, excitation.Excitation]) -> dict[str, dict[str, Array]]:
    return {name: damper_channels(truth, test, test.rng) for name, test in tests.items()}


def _error(model: Model, tested: Mapping[str, Mapping[str, Array]]) -> float:
    said = [(commissioning.predicted(model, c)["force_N"], c["force_N"]) for c in tested.values()]
    return pooled([relative(simulated, measured) for simulated, measured in said])
