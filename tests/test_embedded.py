"""The embedded records: what they look like, that the generator makes them, and that it is independent."""

from __future__ import annotations

import ast
import re
from dataclasses import replace
from importlib import resources
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from modules import TOOLS, loaded
from mrdamp.records import Record, embedded

Array = NDArray[np.float64]
TOOL = Path(__file__).resolve().parents[1] / "tools" / "make_embedded.py"
RECORDS = embedded()
@pytest.fixture(scope="module")
def generator() -> ModuleType:
    return loaded(TOOLS / "make_embedded.py")


def reference(record: Record) -> Array:
    return record.channel("reference_force_N")


def test_the_set() -> None:
    assert len(RECORDS.train) == 9
    assert len(RECORDS.validation) == 8
    names = [record.name for record in RECORDS]
    assert len(set(names)) == len(names)
    for record in RECORDS:
        assert record.path is None
        assert record.sample_time == pytest.approx(0.002)
        expected = ["time_s", "displacement_m", "command", "force_N", "reference_force_N"]
        assert list(record.channels) == expected
        assert np.abs(record.displacement).max() < 0.025  # the stroke
        assert record.command.min() >= 0.0
        assert record.command.max() <= 2.0
        assert np.abs(reference(record)).max() < 1800.0


def test_no_test_is_in_both_halves() -> None:
    for train in RECORDS.train:
        for other in RECORDS.validation:
            n = min(train.n, other.n)
            same = np.abs(train.displacement[:n] - other.displacement[:n]).max() < 5e-5
            assert not (same and np.abs(train.command[:n] - other.command[:n]).max() < 1e-3)


@pytest.mark.parametrize("record", RECORDS.records, ids=lambda record: record.name)
def test_energy_is_taken_out(record: Record) -> None:
    power = reference(record) * record.velocity(60.0)
    taken = np.cumsum(power) * record.sample_time
    assert taken[-1] > 5.0
    # stored and given back: the elastic element, F^2 / 2 k, the gas and the bristles, below 2 J in all
    assert (np.maximum.accumulate(taken) - taken).max() < 2.0


def test_the_two_force_channels_differ_by_their_noise(generator: ModuleType) -> None:
    seeds = [trial.seed for trial in generator.trials()]
    assert len(set(seeds)) == len(seeds)
    for record in RECORDS:
        assert record.force is not None
        difference = record.force - reference(record)
        assert abs(difference.mean()) < 1.0
        assert np.std(difference) == pytest.approx(np.hypot(7.0, 5.5), rel=0.1)
        correlation = np.corrcoef(difference[1:], difference[:-1])[0, 1]
        assert abs(correlation) < 0.1


def trial(generator: ModuleType, name: str) -> Any:
    return next(trial for trial in generator.trials() if trial.name == name)


@pytest.mark.parametrize("name", ["sine_2.5Hz_1.0mm_0.50A", "sine_5.0Hz_5.0mm_1.00A"])
def test_the_generator_makes_the_records(generator: ModuleType, name: str) -> None:
    made, kept = generator.record(trial(generator, name)), RECORDS[name]
    steps = {"displacement_m": 0.5e-6, "command": 1e-4, "force_N": 0.5, "reference_force_N": 0.25}
    for channel, step in steps.items():
        off = np.abs(made.channel(channel) - kept.channel(channel))
        # the last bit of an exponential may differ between machines: a value at the edge of a step may move
        assert off.max() < 1.01 * step
        assert np.mean(off > 1e-6 * np.abs(kept.channel(channel)).max()) < 0.005


@pytest.mark.parametrize("name", ["sine_5.0Hz_5.0mm_0.00A", "random_random_current_1"])
def test_another_integrator_gives_the_same_force(generator: ModuleType, name: str) -> None:
    """Classical Runge-Kutta at 50 kHz, over the first 0.3 s."""
    one = replace(trial(generator, name), duration=0.3)

    def rates(t: float, state: Array) -> Array:
        first, last = (one.command(t) - state[0]) / 4e-3, (state[0] - state[1]) / 1.5e-3
        return np.array([first, last, *generator.elements(*one.motion(t), state)[:2]])

    h = 2e-5
    state, force = np.array([one.command(0.0)] * 2 + [0.0, 0.0]), []
    state[2] = one.motion(0.0)[0]
    for k in range(15000):
        t = k * h
        if k % 100 == 0:
            force.append(generator.elements(*one.motion(t), state)[2])
        k1 = rates(t, state)
        k2 = rates(t + h / 2, state + h / 2 * k1)
        k3 = rates(t + h / 2, state + h / 2 * k2)
        k4 = rates(t + h, state + h * k3)
        state = state + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    _, displacement, _, found = generator.simulate(one)
    assert np.abs(found - force).max() < 2e-5 * np.abs(force).max()
    # the velocity that a motion gives is the derivative of its displacement
    v = np.array([one.motion(0.002 * k)[1] for k in range(150)])
    assert np.abs(np.gradient(displacement, 0.002) - v)[1:-1].max() < 0.02 * np.abs(v).max()


def test_the_generator_is_independent_of_the_plugin() -> None:
    allowed = {"mrdamp.motions": {"kanai_tajimi"}, "mrdamp.records": {"Record"}}
    libraries = {"__future__", "argparse", "math", "collections.abc", "dataclasses", "pathlib"}
    libraries |= {"numpy", "numpy.typing", "scipy.integrate"}
    tree = ast.parse(TOOL.read_text())
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            assert {alias.name for alias in node.names} <= libraries
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0
            assert node.module is not None
            names = {alias.name for alias in node.names}
            assert node.module in libraries or names <= allowed.get(node.module, set())
        elif isinstance(node, ast.Name):
            assert node.id not in ("__import__", "exec", "eval")
    assert not re.search("ctypes|importlib", TOOL.read_text())


PLAIN = [
    *("motions.motion", "motions.files", "errors", "files", "shown"),
    *(f"records.{name}" for name in ("record", "csv_file", "division", "motion", "sampling", "channels")),
]


@pytest.mark.parametrize("module", [*PLAIN, "motions.__init__", "records.__init__"])
def test_what_the_generator_uses_has_no_physics(module: str) -> None:
    text = (resources.files("mrdamp") / f"{module.replace('.', '/')}.py").read_text()
    used = set(re.findall(r"^\s*(?:from|import)\s+(mrdamp[.\w]*|ctypes|mujoco)", text, re.MULTILINE))
    names = ", ".join(re.findall(r"from mrdamp import (.*)", text))
    used |= {f"mrdamp.{name}" for name in names.split(", ") if name}
    assert used - {"mrdamp", "mrdamp.motions", "mrdamp.records"} <= {f"mrdamp.{name}" for name in PLAIN}
