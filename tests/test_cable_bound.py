"""The clairvoyant bound of a cable: the estimate of what is to come, the beam, the engine, the controllers."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import cont2discrete, dlsim

from mrdamp.compare import Comparison, Contender, compare
from mrdamp.compare.beam import Beam, search
from mrdamp.compare.bench import UNCONTROLLED
from mrdamp.compare.bound import with_bounds
from mrdamp.compare.cable import CableBench
from mrdamp.compare.cable_bound import ToCome, cable_bound
from mrdamp.compare.shares import share
from mrdamp.envs.cable_loads import AmbientLoads, CableLoad, WindLoads
from mrdamp.envs.cable_rows import CableChain
from mrdamp.envs.cable_task import Cable
from mrdamp.simulation.rows import ChainRows, Stepping

BENCH = CableBench()
STARTS = ("passive-on", "passive-off", "clipped-optimal", "lyapunov")


def drawn(source: AmbientLoads | WindLoads, seed: int) -> CableLoad:
    load = source.draw(np.random.default_rng(seed), BENCH.cable.length)
    return replace(load, name=f"{load.name}_{seed}")


LOADS = drawn(AmbientLoads(duration=4.0), 3), drawn(WindLoads(duration=4.0), 4)


class State:
    """A row of modes alone."""

    def __init__(self, q: np.ndarray, v: np.ndarray) -> None:
        self._q, self._v = q, v

    def coordinates(self) -> np.ndarray:
        return self._q

    def velocities(self) -> np.ndarray:
        return self._v


def test_what_is_to_come_is_that_of_runs_of_the_modes() -> None:
    """Differences between states, from SciPy's own runs of every mode under a load held over each period."""
    h, periods, done = 5e-3, 300, 37
    rng = np.random.default_rng(0)
    natural = BENCH.cable.natural
    forces = rng.standard_normal((periods + 1, len(natural)))  # straight between the ends of the periods
    to_come = ToCome(BENCH.cable, forces, h, h, periods)
    q, v = (rng.standard_normal((3, len(natural))) * size for size in (1.0, 20.0))
    found = to_come(State(q, v), done)  # type: ignore[arg-type]
    push = np.concatenate([(forces[done:-1] + forces[done + 1 :]) / 2, np.zeros((4000, len(natural)))])
    sums = np.zeros(3)
    for i, w in enumerate(natural):
        a = np.array([[0.0, 1.0], [-w * w, -2 * 0.05 * w]])
        system = cont2discrete((a, np.array([[0.0], [1.0]]), np.eye(2), np.zeros((2, 1))), h)
        for r in range(3):
            _, y, _ = dlsim(system, push[:, i : i + 1], x0=[q[r, i], v[r, i]])
            sums[r] += np.square(y[1:, 0]).sum()
    np.testing.assert_allclose(np.diff(found), np.diff(sums), rtol=1e-6)


def test_a_wide_beam_tries_every_command() -> None:
    """Of all sequences of six periods the best, by brute force."""
    load, rows = LOADS[0], _rows

    def cost(plants: ChainRows) -> np.ndarray:
        return np.asarray(np.square(plants.velocities()).sum(axis=1))

    def nothing(plants: ChainRows, period: int) -> np.ndarray:
        return np.zeros(plants.n)

    levels = np.array([0.0, BENCH.command_max])
    begin = rows(1, load)
    for _ in range(200):
        begin.advance(np.full((1, 1), 1.0))
    state = begin.state[0].copy()

    def make(n: int) -> ChainRows:
        made = rows(n, load)
        made.state[:] = state
        return made

    found = search(make, 6, levels, cost, nothing, Beam((1, 64)))
    every = make(64)
    total = np.zeros(64)
    for k in range(6):
        every.advance(levels[np.arange(64) >> k & 1][:, None])
        total += cost(every)
    assert found.cost == pytest.approx(total.min(), rel=1e-12)
    assert np.ptp(total) > 0
    np.testing.assert_array_equal(found.commands, levels[int(np.argmin(total)) >> np.arange(6) & 1])
    assert found.costs[1] <= found.costs[0]


def _rows(n: int, load: CableLoad) -> ChainRows:
    made = CableChain(Cable(BENCH.cable, BENCH.model), Stepping(5e-3, 1e-3, np.array([BENCH.command_max]), n))
    for row in range(n):
        made.start(row, load)
    plants: ChainRows = made.plants
    return plants


@pytest.fixture(scope="module")
def bounded() -> Comparison:
    result = compare(BENCH, [Contender(s, (s,)) for s in STARTS], LOADS, (1.0,))
    return with_bounds(BENCH, result, LOADS)


@pytest.mark.slow
def test_a_bound_is_not_worse_than_any_controller_in_any_case(bounded: Comparison) -> None:
    bound = bounded.values["clairvoyant"]["motion"]
    for name in STARTS:
        assert (bound <= bounded.values[name]["motion"]).all()
    assert (bound < 0.99 * np.min([bounded.values[name]["motion"] for name in STARTS], axis=0)).any()
    assert share(bounded, "passive-on", "clairvoyant").mean == 0
    assert share(bounded, "clairvoyant", "clairvoyant").mean == 1


@pytest.mark.slow
def test_the_engine_agrees_with_the_chain_on_what_is_found(bounded: Comparison) -> None:
    """The chain at 0.5 ms is within 1 % of steps of 50 us, the engine at 0.25 ms within 0.5 %."""
    for i, load in enumerate(LOADS):
        (path,) = bounded.paths[load.name, 1.0]["clairvoyant"]
        assert (np.diff(path["values"]) <= 0).all()
        assert path["values"][-1] == pytest.approx(bounded.values["clairvoyant"]["motion"][0, i, 0], rel=0.015)


@pytest.mark.slow
def test_a_start_that_nothing_beats_stays_the_bound(monkeypatch: pytest.MonkeyPatch) -> None:
    """A beam of one that takes passive-off throughout."""
    monkeypatch.setattr(
        "mrdamp.compare.cable_bound.search",
        lambda make, periods, levels, cost, to_come: search(
            make, periods, levels[:1], cost, to_come, Beam((1,))
        ),
    )
    kept = cable_bound(BENCH, {"clairvoyant": ("clipped-optimal",)}, LOADS[0], 1.0)
    own = BENCH.values(BENCH.run("clipped-optimal", LOADS[0], 1.0), BENCH.run(UNCONTROLLED, LOADS[0], 1.0))
    assert kept["clairvoyant"]["values"]["motion"] == own["motion"]
    assert not math.isclose(kept["clairvoyant"]["paths"][0]["values"][-1], own["motion"], rel_tol=0.02)
