"""The clairvoyant bound: slopes against differences of whole runs, the searches against brute force, shares by hand; of
a cable and a quarter car what is to come; and of every plant the engine and the controllers."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.signal import cont2discrete, dlsim

from mrdamp.compare import Comparison, Contender, FrameBench, compare
from mrdamp.compare import dyke1996 as preset
from mrdamp.compare.beam import search as search_beam
from mrdamp.compare.bench import UNCONTROLLED, Measure
from mrdamp.compare.benches import with_bounds
from mrdamp.compare.car import CarBench, car_to_come, weighted_car
from mrdamp.compare.clairvoyant import Peaks, search
from mrdamp.compare.comparison import ratio
from mrdamp.compare.linear import CableBench, cable_to_come
from mrdamp.compare.rollouts import Rollouts, sensitivity
from mrdamp.envs.cable import Cable
from mrdamp.envs.frame import Frame
from mrdamp.envs.frame_rows import FrameChain
from mrdamp.envs.linear_rows import CableChain
from mrdamp.envs.loads import AmbientLoads, CableLoad, WindLoads
from mrdamp.motions import kanai_tajimi
from mrdamp.simulation.roads import iso8608
from mrdamp.simulation.rows import ChainRows, Stepping
from refusals import refuses

BENCH = FrameBench(preset.frame_model())
MOTION = kanai_tajimi(5, duration=4.0, rise=0.5, plateau=2.0, decay=0.5)
PLAYED = BENCH.played(MOTION, 1.0)
LARGEST = BENCH.site.command_max


def rollouts(kind: type[Rollouts] = Rollouts) -> Rollouts:
    def make(n: int) -> FrameChain:
        return FrameChain(Frame(BENCH.model), Stepping(1e-3, 1e-3, np.array([LARGEST]), n))

    names = make(1).names
    columns = [names.index(f"{what}_{j}") for what in ("drift", "acceleration") for j in (1, 2, 3)]
    return kind(make, PLAYED, columns, 0.0, LARGEST)


def objective(drift: float, acceleration: float) -> Peaks:
    free = BENCH.history(UNCONTROLLED, MOTION, 1.0)
    scale = np.repeat([np.abs(free.drift).max(), np.abs(free.acceleration).max()], 3)
    return Peaks(np.array([drift, acceleration]), scale, np.repeat([0, 1], 3))


@pytest.mark.parametrize("level", [None, 0.0, LARGEST])
def test_slopes_are_those_of_whole_runs(level: float | None) -> None:
    """What the adjoint says of a command is what the chain does when that command is changed; under a constant one
    the driver's states carry it beyond its period."""
    rolled = rollouts()
    u = np.random.default_rng(0).uniform(0.2, 0.8, rolled.periods) * LARGEST
    if level is not None:
        u[:] = level
    _, states = rolled.run(u[None], states=True)
    period, channel = np.array([320, 330, 450, 450]), np.array([3, 4, 0, 2])
    at = np.arange(460)
    g = sensitivity(rolled.slopes(states[0], u, at), at, period, channel, 460)
    step = -1e-4 if level == LARGEST else 1e-4
    for k in (40, 250, 300, 312, 318, 440, 449):
        nudged = np.stack([u, u])
        nudged[0, k] += step
        runs, _ = rolled.run(nudged)
        found = (runs[0] - runs[1])[period, channel] / step
        assert (np.abs(g[:, k] - found) < 5e-3 * np.abs(g).max(axis=1)).all(), k
        assert (g[k >= period, k] == 0.0).all()


