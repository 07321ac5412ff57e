"""Nominal numbers that are further off than a search lets them go at first."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mrdamp.diagnosis.case.folder import Case
from mrdamp.diagnosis.run import diagnose
from mrdamp.model import Model
from mrdamp.records import Record

LAW = {"c0a": 4000.0, "c0b": 9000.0, "fya": 80.0, "fyb": 600.0, "v_ref": 0.03}
#: Hz, m, command of each test.
TESTS = ((0.7, 0.015, 0.0), (1.6, 0.008, 0.5), (2.7, 0.006, 1.0), (1.1, 0.012, 1.0))


def records() -> tuple[Record, ...]:
    """Sines, by NumPy, with noise of a per cent."""
    out, rng, dt = [], np.random.default_rng(3), 0.002
    t = dt * np.arange(2500)
    for k, (hz, amplitude, u) in enumerate(TESTS):
        w = 2 * np.pi * hz
        x, v = amplitude * np.sin(w * t), amplitude * w * np.cos(w * t)
        force = (LAW["c0a"] + LAW["c0b"] * u) * v + (LAW["fya"] + LAW["fyb"] * u) * np.tanh(v / LAW["v_ref"])
        force += 0.01 * np.sqrt(np.mean(force**2)) * rng.standard_normal(len(t))
        channels = {"displacement_m": x, "command": np.full(len(t), u), "force_N": force}
        out.append(Record(f"{k}", None, dt, channels))
    return tuple(out)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["fyb", "c0b"])
def test_a_number_may_be_further_off_than_its_range(name: str) -> None:
    """Where free numbers leave little else, those that stand at an end of their range go on."""
    nominal = Model("bingham", LAW | {name: 0.09 * LAW[name]})
    found = diagnose(Case("case", Path("case"), nominal, records(), ()))
    assert found.verdict == "parameters"
    assert found.corrected.parameters[name] == pytest.approx(LAW[name], rel=0.05)
