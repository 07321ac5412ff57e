"""Loads of a comparison: which are independent, which were used before, and how long their runs last."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from env_arguments import OWN
from knowing import steady
from mrdamp.compare.bench import UNCONTROLLED, Bench
from mrdamp.compare.benches import bench_of
from mrdamp.compare.comparison import compare, distinct
from mrdamp.compare.contenders import Contender, contenders
from mrdamp.compare.dyke1996 import frame_model
from mrdamp.compare.frame import FrameBench
from mrdamp.compare.linear import GoalBench
from mrdamp.control.passive import Replay
from mrdamp.envs import RecordedMotions
from mrdamp.envs.linear import own_kind
from mrdamp.motions import GroundMotion
from refusals import refuses

Isolated: Any = own_kind(OWN)
ONE, TWO = (GroundMotion(f"sine_{w}", 5e-3, np.sin(w * 5e-3 * np.arange(401))) for w in (9.0, 14.0))
CONSTANT = Contender("constant", ("constant:value=1",))
TUNED = replace(CONSTANT, periods=1)


@pytest.fixture(scope="module")
def bench() -> Bench:
    return bench_of(OWN, engine="chain")


def test_a_load_that_comes_again_is_no_independent_one(bench: Bench) -> None:
    """Under another name, mirrored, or larger: means and intervals are those of the two loads that there are."""
    again = replace(ONE, name="other"), ONE.scaled(-0.3), TWO.scaled(7.0)
    two, five = (
        compare(bench, [CONSTANT], loads, [1.0]) for loads in ([ONE, TWO], [ONE, *again[:2], TWO, *again[2:]])
    )
    assert five.loads == ("sine_9.0", "sine_14.0")
    assert five.summary("constant", "shaking") == two.summary("constant", "shaking")
    assert two.notes == ()
    assert five.notes == ("3 of 5 loads repeat another up to a factor and are left out",)


def test_a_load_with_more_rest_at_an_end_is_another_one() -> None:
    """The largest drift of a resonator comes after a short pulse: a run that ends with the pulse does not have it."""
    pulse = GroundMotion("pulse", 5e-3, np.sin(np.pi * np.arange(9) / 8))
    rest = np.zeros(400)
    padded, later = (
        replace(pulse, name=name, acceleration=np.concatenate(parts))
        for name, parts in (("padded", [pulse.acceleration, rest]), ("later", [rest[:9], pulse.acceleration]))
    )
    frame = bench_of("frame", engine="chain", compression=1.0)
    assert isinstance(frame, FrameBench)
    found = compare(frame, [CONSTANT], [pulse, padded, later], [1.0])
    assert found.loads == ("pulse", "padded", "later")
    short, whole = (frame.history(UNCONTROLLED, load, 1.0).drift for load in (pulse, padded))
    assert np.abs(whole).max() > 1.2 * np.abs(short).max()


def test_of_two_records_a_source_makes_two_loads_and_says_that_tuning_had_them() -> None:
    class Recorded(Isolated):  # type: ignore[misc]
        def loads(self) -> Any:
            return RecordedMotions([ONE, TWO], amplitude=(0.5, 2.0), mirror=True)

    own = GoalBench(Recorded(), engine="chain")
    found = compare(own, [TUNED], own.unseen_loads(), [1.0])
    assert sorted(found.loads) == ["sine_14.0", "sine_9.0"]
    repeated, known = found.notes
    assert repeated == "4 of 6 loads repeat another up to a factor and are left out"
    assert known.startswith("controllers were tuned or policies chosen on sine_")
    assert len(compare(own, [CONSTANT], own.unseen_loads(), [1.0]).notes) == 1


@pytest.mark.parametrize("structure", ["frame", OWN])
def test_of_drawn_motions_none_is_known(structure: str) -> None:
    made = bench_of(structure, engine="chain")
    loads = list(made.unseen_loads())
    assert distinct(made, loads) == loads
    tuned, seen = ({made.likeness(load, rest=False) for load in some} for some in (made.tuning_loads(), loads))
    assert not tuned & seen


@pytest.mark.parametrize(
    "change",
    [
        {
            "places": {"base": (1, 0, 0, 0), "roof": (0, 0, 0, 1)},
            "goals": {k: replace(g, place="roof") for k, g in Isolated.goals.items()},
        },
        {"places": {"base": (0, 1, 0, 0), "top": (0, 0, 0, 1)}},
        {"rod": "top"},
        {"validation": lambda self: [ONE.compressed(2.0)]},
        {"validation": lambda self: [replace(ONE, acceleration=ONE.acceleration[:-1])]},
        {"validation": lambda self: [ONE.scaled(2.0)]},
    ],
)
def test_settings_belong_to_places_and_loads_of_their_structure(change: dict[str, Any]) -> None:
    def identity(**own: Any) -> str:
        kind = type("Isolated", (Isolated,), {"validation": lambda self: [ONE], **own})
        return GoalBench(kind()).identity()

    assert identity() == identity()
    assert identity(**change) != identity()


def test_a_command_has_the_unit_of_its_parameter_set(tmp_path: Path) -> None:
    """Three volts are an ampere: with another unit the coil's energy is nine times as large."""
    frame_model().write(tmp_path / "tower.json")
    replace(frame_model(), name="mine").write(tmp_path / "mine.json")
    units = [bench_of("frame", tmp_path / name).command_unit for name in ("tower.json", "mine.json")]
    assert units == [bench_of("frame").command_unit, "A"] == ["V", "A"]


