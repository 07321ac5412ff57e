"""A controller's clock in a delay: read off what a plain delay leaves, on forces written out."""

from __future__ import annotations

import numpy as np
import pytest

from mrdamp.diagnosis.fits.least_squares import Fit, fit
from mrdamp.diagnosis.fits.sampled_delay import sampled_delays, try_sampled_delay
from mrdamp.diagnosis.fits.search import Search
from mrdamp.diagnosis.hypotheses.terms import Hypothesis
from mrdamp.diagnosis.problem.damper import DamperRig
from mrdamp.diagnosis.problem.residuals import Problem
from mrdamp.model import Model
from mrdamp.model.core import Array
from mrdamp.records import Record

LAW = {"c0a": 700.0, "c0b": 800.0, "fya": 70.0, "fyb": 620.0, "v_ref": 0.03}
DT, NOISE = 2e-3, 3.0
TIME: Array = DT * np.arange(3000, dtype=np.float64)
DELAY, PERIOD, PHASE = 0.021, 0.0137, 0.4


def command(t: Array, k: int) -> Array:
    """Two tests' commands at times (n,); before a test its first."""
    t = np.maximum(t, 0.0)
    return np.asarray(0.5 + 0.25 * np.sin((9 + k) * t) + 0.2 * np.sin((23 - 4 * k) * t + k))


def search(period: float, stride: int) -> tuple[Search, Fit]:
    """Of records with a clock of that period (0: none), with the plain delay fitted to them."""
    rng, records = np.random.default_rng(5), []
    for k in (0, 1):
        x = 0.012 * np.sin((11 - 2 * k) * TIME) + 0.004 * np.sin(29 * TIME + k)
        v = 0.012 * (11 - 2 * k) * np.cos((11 - 2 * k) * TIME) + 0.004 * 29 * np.cos(29 * TIME + k)
        taken: Array = TIME - DELAY
        if period > 0:
            taken = np.asarray((np.floor(taken / period - PHASE) + PHASE) * period)
        u = command(taken, k)
        force = (LAW["c0a"] + LAW["c0b"] * u) * v + (LAW["fya"] + LAW["fyb"] * u) * np.tanh(v / LAW["v_ref"])
        read = force + NOISE * rng.standard_normal(len(force))
        channels = {"displacement_m": x, "velocity_m_s": v, "command": command(TIME, k), "force_N": read}
        records.append(Record(f"{k}", None, DT, channels))
    problem = Problem(DamperRig(Model("bingham", LAW), tuple(records)), stride=stride, coarse=True)
    made = Search(problem, sum((NOISE / b.size) ** 2 for b in problem.blocks))
    term = next(t for t in problem.rig.terms if t.name == "command_delay")
    plain = Hypothesis((), (term,))
    return made, fit(problem, plain, plain.start((1,)))


@pytest.mark.parametrize("stride", [1, 5])
def test_period_and_phase_are_read_off_what_a_plain_delay_leaves(stride: int) -> None:
    made, plain = search(PERIOD, stride)
    assert plain.settings["command_delay_d"] == pytest.approx(DELAY + PERIOD / 2, abs=1e-3)
    hypothesis, start = next(sampled_delays(made.problem, plain))
    first = hypothesis.settings(start)
    assert first["command_delay_period"] == pytest.approx(PERIOD, rel=1e-3)
    assert first["command_delay_phase"] % 1 == pytest.approx(PHASE, abs=0.15)
    try_sampled_delay(made, plain)
    found = made.best(False)
    assert found is not None
    assert found.hypothesis.name == "command_delay:on a clock"
    assert found.cost < 0.3 * plain.cost
    assert found.settings["command_delay_period"] == pytest.approx(PERIOD, rel=2e-4)
    assert found.settings["command_delay_d"] == pytest.approx(DELAY, abs=5e-4)
    assert found.settings["command_delay_phase"] % 1 == pytest.approx(PHASE, abs=0.05)


def test_a_plain_delay_gets_no_clock() -> None:
    made, plain = search(0.0, 1)
    try_sampled_delay(made, plain)
    assert [f.hypothesis.name for f in made.ranked(False)] == ["parameters"]
