"""Fits along a number whose cost jumps: when an event counts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pytest

from mrdamp.diagnosis.fits.least_squares import Fit, fit
from mrdamp.diagnosis.hypotheses.terms import Coordinate, Hypothesis, Settings, Term
from mrdamp.diagnosis.problem.residuals import Problem
from mrdamp.model.core import Array
from toy_rig import ToyRig, toy

LEVEL, LOST = 0.4, 0.7
RUGGED = Coordinate("level", 0.1, 0.02, 1.0, 2.0, log=True, rugged=True)


@dataclass(frozen=True)
class Jumping(ToyRig):
    """The toy, whose force falls by a share where the displacement is above a level."""

    def simulate(self, settings: Sequence[Settings], record: int, *, coarse: bool = False) -> Array:
        x = np.asarray(self.records[record].displacement)
        above = np.array([[x > s.get("level", 2.0)] for s in settings])
        lost = np.array([s.get("lost", 0.0) for s in settings])[:, None, None]
        law = [{k: v for k, v in s.items() if k not in ("level", "lost")} for s in settings]
        return np.asarray(super().simulate(law, record) * (1 - lost * above))


def jumping() -> Jumping:
    plain = toy({}, noise=0.0)
    rig, noise = Jumping(plain.records), np.random.default_rng(2)
    made = []
    for k, record in enumerate(plain.records):
        force = rig.simulate([{"level": LEVEL, "lost": LOST}], k)[0, 0]
        channels = dict(record.channels) | {"force_N": force + 0.02 * noise.standard_normal(record.n)}
        made.append(replace(record, channels=channels))
    return Jumping(tuple(made))


def fitted(level: Coordinate, start: float) -> Fit:
    rig = jumping()
    term = Term("lost", "fluid", (Coordinate("lost", 0.0, 0.0, 1.0, 0.1), level), ((0.3, start),))
    hypothesis = Hypothesis(rig.nominal, (term,))
    return fit(Problem(rig), hypothesis, hypothesis.start(), most=15)


@pytest.mark.parametrize("start", [0.05, 0.15, 0.9])
def test_a_rugged_number_is_found_from_afar(start: float) -> None:
    found = fitted(RUGGED, start)
    assert found.settings["level"] == pytest.approx(LEVEL, rel=0.02)
    assert found.settings["lost"] == pytest.approx(LOST, rel=0.02)
    assert found.settings["gain"] == pytest.approx(2.0, rel=0.02)


def test_differences_over_a_small_step_would_not_find_it() -> None:
    assert fitted(replace(RUGGED, rugged=False), 0.15).cost > 3 * fitted(RUGGED, 0.15).cost
