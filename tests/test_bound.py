"""The clairvoyant bound: slopes against differences of whole runs, the search against brute force, shares by hand."""

from __future__ import annotations

import csv
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from command_call import caller
from mrdamp.commands.controllers import add_to
from mrdamp.compare import Comparison, Contender, FrameBench, compare
from mrdamp.compare import dyke1996 as preset
from mrdamp.compare.bench import UNCONTROLLED, Measure
from mrdamp.compare.benches import with_bounds
from mrdamp.compare.clairvoyant import Peaks, search
from mrdamp.compare.comparison import ratio
from mrdamp.compare.frame import run_rows
from mrdamp.compare.rollouts import Rollouts, sensitivity
from mrdamp.control.passive import Replay
from mrdamp.envs.frame import Frame
from mrdamp.envs.frame_rows import FrameChain
from mrdamp.errors import InputError
from mrdamp.motions import kanai_tajimi
from mrdamp.simulation.rows import Stepping
from mrdamp.simulation.stepping import run_frame
from studies.receding import Ongoing

BENCH = FrameBench(preset.frame_model())
MOTION = kanai_tajimi(5, duration=4.0, rise=0.5, plateau=2.0, decay=0.5)
PLAYED = BENCH.played(MOTION, 1.0)
LARGEST = BENCH.site.command_max
STARTS = ("passive-on", "force-tracking", "clipped-optimal:balance=300,r=1e-6")

run = caller(add_to)


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


@pytest.mark.slow
def test_the_engine_agrees_with_the_chain_on_what_is_found() -> None:
    """In MuJoCo what was made small is within 1 % of what the search says, all peaks of a chain of the same step."""
    rolled = rollouts()
    for weights in ((1.0, 0.0), (0.0, 1.0), (0.5, 0.5)):
        peaks = objective(*weights)
        path = search(rolled, [("on", np.full(rolled.periods, LARGEST))], peaks)[0]
        replay = Replay(path.commands, 1e-3)
        engine = run_frame(BENCH.model, PLAYED, replay, timestep=2.5e-4)
        found = peaks.value(np.hstack([engine.drift, engine.acceleration])[None])
        assert found[0] == pytest.approx(path.value, rel=0.01), weights
        chain = run_rows(BENCH.model, PLAYED, replay, timestep=2.5e-4)
        for what in ("drift", "acceleration"):
            a, b = (np.abs(getattr(r, what)).max() for r in (engine, chain))
            assert a == pytest.approx(b, rel=0.01), (weights, what)
        np.testing.assert_allclose(engine.command[: len(path.commands)], path.commands)


@pytest.fixture(scope="module")
def bounded() -> Comparison:
    motions = MOTION, kanai_tajimi(6, duration=4.0, rise=0.5, plateau=2.0, decay=0.5)
    rows = [Contender(f"c{k}", (spec,)) for k, spec in enumerate(STARTS)]
    result = compare(BENCH, rows, motions, (1.0, 0.5))
    return with_bounds(BENCH, result, motions, starts=2)


@pytest.mark.slow
def test_a_bound_is_not_worse_than_any_controller_in_any_case(bounded: Comparison) -> None:
    for bound, weights in BENCH.bounds.items():
        score = {
            c.name: np.stack([w * bounded.values[c.name][key] for key, w in weights.items()]).sum(axis=0)
            for c in bounded.contenders
        }
        for k in range(len(STARTS)):
            assert (score[bound] <= score[f"c{k}"]).all()
            assert (score[bound] < score[f"c{k}"] - 1e-3).any()
    for paths in bounded.paths.values():
        assert {path["start"] for path in paths["clairvoyant"]} >= {"passive-off"}
        assert all(path["values"][-1] <= path["values"][0] for found in paths.values() for path in found)


@pytest.mark.slow
def test_shares_are_none_for_passive_on_and_whole_for_the_bound(bounded: Comparison) -> None:
    for bound in BENCH.bounds:
        assert bounded.share("c0", bound).mean == 0
        assert bounded.share(bound, bound).mean == 1
        assert bounded.load_shares(bound, bound) == pytest.approx([1.0, 1.0])
        assert bounded.share("c1", bound).mean < 1


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
    with pytest.raises(InputError, match="no ratio"):
        ratio(np.ones((1, 2, 1)), np.ones((2, 2, 1)))


@pytest.mark.slow
def test_the_command_writes_shares_and_paths(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "motion.csv"
    rows = "".join(
        f"{float(t)!r},{float(a)!r}\n" for t, a in zip(MOTION.time, MOTION.acceleration, strict=True)
    )
    file.write_text(f"time_s,acceleration_m_s2\n{rows}")
    given = ["frame", "--motions", file, "--controllers", "passive-on", "passive-off", "--bound", "--jobs", 1]
    assert run("compare", *given, "-o", tmp_path / "out") == 0
    text = capsys.readouterr().out
    assert "way to clairvoyant-drift" in text
    assert "local optimum" in text
    page = (tmp_path / "out" / "index.html").read_text(encoding="utf-8")
    assert "Way to the clairvoyant command" in page
    shares, steps = (
        list(csv.DictReader((tmp_path / "out" / name).read_text(encoding="utf-8").splitlines()))
        for name in ("shares.csv", "paths.csv")
    )
    on = [row for row in shares if row["controller"] == "passive-on"]
    assert on
    assert all(float(row["share"]) == 0 for row in on)
    assert {row["bound"] for row in steps} == set(BENCH.bounds)
    assert all((tmp_path / "out" / name).stat().st_size > 5000 for name in ("shares.png", "paths.png"))
    kept = (tmp_path / "out" / "kept.jsonl").read_text()
    assert run("compare", *given, "-o", tmp_path / "out") == 0  # nothing is searched for again
    assert (tmp_path / "out" / "kept.jsonl").read_text() == kept


def test_runs_go_on_where_a_row_stands() -> None:
    """From a saved present the rest of a run is that of the whole run."""
    rolled = rollouts()
    u = np.random.default_rng(0).uniform(0, LARGEST, rolled.periods)
    whole, _ = rolled.run(u[None])
    plant = rollouts().rows(1)
    for k in range(300):
        measured = plant.plants.advance(u[None, k : k + 1])[1][0].copy()
    moment = plant.plants.save(0)
    rest = rollouts(Ongoing)
    assert isinstance(rest, Ongoing)
    rest.rows(3)  # rows made before are moved too
    rest.go_on(moment, measured, 200)
    found, _ = rest.run(np.stack([u[300:500]] * 3))
    np.testing.assert_array_equal(found, np.stack([whole[0, 300:500]] * 3))
