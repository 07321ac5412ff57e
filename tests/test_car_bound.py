"""The clairvoyant bound of a quarter car: the estimate of what is to come, the beam, the engine, the controllers."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import pytest

from mrdamp.compare import Comparison, Contender, compare
from mrdamp.compare.beam import Beam, search
from mrdamp.compare.bench import UNCONTROLLED
from mrdamp.compare.bound import with_bounds
from mrdamp.compare.car import CarBench
from mrdamp.compare.car_bound import ToCome, car_bound, weighted_car
from mrdamp.compare.shares import share
from mrdamp.envs.car_rows import PERIOD
from mrdamp.envs.car_task import Car
from mrdamp.envs.chain_rows import CarChain
from mrdamp.model import Model
from mrdamp.simulation.roads import iso8608
from mrdamp.simulation.rows import Stepping

BENCH = CarBench()
ROADS = iso8608("C", 17.0, 3.0, 71), iso8608("B", 26.0, 3.0, 72)
STARTS = (
    "passive-off",
    "constant:value=0.1",
    "clipped-lq:holding=0.3,r=1,level=0.2",
    "skyhook-switch:level=0.1",
)
DASHPOT = 1500.0  # N s/m


def linear_car(road: int) -> CarChain:
    """One car with a dashpot in the damper's place, whose tyre never lifts off on these roads."""
    damper = Model(
        "bingham", {"c0a": DASHPOT, "c0b": 0.0, "fya": 0.0, "fyb": 0.0, "v_ref": 1.0, "command_max": 1.0}
    )
    made = CarChain(Car(BENCH.car, damper), Stepping(5e-3, 1e-3, np.array([1.0]), 1))
    made.start(0, ROADS[road])
    return made


def states(rows: CarChain) -> np.ndarray:
    p = rows.plants
    return np.asarray(np.concatenate([p.coordinates(), p.velocities(), p.weighting()], axis=1)[0])


def test_the_linear_car_is_the_chains_with_a_dashpot() -> None:
    rows = linear_car(0)
    pushes = rows.pushes(ROADS[0])
    a, b, out = weighted_car(BENCH.car, DASHPOT, 1e-3)
    x, own, theirs = np.zeros(12), [], []
    for k in range(500):
        sums = np.zeros(2)
        for push in pushes[5 * k : 5 * k + 5]:
            sums += [(row @ x) ** 2 / 5 for row in (out["comfort"], out["load"])]
            x = a @ x + b * push
        own.append(sums)
        found = rows.plants.advance(np.zeros((1, 1)))[0][0]
        theirs.append([found[PERIOD.index(key)] for key in ("comfort", "load")])
        if k in (40, 300):
            assert np.abs(states(rows) - x).max() < 0.03 * np.abs(x).max()
            assert np.abs(states(rows)[4:] - x[4:]).max() < 0.03 * np.abs(x[4:]).max()
    mean = np.sqrt(np.mean(own, axis=0) / np.mean(theirs, axis=0))
    assert mean == pytest.approx([1.0, 1.0], abs=0.01)


class Rows:
    """Rows with these states alone."""

    def __init__(self, x: np.ndarray) -> None:
        self._x = x

    def coordinates(self) -> np.ndarray:
        return self._x[:, :2]

    def velocities(self) -> np.ndarray:
        return self._x[:, 2:4]

    def weighting(self) -> np.ndarray:
        return self._x[:, 4:]


def test_what_is_to_come_is_that_of_runs_of_the_linear_car() -> None:
    """Differences between states, from runs step by step to rest behind the road's end."""
    rng = np.random.default_rng(0)
    periods, inner, done, slopes = 200, 5, 63, {"comfort": 2.0, "load": 30.0}
    pushes = rng.standard_normal(periods * inner)
    x = rng.standard_normal((3, 12)) * ([0.01] * 2 + [0.1] * 2 + [0.1] * 8)
    found = ToCome(BENCH.car, pushes, inner, periods, slopes, 0.25)(Rows(x), done)  # type: ignore[arg-type]
    a, b, out = weighted_car(BENCH.car, 0.25 * BENCH.car.critical_damping, 1e-3)
    sums = np.zeros(3)
    for push in [*pushes[done * inner :], *np.zeros(20_000)]:
        sums += sum(s / inner * (x @ out[key]) ** 2 for key, s in slopes.items())
        x = x @ a.T + b * push
    np.testing.assert_allclose(np.diff(found), np.diff(sums), rtol=1e-6)


@pytest.fixture(scope="module")
def bounded() -> Comparison:
    result = compare(BENCH, [Contender(s, (s,)) for s in STARTS], ROADS, (1.0,))
    return with_bounds(BENCH, result, ROADS)


def rated(result: Comparison, name: str, weights: Mapping[str, float]) -> np.ndarray:
    """(1, roads, 1) what a bound makes small."""
    return np.asarray(sum(w * result.values[name][key] for key, w in weights.items()))


@pytest.mark.slow
def test_a_bound_is_not_worse_than_any_controller_in_any_case(bounded: Comparison) -> None:
    for bound, weights in BENCH.bounds.items():
        best = np.min([rated(bounded, name, weights) for name in STARTS], axis=0)
        assert (rated(bounded, bound, weights) <= best).all()
        assert rated(bounded, bound, weights).mean() < best.mean()
        for other in BENCH.bounds:
            assert rated(bounded, bound, weights).mean() <= rated(bounded, other, weights).mean()
        assert share(bounded, "passive-off", bound).mean == 0
        assert share(bounded, bound, bound).mean == 1


@pytest.mark.slow
def test_the_engine_agrees_with_the_chain_on_what_is_found(bounded: Comparison) -> None:
    for i, road in enumerate(ROADS):
        for bound, weights in BENCH.bounds.items():
            (path,) = bounded.paths[road.name, 1.0][bound]
            assert (np.diff(path["values"]) <= 0).all()
            assert path["values"][-1] == pytest.approx(rated(bounded, bound, weights)[0, i, 0], rel=0.02)


@pytest.mark.slow
def test_a_start_that_nothing_beats_stays_the_bound(monkeypatch: pytest.MonkeyPatch) -> None:
    """A beam of one that takes the largest command throughout."""
    monkeypatch.setattr(
        "mrdamp.compare.car_bound.search",
        lambda make, periods, levels, cost, to_come, beam: search(
            make, periods, levels[-1:], cost, to_come, Beam((1,))
        ),
    )
    start = "clipped-lq:holding=0.3,r=1,level=0.2"
    kept = car_bound(BENCH, dict.fromkeys(BENCH.bounds, (start,)), ROADS[0], 1.0)
    own = BENCH.values(BENCH.run(start, ROADS[0], 1.0), BENCH.run(UNCONTROLLED, ROADS[0], 1.0))
    assert kept["clairvoyant"]["values"] == own
    assert not math.isclose(kept["clairvoyant"]["paths"][0]["values"][-1], own["comfort"], rel_tol=0.02)
