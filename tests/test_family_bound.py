"""The bound of false alarms by noise: noise names no cause beside right or wrong parameters."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from modules import TOOLS, loaded
from mrdamp.diagnosis.case.folder import Case
from mrdamp.errors import InputError
from mrdamp.model import Model
from mrdamp.model.core import Array
from mrdamp.records import Record
from test_diagnosis_failures_and_interrupts import LAW, bingham


def case(changed: Mapping[str, float], late: int = 0) -> Case:
    """Two tests and a repeat of a damper. changed: parameters that differ from the simulator's; late: samples by which
    the command is late."""
    dt = 0.002
    t: Array = np.linspace(0, 699 * dt, 700)
    u: Array = np.where(t % 0.5 < 0.25, 0.2, 0.9)
    found = []
    for k, hz in enumerate((1.0, 2.2, 2.2)):
        x = 0.008 * np.sin(2 * np.pi * hz * t)
        noise = 3 * np.random.default_rng(k).standard_normal(len(t))
        force = bingham(x, np.roll(u, late), dt, **changed) + noise
        found.append(Record(f"{k}", None, dt, {"time_s": t, "displacement_m": x, "command": u, "force_N": force}))
    return Case("small", Path(), Model("bingham", LAW), tuple(found[:2]), ((found[2], 1),))


@pytest.fixture(scope="module")
def tool() -> ModuleType:
    return loaded(TOOLS / "family_bound.py")


@pytest.mark.parametrize(("changed", "verdict"), [({}, "none"), ({"fyb": 650.0}, "parameters")])
def test_noise_names_no_cause(tool: ModuleType, changed: dict[str, float], verdict: str) -> None:
    """Small errors of the parameters: a cause that explains nothing beyond them has their full penalty."""
    falls, answers, _ = tool.bound(case(changed), 20, 1)
    assert set(answers) == {verdict}
    assert 0 < falls.max() < 0.06


def test_a_case_with_a_cause_is_refused(tool: ModuleType) -> None:
    with pytest.raises(InputError, match="there is a cause"):
        tool.bound(case({}, late=20), 2, 1)
