"""Tuning on rows of the chain: against runs in MuJoCo, a brute-force search, and a function with a known least."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from mrdamp.compare import tuning
from mrdamp.compare.bench import UNCONTROLLED, Ranges, score
from mrdamp.compare.cable import CableBench
from mrdamp.compare.car import CarBench
from mrdamp.compare.contenders import shipped_policies
from mrdamp.compare.dyke1996 import frame_model
from mrdamp.compare.frame import FrameBench
from mrdamp.control.base import Controller
from mrdamp.envs.loads import CableLoad
from mrdamp.errors import InputError
from mrdamp.model import Effect
from mrdamp.motions import TIME_SCALE, GroundMotion, kanai_tajimi
from refusals import refuses

BENCH = FrameBench(frame_model())
MOTIONS = [kanai_tajimi(seed, duration=5.0).compressed(TIME_SCALE) for seed in (1, 2)]
KINDS = [
    "constant:value=0.8", "clipped-optimal:weak=60", "modulated-optimal", "force-tracking", "lyapunov:level=0.7",
    "max-dissipation", "skyhook",
]  # fmt: skip


def in_mujoco(spec: str, loads: list[GroundMotion], of: FrameBench = BENCH) -> float:
    """The mean objective of runs one by one, in the engine."""
    bench = replace(of, compression=1.0)
    without = [bench.run(UNCONTROLLED, load, 1.0) for load in loads]
    rows = [bench.values(bench.run(spec, m, 1.0), free) for m, free in zip(loads, without, strict=True)]
    return float(np.mean([score(bench, row) for row in rows]))


def test_rows_at_once_are_the_runs_one_by_one_in_the_engine() -> None:
    loops = tuning.Loops(BENCH, MOTIONS, len(KINDS))
    found = loops.scores([BENCH.controller(spec) for spec in KINDS])
    for spec, value in zip(KINDS, found, strict=True):
        assert value == pytest.approx(in_mujoco(spec, MOTIONS), rel=0.02), spec
    assert loops.periods == len(KINDS) * 2 * 1001  # a second each, at 1 ms


def test_a_known_lag_of_the_force_sensor_is_taken_back_in_rows_too() -> None:
    model, spec = BENCH.model, "clipped-optimal:balance=100,r=1e-8,noise_ratio=2000"
    lagged = replace(BENCH, model=replace(model, effects=(*model.effects, Effect("sensor_lag", {"tau": 3e-3}))))
    untold = replace(lagged, told=model)
    found = [tuning.Loops(bench, MOTIONS, 1).scores([bench.controller(spec)])[0] for bench in (lagged, untold)]
    # A force that is remembered in an array which the rows write over is never taken back.
    assert found[0] != pytest.approx(found[1], rel=1e-3)
    for bench, value in zip((lagged, untold), found, strict=True):
        assert value == pytest.approx(in_mujoco(spec, MOTIONS, bench), rel=0.015)


@pytest.mark.slow
def test_the_best_constant_is_that_of_a_scan(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(FrameBench, "tuning_loads", lambda bench: tuple(MOTIONS))
    monkeypatch.setattr(FrameBench, "effort", lambda bench, kind: (1, 200_000))
    found = tuning.tune(BENCH, ["best-constant"])["best-constant"]
    scan = {volts: in_mujoco(f"constant:value={volts:.6g}", MOTIONS) for volts in np.linspace(0.0, 2.25, 31)}
    assert in_mujoco(found.spec, MOTIONS) <= min(scan.values()) * 1.005
    assert found.periods == found.curve[-1][0] + 5 * 2 * 1001  # of the search, and of its last choice


class Valley:
    """Loops whose score is a bowl about balance 100 and r 1e-8: the search's own optimum is known."""

    periods = 0

    def __init__(self, *_: object) -> None:
        pass

    def scores(self, controllers: list[Controller]) -> list[float]:
        self.periods += len(controllers)
        found: list[NDArray[np.float64]] = [np.log10([c.o["balance"] / 100.0, c.o["r"] / 1e-8]) for c in controllers]  # type: ignore[attr-defined]
        return [1.0 + float(x @ x) for x in found]


def test_the_search_finds_a_known_least_and_leaves_out_what_cannot_be_made(monkeypatch: pytest.MonkeyPatch) -> None:
    ranges: Ranges = {"balance": (1.0, 1e4), "r": (1e-12, 1e-4), "level": (0.0, 1.0)}

    class Made:
        def __init__(self, spec: str) -> None:
            self.o = {k: float(v) for k, _, v in (part.partition("=") for part in spec.partition(":")[2].split(","))}
            if self.o["level"] > 0.8:
                raise InputError("no stable regulator")

    monkeypatch.setattr(tuning, "Loops", Valley)
    monkeypatch.setattr(FrameBench, "ranges", lambda bench, kind: ranges)
    monkeypatch.setattr(FrameBench, "effort", lambda bench, kind: (4, 2_000))
    monkeypatch.setattr(FrameBench, "controller", lambda bench, spec: Made(spec))
    found = tuning.Search(BENCH, "clipped-optimal").run()
    assert found.score == pytest.approx(1.0, abs=0.01)
    options = Made(found.spec).o
    assert options["balance"] == pytest.approx(100.0, rel=0.3)
    assert options["r"] == pytest.approx(1e-8, rel=0.3)
    assert found.curve[-1][0] <= 2_000 + 12
    monkeypatch.setattr(FrameBench, "ranges", lambda bench, kind: {**ranges, "level": (0.9, 1.0)})
    refuses(lambda: tuning.Search(BENCH, "clipped-optimal").run(), "no setting of clipped-optimal")


@pytest.mark.parametrize("bench", [CableBench(), CarBench()], ids=["cable", "car"])
def test_every_kind_of_other_plants_runs_as_rows(bench: CableBench | CarBench) -> None:
    """Rows of the same load agree with one another, and with a single one of them."""
    long = bench.tuning_loads()[0]
    part = {"force": long.force[:60]} if isinstance(long, CableLoad) else {"height": long.height[:200]}
    load = replace(long, **part)
    for kind in set(bench.tuned.values()):
        (one,) = tuning.Loops(bench, [load], 1).scores([bench.controller(kind)])
        two = tuning.Loops(bench, [load, load], 1).scores([bench.controller(kind)])
        assert two == pytest.approx([one], rel=1e-9), kind


@pytest.mark.parametrize("name", ["learned", "adjoint", "ppo"])
def test_rows_of_a_policy_are_its_runs_one_by_one_in_the_engine(name: str) -> None:
    spec = f"policy:{shipped_policies('frame')[name][0]}"
    (found,) = tuning.Loops(BENCH, MOTIONS, 1).scores([BENCH.controller(spec)])
    assert found == pytest.approx(in_mujoco(spec, MOTIONS), rel=0.02)


def test_only_what_is_compared_is_tuned_and_the_file_keeps_the_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tuned: list[str] = []

    def run(search: tuning.Search) -> tuning.Setting:
        tuned.append(search.kind)
        return tuning.Setting(f"{search.kind}:value=1", 0.5)

    monkeypatch.setattr(tuning.Search, "run", run)
    file = tmp_path / "tuned.json"
    one = tuning.settings_for(BENCH, ["passive-on", "mine=best-constant"], anew=True, file=file)
    assert (list(one), tuned) == (["best-constant"], ["constant"])
    both = tuning.settings_for(BENCH, ["skyhook-tuned"], anew=True, file=file)
    assert tuned == ["constant", "skyhook"]
    assert sorted(both) == ["best-constant", "skyhook-tuned"]
    assert sorted(tuning.read_settings(file, BENCH) or {}) == sorted(both)