@pytest.mark.parametrize(("drift", "acceleration"), [(0.5, 0.5), (1.0, 0.0), (0.0, 1.0)])
def test_a_search_is_better_than_its_starts_and_than_brute_force(drift: float, acceleration: float) -> None:
    rolled, peaks = rollouts(), objective(drift, acceleration)
    begin = [("on", np.full(rolled.periods, LARGEST)), ("off", np.zeros(rolled.periods))]
    paths = search(rolled, begin, peaks)
    values = peaks.value(rolled.run(np.stack([p.commands for p in paths]))[0])
    assert [p.value for p in paths] == sorted(p.value for p in paths)
    for path, value in zip(paths, values, strict=True):
        assert path.value == pytest.approx(value, rel=1e-12)  # of its own commands
        assert path.value < path.values[0]
        assert (np.diff(path.values) <= 0).all()
        assert ((path.commands >= 0) & (path.commands <= LARGEST)).all()
        assert path.ended
    rng = np.random.default_rng(1)
    levels = rng.integers(0, 3, (400, 16)) / 2 * LARGEST  # sixteen levels of 50 ms
    guessed = np.repeat(levels, -(-rolled.periods // 16), axis=1)[:, : rolled.periods]
    best = min(float(peaks.value(rolled.run(part)[0]).min()) for part in np.split(guessed, 4))
    assert paths[0].value < best


def made(on: Any, other: Any, bound: Any) -> Comparison:
    rows = {"on": on, "other": other, "best": bound}
    values = {name: {"J": np.asarray(v, dtype=np.float64)[None, :, None]} for name, v in rows.items()}
    contenders = (
        Contender("on", ("passive-on",)),
        Contender("other", ("x",)),
        Contender("best", ("best",), bound=True),
    )
    loads = tuple(f"load {k}" for k in range(len(on)))
    return Comparison(contenders, (Measure("J", "J"),), loads, (1.0,), values, {"best": {"J": 1.0}})


def test_a_share_counts_what_is_gained() -> None:
    result = made([0.6, 0.4], [0.5, 0.4], [0.4, 0.2])
    s = result.share("other", "best")
    assert s.mean == pytest.approx(0.25)
    assert result.load_shares("other", "best") == pytest.approx([0.5, 0.0])
    assert s.worst == pytest.approx(0.0)
    assert s.low <= 0.25 <= s.high
    assert s.low == pytest.approx(0.0)  # both draws of the second load
    assert s.high == pytest.approx(0.5)
    worse = made([0.6, 0.4], [0.7, 0.5], [0.4, 0.2])
    assert worse.share("other", "best").mean == pytest.approx(-0.5)
    nothing_left = made([0.6, 0.4], [0.5, 0.4], [0.6, 0.2])
    assert math.isnan(nothing_left.load_shares("other", "best")[0])
    assert math.isnan(made([0.6], [0.5], [0.6]).share("other", "best").mean)


def test_an_interval_of_a_ratio_is_that_of_the_delta_method() -> None:
    rng = np.random.default_rng(4)
    below = rng.normal(1.0, 0.1, 300)
    above = 0.4 * below + rng.normal(0.0, 0.05, 300)
    mean, low, high = ratio(above[None, :, None], below[None, :, None])
    assert mean == pytest.approx(above.mean() / below.mean())
    half = 1.96 * np.std(above - mean * below) / math.sqrt(300) / below.mean()
    assert (high - low) / 2 == pytest.approx(half, rel=0.1)
    refuses(lambda: ratio(np.ones((1, 2, 1)), np.ones((2, 2, 1))), "no ratio")


CABLE, CAR = CableBench(), CarBench()


def drawn(source: AmbientLoads | WindLoads, seed: int) -> CableLoad:
    load = source.draw(np.random.default_rng(seed), CABLE.cable.length)
    return replace(load, name=f"{load.name}_{seed}")


ON_CABLE = (drawn(AmbientLoads(duration=4.0), 3), drawn(WindLoads(duration=4.0), 4))
ON_CAR = (iso8608("C", 17.0, 3.0, 71), iso8608("B", 26.0, 3.0, 72))
IN_FRAME = tuple(kanai_tajimi(seed, duration=4.0, rise=0.5, plateau=2.0, decay=0.5) for seed in (5, 6))


class Rows:
    def __init__(self, q: np.ndarray, v: np.ndarray, weighting: np.ndarray | None = None) -> None:
        self._q, self._v, self._weighting = q, v, weighting

    def coordinates(self) -> np.ndarray:
        return self._q

    def velocities(self) -> np.ndarray:
        return self._v

    def weighting(self) -> np.ndarray | None:
        return self._weighting


def test_what_is_to_come_of_a_cable_is_that_of_runs_of_the_modes() -> None:
    """Differences between states, from SciPy's own runs of every mode under a load held over each period."""
    h, periods, done = 5e-3, 300, 37
    rng = np.random.default_rng(0)
    natural = CABLE.cable.natural
    forces = rng.standard_normal((periods + 1, len(natural)))  # straight between the ends of the periods
    to_come = cable_to_come(CABLE.cable, forces, h, h, periods)
    q, v = (rng.standard_normal((3, len(natural))) * size for size in (1.0, 20.0))
    found = to_come(Rows(q, v), done)  # type: ignore[arg-type]
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
    load, rows = ON_CABLE[0], _rows

    def cost(plants: ChainRows) -> np.ndarray:
        return np.asarray(np.square(plants.velocities()).sum(axis=1))

    def nothing(plants: ChainRows, period: int) -> np.ndarray:
        return np.zeros(plants.n)

    levels = np.array([0.0, CABLE.command_max])
    begin = rows(1, load)
    for _ in range(200):
        begin.advance(np.full((1, 1), 1.0))
    state = begin.state[0].copy()

    def make(n: int) -> ChainRows:
        made = rows(n, load)
        made.state[:] = state
        return made

    found = search_beam(make, 6, levels, cost, nothing, (1, 64))
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
    made = CableChain(Cable(CABLE.cable, CABLE.model), Stepping(5e-3, 1e-3, np.array([CABLE.command_max]), n))
    for row in range(n):
        made.start(row, load)
    plants: ChainRows = made.plants
    return plants


def test_what_is_to_come_of_a_car_is_that_of_runs_of_a_linear_one() -> None:
    """Differences between states, from runs step by step to rest behind the road's end."""
    rng = np.random.default_rng(0)
    periods, inner, done, slopes = 200, 5, 63, {"comfort": 2.0, "load_ratio": 30.0}
    pushes = rng.standard_normal(periods * inner)
    x = rng.standard_normal((3, 12)) * ([0.01] * 2 + [0.1] * 2 + [0.1] * 8)
    rows = Rows(x[:, :2], x[:, 2:4], x[:, 4:])
    found = car_to_come(CAR.car, pushes, inner, periods, slopes, 0.25)(rows, done)  # type: ignore[arg-type]
    a, b, out = weighted_car(CAR.car, 0.25 * CAR.car.critical_damping, 1e-3)
    sums = np.zeros(3)
    for push in [*pushes[done * inner :], *np.zeros(20_000)]:
        sums += sum(s / inner * (x @ out[key]) ** 2 for key, s in slopes.items())
        x = x @ a.T + b * push
    np.testing.assert_allclose(np.diff(found), np.diff(sums), rtol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("bench", "loads", "names"),
    [
        (CABLE, ON_CABLE, ("passive-on", "clipped-optimal", "passive-off", "lyapunov")),
        (CAR, ON_CAR, ("passive-off", "clipped-lq:holding=0.3,r=1,level=0.2", "constant:value=0.1",
                       "skyhook-switch:level=0.1")),
        (BENCH, IN_FRAME, ("passive-on", "force-tracking", "clipped-optimal:balance=300,r=1e-6", "passive-off")),
    ],
    ids=["cable", "car", "frame"],
)  # fmt: skip
def test_a_bound_is_not_worse_than_any_controller_in_any_case_and_the_engine_agrees(
    bench: Any, loads: tuple[Any, ...], names: tuple[str, ...]
) -> None:
    """The chain at 0.5 ms is within 1 % of steps of 50 us, the engine at 0.25 ms within 0.5 %."""
    result = with_bounds(bench, compare(bench, [Contender(s, (s,)) for s in names], loads, (1.0,)), loads)

    def rated(name: str, bound: str) -> np.ndarray:
        """(1, loads, 1) what a bound makes small."""
        return np.asarray(sum(w * result.values[name][key] for key, w in bench.bounds[bound].items()))

    for bound in bench.bounds:
        found, best = rated(bound, bound), np.min([rated(name, bound) for name in names], axis=0)
        assert (found <= best).all()
        assert found.mean() < 0.995 * best.mean()
        assert all(found.mean() <= rated(other, bound).mean() for other in bench.bounds)
        assert (result.share(names[0], bound).mean, result.share(bound, bound).mean) == (0, 1)
        for i, load in enumerate(loads):
            paths = result.paths[load.name, 1.0][bound]
            assert all((np.diff(path["values"]) <= 0).all() for path in paths)
            assert min(path["values"][-1] for path in paths) == pytest.approx(found[0, i, 0], rel=0.02)
