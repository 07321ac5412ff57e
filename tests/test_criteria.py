"""Criteria on arrays whose values are known by hand; means and intervals of a comparison, and its loads."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from command_call import caller
from env_arguments import OWN
from knowing import steady
from mrdamp.commands.controllers import add_to
from mrdamp.compare.bench import UNCONTROLLED, Bench
from mrdamp.compare.benches import bench_of, scaled
from mrdamp.compare.comparison import compare, difference, distinct, interval, summarise
from mrdamp.compare.contenders import Contender, contenders
from mrdamp.compare.dyke1996 import frame_model
from mrdamp.compare.frame import FrameBench
from mrdamp.compare.linear import GoalBench
from mrdamp.control.passive import Replay
from mrdamp.envs import RecordedMotions
from mrdamp.envs.linear import own_kind
from mrdamp.motions import GroundMotion, kanai_tajimi
from mrdamp.simulation.criteria import Criteria, evaluate
from mrdamp.structures import ShearFrame, dyke1996
from refusals import refuses

FRAME = ShearFrame(np.array([10.0, 20.0]), np.array([1e4, 1e4]), np.array([1.0, 1.0]))
TIME = np.linspace(0.0, 2.0, 2001)


def sine_run(scale: float = 1.0, **others: Any) -> Criteria:
    wave = scale * np.sin(2 * np.pi * TIME)
    drift = np.column_stack([0.01 * wave, -0.03 * wave])
    acceleration = np.column_stack([2.0 * wave, -3.0 * wave])
    return evaluate(FRAME, TIME, drift, acceleration, **others)


def test_peaks_and_norms_of_a_sine() -> None:
    c = sine_run(force=500 * np.cos(2 * np.pi * TIME))
    np.testing.assert_allclose(c.peak_drift, [0.01, 0.03], rtol=1e-6)
    np.testing.assert_allclose(c.rms_drift, np.array([0.01, 0.03]) / np.sqrt(2), rtol=1e-6)
    np.testing.assert_allclose(c.peak_displacement, [0.01, 0.02], rtol=1e-6)
    np.testing.assert_allclose(c.peak_acceleration, [2.0, 3.0], rtol=1e-6)
    np.testing.assert_allclose(c.rms_acceleration, np.array([2.0, 3.0]) / np.sqrt(2), rtol=1e-6)
    # 10 kg x 2 m/s2 - 20 kg x 3 m/s2
    assert c.peak_base_shear == pytest.approx(40.0, rel=1e-6)
    assert c.rms_base_shear == pytest.approx(40.0 / np.sqrt(2), rel=1e-6)
    assert c.peak_force == 500
    assert c.rms_force == pytest.approx(500 / np.sqrt(2), rel=1e-3)
    assert c.peak_stroke == pytest.approx(0.01, rel=1e-6)
    assert c.duration == 2.0
    assert c.weight == pytest.approx(30 * 9.80665)


def test_dissipated_energy() -> None:
    # A dashpot c under x = X sin(w t) takes pi c w X^2 a cycle; a spring takes nothing.
    w, amplitude = 2 * np.pi, 0.01
    x, v = amplitude * np.sin(w * TIME), amplitude * w * np.cos(w * TIME)
    dashpot = sine_run(force=300 * v, stroke=x)
    assert dashpot.dissipated_energy == pytest.approx(2 * np.pi * 300 * w * amplitude**2, rel=1e-5)
    assert sine_run(force=300 * x, stroke=x).dissipated_energy == pytest.approx(0, abs=1e-9)


def test_command_figures() -> None:
    command = np.where(TIME < 0.5, 0.0, 2.0)
    command[TIME >= 1.5] = 1.0
    c = sine_run(command=command)
    # 0 for 0.5 s, 2 for 1 s, 1 for 0.5 s
    assert c.mean_command == pytest.approx(1.25, rel=1e-9)
    assert c.rms_command == pytest.approx(np.sqrt((4 + 0.5) / 2), rel=1e-9)
    # a full and a half swing of 2 in 2 s
    assert c.switching_rate == pytest.approx(0.75)
    assert sine_run(command=command, command_max=4.0).switching_rate == pytest.approx(0.375)
    assert sine_run(command=np.full(len(TIME), 2.0)).switching_rate == 0
    assert sine_run().switching_rate == sine_run().mean_command == sine_run().peak_force == 0


def test_ratios_take_the_largest_storey_and_the_peaks_of_each_run() -> None:
    """Of drifts, accelerations and base shears that are 1 for a second, 3 for three; J11 and J12 of single peaks."""
    time = [0.0, 1.0, 1.0 + 1e-9, 4.0]
    size = np.array([[1.0], [1.0], [3.0], [3.0]])
    before = evaluate(FRAME, time, size * [4.0, 1.0], size * [8.0, 2.0])
    force, stroke = [0.0, 60.0, 0.0, 0.0], [0.0, 1.5, 0.0, 0.0]
    after = evaluate(FRAME, time, size * [1.0, 2.0], size * [1.0, 2.0], force, stroke)
    r = after.relative_to(before)
    largest = (2 / 4, 2 / 8, 50 / 120)
    assert list(r) == ["J1", "J2", "J3", "J4", "J5", "J6", "J11", "J12"]
    assert tuple(r.values()) == pytest.approx((*largest, *largest, 60 / (30 * 9.80665), 1.5 / 12))
    rest = evaluate(FRAME, time, 0 * size * [1.0, 1.0], 0 * size * [1.0, 1.0])
    refuses(lambda: after.relative_to(rest), "peak drift of the uncontrolled run is 0")


def test_a_command_counts_by_its_size_and_for_as_long_as_it_is_held() -> None:
    zeros = np.zeros((4, 2))
    c = evaluate(FRAME, [0.0, 1.0, 1.5, 4.0], zeros, zeros, command=[1.0, -3.0, 0.0, 9.0])
    assert c.mean_command == pytest.approx((1.0 * 1 + 3.0 * 0.5) / 4)


def test_intervals_are_those_of_the_normal_theory() -> None:
    rng = np.random.default_rng(3)
    motions = rng.normal(0.5, 0.1, 200)
    values = np.repeat(motions[None, :, None], 3, axis=2)
    low, high = interval(values)
    half = 1.96 * motions.std() / math.sqrt(200)  # the amplitudes of a motion are one draw
    assert (high - low) / 2 == pytest.approx(half, rel=0.08)
    assert (high + low) / 2 == pytest.approx(motions.mean(), abs=0.1 * half)
    seeds = rng.normal(0.0, 0.1, 60)
    low, high = interval(seeds[:, None, None] + np.zeros((1, 5, 1)))
    assert (high - low) / 2 == pytest.approx(1.96 * seeds.std() / math.sqrt(60), rel=0.1)


def test_mean_and_worst() -> None:
    values = np.array([[[0.2, 0.6], [0.4, 1.0]]])
    s = summarise(values)
    assert s.mean == pytest.approx(0.55)
    assert s.worst == 1.0
    assert 0.4 <= s.low < s.mean < s.high <= 0.7
    assert np.isnan(interval(values[:, :1])).all()
    refuses(lambda: summarise(np.ones(3)), "shape")


def test_a_shift_that_is_the_same_everywhere_is_certain() -> None:
    rng = np.random.default_rng(0)
    other = rng.uniform(0.2, 1.0, (1, 6, 3))
    seeds = np.repeat(other, 4, axis=0) - 0.05
    s = difference(seeds, other)
    assert s.low == pytest.approx(-0.05)
    assert s.high == pytest.approx(-0.05)
    assert summarise(seeds).high - summarise(seeds).low > 0.1
    refuses(lambda: difference(seeds[:, :5], seeds), "cannot be paired")


def test_seeds_of_two_trainings_are_drawn_apart_and_motions_together() -> None:
    rng = np.random.default_rng(1)
    motions = rng.uniform(0.2, 1.0, (1, 400, 1))
    mine, others = rng.normal(0.0, 0.1, (40, 1, 1)), rng.normal(0.0, 0.05, (50, 1, 1))
    s = difference(motions + mine, motions + others)
    half = 1.96 * np.sqrt(mine.var() / 40 + others.var() / 50)  # motions are common and cancel out
    assert (s.high - s.low) / 2 == pytest.approx(half, rel=0.08)
    assert s.mean == pytest.approx(mine.mean() - others.mean())
    assert s.worst == pytest.approx(mine.max() - others.min())
    # As many seeds of either: their order has no meaning.
    s = difference(motions + mine, motions + mine)
    assert s.mean == pytest.approx(0.0, abs=1e-12)
    assert (s.high - s.low) / 2 == pytest.approx(1.96 * mine.std() * np.sqrt(2 / 40), rel=0.1)


run = caller(add_to)
#: 5.16e5, 6.84e5, 6.84e5 N/m less a tenth, typed in.
SOFT = ShearFrame(np.full(3, 98.3), np.array([464400.0, 615600.0, 615600.0]), np.array([125.0, 50.0, 50.0]))
NAMES = ("passive-on", "clipped-optimal:balance=100,r=1e-8,noise_ratio=2000")


def test_a_tenth_of_stiffness_or_mass_moves_the_frequencies_by_its_root() -> None:
    nominal = dyke1996().frequencies
    for part, power in (("stiffness", 0.5), ("mass", -0.5)):
        frame = scaled(frame_model(), part, 1.21).structure
        assert frame is not None
        np.testing.assert_allclose(frame.frequencies / nominal, 1.21**power, rtol=1e-12)


def test_the_spread_is_that_of_frames_typed_in(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Its gain on the softer frame is that of a file of that frame, with the nominal one told."""
    for seed in (1, 2):
        kanai_tajimi(seed, duration=2.5).save(tmp_path / f"shake_{seed}.csv")
    replace(frame_model(), structure=SOFT).write(tmp_path / "soft.json")
    frame_model().write(tmp_path / "thought.json")
    call: list[str | Path] = ["compare", "frame", "--motions", *tmp_path.glob("shake_*.csv"), "--engine", "chain"]
    call += ["--jobs", "1", "--command-unit", "V", "--json"]
    assert run(*call, "--controllers", *NAMES, "--spread", "10", "-o", tmp_path / "out") == 0
    found = json.loads(capsys.readouterr().out)["controllers"][NAMES[1]]["spread"]
    assert set(found) == {f"{part} {sign}10 %" for part in ("stiffness", "mass") for sign in "+-"}
    text = (tmp_path / "out" / "table.md").read_text()
    assert "not as controllers are told" in text

    def gain(*more: str | Path) -> float:
        assert run(*call, "--controllers", *NAMES, "--model", tmp_path / "soft.json", *more) == 0
        rows = json.loads(capsys.readouterr().out)["controllers"]
        on, own = (sum(rows[name]["measures"][key]["mean"] for key in ("J1", "J2")) / 2 for name in NAMES)
        return own - on  # type: ignore[no-any-return]

    wrong, right = gain("--told", tmp_path / "thought.json"), gain()
    # Rows take peaks within control periods as well.
    assert found["stiffness -10 %"]["mean"] == pytest.approx(wrong, abs=0.01)
    assert right < wrong  # a controller of the true frame does better


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
        {"validation": lambda self: [ONE.compressed(2.0)]},
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


class InPlace:
    name, duration, sample_time = "own", 0.99, 0.01

    def __init__(self, forces: Any) -> None:
        self.acceleration = forces

    def scaled(self, factor: float) -> InPlace:
        self.acceleration *= factor
        return self


def test_a_load_whose_scaled_is_none_is_refused_before_a_run(bench: Bench) -> None:
    load: Any = InPlace(np.random.default_rng(0).standard_normal(100))
    said = r"own: scaled\(2\) changes the load itself; allowed: a new load"
    refuses(lambda: compare(bench, [CONSTANT], [load], [1.0]), said)


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