class Own:
    name, duration, sample_time = "own", 0.99, 0.01

    def __init__(self, forces: Any) -> None:
        self.acceleration = forces

    def scaled(self, factor: float) -> Own:
        return Own(factor * self.acceleration)


class InPlace(Own):
    def scaled(self, factor: float) -> Own:
        self.acceleration *= factor
        return self


class Unscaled(Own):
    def scaled(self, factor: float) -> Own:
        return self


@pytest.mark.parametrize(
    ("kind", "message"),
    [(Own, ""), (InPlace, r"scaled\(2\) changes the load itself"), (Unscaled, r"scaled\(2\) has not twice the forces")],
)
def test_a_load_whose_scaled_is_none_is_refused_before_a_run(bench: Bench, kind: Any, message: str) -> None:
    load = kind(np.random.default_rng(0).standard_normal(100))
    if message:
        refuses(lambda: compare(bench, [CONSTANT], [load], [1.0]), f"own: {message}; allowed: a new load")
    else:
        assert compare(bench, [CONSTANT], [load], [1.0]).loads == ("own",)


def test_a_policy_given_twice_is_one_seed(tmp_path: Path, bench: Bench) -> None:
    """The same file, and a copy in another layout; another bias is another seed."""
    files = [tmp_path / f"{name}.json" for name in ("a", "b", "c")]
    for file, action in zip(files, (0.0, 0.0, 0.5), strict=True):
        steady(file, action)
    files[1].write_text(json.dumps(json.loads(files[1].read_text()), indent=3))
    rows = contenders(bench, [f"mine=policy:{','.join(str(files[k]) for k in (0, 0, 1, 2))}"], {})
    assert rows[0].specs == (f"policy:{files[0]}", f"policy:{files[2]}")
    found = compare(bench, rows, [ONE], [1.0])
    assert found.values["mine"]["shaking"].shape == (2, 1, 1)
    assert "2 of 4 policies of mine repeat another and are left out" in found.notes


def late(structure: str) -> Any:
    """A load that ends within a swing: the largest drifts come after it."""
    if structure == OWN:
        return GroundMotion("late", 5e-3, np.linspace(0.0, 1.0, 101) ** 4)
    load = bench_of(structure).unseen_loads()[0]
    return replace(load, force=load.force[:100]) if structure == "cable" else replace(load, height=load.height[:300])


@pytest.mark.parametrize("structure", ["cable", "car", OWN])
def test_a_constant_command_has_one_score_at_every_period(structure: str) -> None:
    """Of a controller of its own period, and of all controllers by `period`; the same seconds by the same engine."""
    load, found = late(structure), []
    for own, period in (*((t, 5e-3) for t in (5e-4, 1e-3, 2e-3, 5e-3, 2e-2)), (1e-3, 1e-3), (2e-2, 2e-2)):
        bench = bench_of(structure, engine="chain", period=period)
        kept = bench.driven(Replay([bench.command_max], own), load, 1.0)  # type: ignore[attr-defined]
        values = bench.values(kept, bench.run("uncontrolled", load, 1.0))
        found.append([values[m.key] for m in bench.measures if m.ratio])
    np.testing.assert_allclose(found, found[:1] * len(found), rtol=1e-5)
