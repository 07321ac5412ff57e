"""Plans with a part of the motion known: what they may look at, and what knowing more is worth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mrdamp.compare.clairvoyant import Effort
from mrdamp.compare.receding import Receding, until
from mrdamp.compare.rollouts import Rollouts, sensitivity
from mrdamp.motions import GroundMotion
from test_bound import LARGEST, PLAYED, objective, rollouts

QUICK = Effort(holds=(8,), horizon=150, most=1)
PERIOD = 1e-3


def planned(known: float, load: GroundMotion = PLAYED, periods: int = 240) -> np.ndarray:
    base = rollouts()
    own = Rollouts(base.make, load, base.columns, base.low, base.high, periods)
    plan = Receding(known, behind=0.1, effort=QUICK)
    return plan.commands(own, objective(0.5, 0.5), PERIOD)


def test_runs_go_on_where_a_row_stands() -> None:
    """From a saved present the rest of a run is that of the whole run."""
    rolled = rollouts()
    u = np.random.default_rng(0).uniform(0, LARGEST, rolled.periods)
    whole, _ = rolled.run(u[None])
    plant = rollouts().rows(1)
    for k in range(300):
        measured = plant.plants.advance(u[None, k : k + 1])[1][0].copy()
    moment = plant.plants.save(0)
    rest = rollouts()
    rest.rows(3)  # rows made before are moved too
    rest.go_on(moment, measured, 200)
    found, _ = rest.run(np.stack([u[300:500]] * 3))
    np.testing.assert_array_equal(found, np.stack([whole[0, 300:500]] * 3))


def test_what_is_not_known_yet_changes_no_command() -> None:
    """Another motion from 150 ms on: with 30 ms known the commands up to 120 ms are the same, and later ones differ."""
    values = PLAYED.acceleration.copy()
    after = PLAYED.time > 0.15 + 1e-9
    values[after] = -2.0 * values[after]
    other = replace(PLAYED, acceleration=values)
    for known in (0.0, 0.03):
        one, two = planned(known), planned(known, other)
        last = round((0.15 - known) / PERIOD)
        np.testing.assert_array_equal(one[: last - last % 8], two[: last - last % 8])
        assert np.abs(one - two).max() > 0.05 * LARGEST


def test_a_load_at_rest_behind_a_time() -> None:
    moment = rollouts().rows(1).plants.save(0)
    kept = moment.load.copy()
    cut = until(moment, 10.4 * moment.sample_time)
    np.testing.assert_array_equal(cut.load[:11], kept[:11])
    assert (cut.load[11:] == 0).all()
    np.testing.assert_array_equal(moment.load, kept)


def test_knowing_more_is_worth_more() -> None:
    rolled = rollouts()
    rolled.periods = 240
    values = {
        known: objective(0.5, 0.5).value(rolled.run(planned(known)[None])[0])[0] for known in (0.0, 0.05, 0.2)
    }
    on = objective(0.5, 0.5).value(rolled.run(np.full((1, 240), LARGEST))[0])[0]
    assert max(values[0.05], values[0.2]) < 0.9 * values[0.0] < 0.9 * on


@pytest.mark.parametrize("level", [0.0, LARGEST])
def test_slopes_under_a_constant_command_hold_the_driver(level: float) -> None:
    """Driver states that do not change in a run carry what a command does beyond its period."""
    rolled = rollouts()
    u = np.full(rolled.periods, level)
    y, states = rolled.run(u[None], states=True)
    period, channel, at = np.array([320, 330]), np.array([3, 4]), np.arange(330)
    g = sensitivity(rolled.slopes(y[0], states[0], u, at), at, period, channel, 330)
    step = 1e-4 if level == 0 else -1e-4
    for k in (300, 312, 318):
        nudged = np.stack([u, u])
        nudged[0, k] += step
        runs, _ = rolled.run(nudged)
        found = (runs[0] - runs[1])[period, channel] / step
        np.testing.assert_allclose(g[:, k], found, atol=5e-3 * np.abs(g).max())
        assert np.abs(found).max() > 1e-3 * np.abs(g).max()
