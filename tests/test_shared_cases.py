"""The chain against forces that another program computed for the same equations (../shared/cases)."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mrdamp.model import Model, core
from mrdamp.model.core import Array

CASES = Path(__file__).parents[2] / "shared" / "cases"

pytestmark = pytest.mark.skipif(not CASES.is_dir(), reason="needs the folder ../shared/cases")


def names(rig: str) -> list[str]:
    folder = CASES / "open"
    cases = sorted(folder.iterdir()) if folder.is_dir() else []
    return [c.name for c in cases if json.loads((c / "case.json").read_text())["rig"] == rig]


def held_back(name: str) -> dict[str, dict[str, Array]]:
    arrays = np.load(CASES / "open_tests" / f"{name}.npz")
    out: dict[str, dict[str, Array]] = {}
    for key in arrays.files:
        test, channel = key.split("/")
        out.setdefault(test, {})[channel] = arrays[key]
    return out


def off(a: Array, b: Array) -> float:
    return float(np.sqrt(np.mean((a - b)[50:] ** 2) / np.mean(b[50:] ** 2)))


@pytest.mark.parametrize("name", names("damper"))
def test_nominal_damper_force(name: str) -> None:
    model = Model.read(CASES / "open" / name)
    for test, c in held_back(name).items():
        dt = float(c["time_s"][1] - c["time_s"][0])
        force = core.run(model.law, model.attributes, dt, c["displacement_m"], u=c["command"])["force"]
        assert off(force, c["nominal_N"]) < 0.01, test


@pytest.mark.parametrize("name", names("frame"))
def test_nominal_frame(name: str) -> None:
    read = Model.read(CASES / "open" / name)
    # the logged commands ring below zero by up to 2 %: there the case's own simulator follows the straight line
    model = replace(read, parameters={"command_min": -1.0, **read.parameters})
    for test, c in held_back(name).items():
        dt = float(c["time_s"][1] - c["time_s"][0])
        out = model.simulate(dt, c)
        for floor in (1, 2, 3):
            want = c[f"nominal_floor{floor}_acceleration"]
            assert off(out[f"floor{floor}_acceleration_m_s2"], want) < 0.03, (test, floor)
