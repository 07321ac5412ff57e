"""Causes outside the catalogue: as rivals, and the stage of those that no catalogue has, made in NumPy."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from bingham_rig import LAW, force, model
from mrdamp.diagnosis.attribution.frame_blocks import Block, shares_by_stage
from mrdamp.diagnosis.attribution.frame_damper import damper_evidence
from mrdamp.diagnosis.attribution.shares import Measured
from mrdamp.diagnosis.attribution.stage_columns import columns_of
from mrdamp.diagnosis.attribution.stage_evidence import StageEvidence
from mrdamp.diagnosis.attribution.stages import stage_shares
from mrdamp.diagnosis.case.folder import Case
from mrdamp.diagnosis.damper_run import judge
from mrdamp.diagnosis.evidence.resample import DRAWS
from mrdamp.diagnosis.evidence.verdict import Decision, Scored, decide
from mrdamp.diagnosis.fits.limits import Limits
from mrdamp.diagnosis.fits.search import Search
from mrdamp.diagnosis.hypotheses import outside
from mrdamp.diagnosis.problem.damper import DamperRig
from mrdamp.diagnosis.problem.residuals import Problem
from mrdamp.model import Model
from mrdamp.model.core import Array
from mrdamp.records import Record
from mrdamp.structures import ShearFrame
from toy_rig import FIFTH, search_of, toy


def judged(truth: dict[str, float], *, rivals: bool) -> tuple[Search, Decision]:
    rig = replace(toy(truth, noise=0.004), rivals=(FIFTH,) if rivals else ())
    search = search_of(rig, 0.004)
    search.run()
    return search, judge(search)[1]


def test_a_rival_that_explains_more_makes_the_answer_unknown() -> None:
    alone = judged({"fifth": 0.5}, rivals=False)[1]
    assert alone.verdict == "effect"  # the nearest effect would be named
    assert alone.chosen.causes == ("cubic",)
    search, decision = judged({"fifth": 0.5}, rivals=True)
    assert decision.verdict == "unknown"
    assert decision.unknown > 0.9
    assert search.looks_like is not None
    assert search.looks_like.hypothesis.causes == ("fifth",)
    assert search.looks_like.settings["fifth"] == pytest.approx(0.5, rel=0.05)
    # The simulator can be given no rival: the chosen fit is the catalogue's.
    assert "fifth" not in decision.chosen.causes
    shares, _ = stage_shares(search, search.base, "unknown")
    assert shares["mechanics"] == 1.0


def test_a_rival_no_better_than_an_effect_does_not_win() -> None:
    nominal, effect = Scored((), False, 1.0, 0), Scored(("gas_spring",), False, 0.05, 2, left_out=0.05)
    rival = Scored(("end_stop",), False, 0.05, 2, left_out=0.05)
    fair = decide([nominal, effect], 1e-4, [rival])
    assert fair.verdict == "effect"
    assert 0.1 < fair.unknown < 0.5  # and yet it is owned that it may be
    better = decide([nominal, effect], 1e-4, [replace(rival, cost=0.005, left_out=0.005)])
    assert (better.verdict, better.chosen.causes) == ("unknown", ("gas_spring",))


def test_a_supply_sinks_exponentially_under_a_lasting_command() -> None:
    t = 0.001 * np.arange(4000)
    settings = {
        "outside_sag_share": 0.3, "outside_sag_time": 0.5, "outside_sag_power": 2.0, "outside_sag_command": 2.0
    }  # fmt: skip
    full = outside.commanded(settings, np.full(4000, 2.0), 0.001)
    np.testing.assert_allclose(full, 2.0 * (1 - 0.3 * (1 - np.exp(-(t + 0.001) / 0.5))), rtol=1e-9)
    half = outside.commanded(settings, np.full(4000, 1.0), 0.001)
    assert half[-1] == pytest.approx(1 - 0.3 / 4 * (1 - np.exp(-4 / 0.5)), rel=1e-6)


def test_a_threshold_takes_its_size_off_either_sign() -> None:
    out = outside.commanded({"outside_threshold": 0.2}, np.array([-1.0, -0.1, 0.0, 0.15, 0.5]), 0.001)
    np.testing.assert_allclose(out, [-0.8, 0.0, 0.0, 0.0, 0.3])


STOP = {"outside_stop_k": 1000.0, "outside_stop_x": 0.005}
LIMIT = {"outside_limit_force": 100.0, "outside_limit_knee": 30.0}
WEAR = {"outside_wear_loss": 0.25, "outside_wear_x": 0.004, "outside_wear_width": 0.001}
SIDE_LOAD = {"outside_side_force": 500.0, "outside_side_x": 0.001, "outside_side_v": 0.001}


@pytest.mark.parametrize(
    ("settings", "want"),
    [
        ({**STOP, "outside_stop_side": 1.0}, (-400, -30, 30, 403)),
        ({**STOP, "outside_stop_side": -1.0}, (-403, -30, 30, 400)),
        ({**STOP, "outside_stop_side": 0.0}, (-403, -30, 30, 403)),
        ({**LIMIT, "outside_limit_side": 1.0}, (-400, -30, 30, 100)),
        ({**LIMIT, "outside_limit_side": -1.0}, (-100, -30, 30, 400)),
        ({**LIMIT, "outside_limit_side": 0.0}, (-100, -30, 30, 100)),
        (WEAR, (-400, -30, 30 * 0.75, 400)),
        (SIDE_LOAD, (-404.5, -32.5, 31.5, 403.5)),
    ],
)
def test_a_rival_acts_where_it_is(settings: dict[str, float], want: tuple[float, ...]) -> None:
    """A stop beyond 5 mm and a limit of 100 N on their sides, a worn place at 4 mm, a load on the guide beyond 1 mm."""
    push, x = np.array([-400.0, -30.0, 30.0, 400.0]), np.array([-0.008, -0.004, 0.004, 0.008])
    np.testing.assert_allclose(outside.forced(settings, push, x, np.sign(x)), want, rtol=1e-5)


def test_settled_particles_are_stirred_up_over_the_path() -> None:
    x = np.array([0.0, 0.002, -0.001, -0.001])
    settled = {"outside_settled_loss": 0.4, "outside_settled_path": 0.005}
    lost = 0.4 * np.exp(-np.array([0.0, 0.002, 0.005, 0.005]) / 0.005)
    np.testing.assert_allclose(outside.forced(settled, np.full(4, 10.0), x, 0 * x), 10 * (1 - lost))


def test_the_command_is_heard_by_the_own_sensor_alone() -> None:
    true, command = np.array([5.0, -5.0]), np.array([0.5, 1.0])
    np.testing.assert_allclose(outside.read({"outside_talk": 20.0}, "force", true, command), [15.0, 15.0])
    np.testing.assert_array_equal(outside.read({"outside_talk": 20.0}, "reference", true, command), true)
    np.testing.assert_array_equal(outside.read({}, "force", true, command), true)


def test_the_motion_is_recorded_ever_later_by_a_slow_clock() -> None:
    t = 0.002 * np.arange(2001)
    drift = {"outside_clock_rate": 0.01}
    true, v = np.sin(3 * t), 3 * np.cos(3 * t)
    recorded = tuple(np.interp(t / 1.01, t, values) for values in (true, v))
    found = outside.moved(drift, recorded, 0.002)
    inside = slice(0, -30)
    np.testing.assert_allclose(found[0][inside], true[inside], atol=2e-5)
    np.testing.assert_allclose(found[1][inside], v[inside], atol=6e-5)
    np.testing.assert_array_equal(outside.moved({}, recorded, 0.002)[0], recorded[0])


DT, NOISE, SIZE = 4e-3, 3.0, 0.014
TIME = DT * np.arange(1500)
#: Amplitudes, angular frequencies and commands of the records.
MOTIONS = ((1.0, 7.0), (0.6, 11.0), (0.8, 5.0), (0.4, 17.0))
COMMANDS = (
    0.5 + 0.5 * np.sign(np.sin(2.1 * TIME)),
    0.5 + 0.5 * np.sin(1.3 * TIME),
    np.clip(0.3 + 0.4 * np.floor(3 * np.abs(np.sin(0.9 * TIME))) / 2, 0, 1),
    0.8 * (np.sin(3.1 * TIME) > 0.3),
)

Fault = Callable[[Array, Array], Array]


def damper(x: Array, u: Array) -> Array:
    return force(np.gradient(x, DT, edge_order=2), u)


def low_pass(x: Array, tau: float) -> Array:
    share = 1 - np.exp(-DT / tau)
    return np.asarray(lfilter([share], [1, share - 1], x))


def bump(x: Array, at: float, width: float) -> Array:
    return np.asarray(np.exp(-(((x - at * SIZE) / (width * SIZE)) ** 2)))


def opening_valve(x: Array, u: Array) -> Array:
    whole, out, opened = damper(x, u), np.empty(len(x)), 0.0
    for k, push in enumerate(whole):
        opened = 1.0 if abs(push) > 450 else opened * np.exp(-DT / 0.4)
        out[k] = push * (1 - 0.3 * opened)
    return out


def soft_mount(x: Array, u: Array) -> Array:
    still = damper(x, u)
    return damper(x - 4e-7 * low_pass(still + 1e-3 * still * np.abs(still), 0.01), u)


FAULTS: dict[str, tuple[str, Fault]] = {
    "tired driver": ("driver", lambda x, u: damper(x, u * (1 - 0.5 * low_pass(u**3, 0.8)))),
    "dropouts": ("driver", lambda x, u: damper(x, np.where((TIME % 1.7) < 0.2, 0.0, u))),
    "few levels": ("driver", lambda x, u: damper(x, 0.35 * np.floor(u / 0.35 + 0.5))),
    "another coil in each record": ("driver", lambda x, u: damper(x, u * (1 + 0.4 * np.sin(1e3 * u.mean())))),
    "opening valve": ("fluid", opening_valve),
    "worn place": ("fluid", lambda x, u: damper(x, u) * (1 - 0.3 * bump(x, 0.4, 0.2))),
    "chatter": ("fluid", lambda x, u: damper(x, u) * (1 + 0.12 * np.sin(60 * TIME))),
    "stuck field": (
        "magnetics",
        lambda x, u: damper(x, u + 0.25 * np.exp(-((u / 0.3) ** 2)) * np.cos(3 * u)),
    ),
    "coil that pulls at the piston": (
        "magnetics",
        lambda x, u: damper(x, u) + 90 * u**2 * bump(x, 0.3, 0.25),
    ),
    "magnet against the coil": ("magnetics", lambda x, u: damper(x, 0.15 + np.abs(u - 0.15))),
    "leaking spring": ("mechanics", lambda x, u: damper(x, u) + 3e4 * (x - low_pass(x, 0.12))),
    "bumper": ("mechanics", lambda x, u: damper(x, u) + 400 * np.expm1(4 * np.maximum(x / SIZE - 0.3, 0))),
    "soft mount": ("mount", soft_mount),
    "creeping cell": ("sensor", lambda x, u: damper(x, u) + 0.25 * low_pass(damper(x, u), 0.25)),
    "hum": ("sensor", lambda x, u: damper(x, u) + 40 * np.sin(80 * TIME)),
    "slow clock": ("sensor", lambda x, u: damper(np.interp(TIME + 4e-3 * TIME, TIME, x), u)),
}


def moved(k: int) -> Array:
    scale, omega = MOTIONS[k]
    return np.asarray(scale * (0.01 * np.sin(omega * TIME) + 0.004 * np.sin(2.4 * omega * TIME)))


def searched(fault: Fault, cell: bool = False) -> Search:
    """A search that has tried no cause; cell: with a load cell that reads what the sensor does."""
    rng = np.random.default_rng(3)
    records = []
    for k, u in enumerate(COMMANDS):
        x = moved(k)
        true = fault(x, u)
        names = ("force_N", "reference_force_N") if cell else ("force_N",)
        read = {n: true + NOISE * rng.standard_normal(len(true)) for n in names}
        records.append(Record(f"{k}", None, DT, {"displacement_m": x, "command": u, **read}))
    problem = Problem(DamperRig(model(), tuple(records)))
    floor = float(np.sum((NOISE * problem.weights) ** 2))
    return Search(problem, floor, Limits(base=1))


@pytest.mark.parametrize("name", FAULTS)
def test_the_stage_of_a_fault_that_no_catalogue_has(name: str) -> None:
    stage, fault = FAULTS[name]
    search = searched(fault)
    evidence = StageEvidence.of(search.problem, NOISE)
    assert evidence is not None
    shares, intervals = stage_shares(search, search.base, "unknown", evidence=evidence)
    assert sum(shares.values()) == pytest.approx(1.0)
    assert max(shares, key=lambda s: shares[s]) == stage
    assert shares[stage] > 0.5
    low, high = intervals[stage]
    assert low - 1e-9 <= shares[stage] <= high + 1e-9


def test_behind_a_load_cell_the_sensor_is_the_reading_of_the_displacement() -> None:
    """What the own sensor adds was measured; what a displacement read late does to the damper was not."""
    search = searched(FAULTS["slow clock"][1], cell=True)
    evidence = StageEvidence.of(search.problem, NOISE)
    assert evidence is not None
    parts = (
        Measured("a", ("driver", "magnetics", "fluid", "mechanics", "mount"), 0.9, (0.8, 1.0)),
        Measured("b", ("sensor",), 0.1, (0.0, 0.2)),
    )
    shares, _ = stage_shares(search, search.base, "unknown", parts, evidence=evidence)
    assert sum(shares.values()) == pytest.approx(1.0)
    assert shares["sensor"] > 0.9
    assert "sensor" not in columns_of(search.problem, search.problem.rig)  # type: ignore[arg-type]


@pytest.mark.parametrize(("name", "between"), [("tired driver", (0, 1)), ("worn place", (1, 0))])
def test_the_stage_of_a_fault_of_a_frames_damper(name: str, between: tuple[int, int]) -> None:
    """With its measured stroke put in, whichever way it stands in the frame; its sensor is none of its stages."""
    stage, fault = FAULTS[name]
    rng = np.random.default_rng(4)
    records = []
    for k, u in enumerate(COMMANDS):
        x = moved(k)
        sign = 1.0 if between == (0, 1) else -1.0
        channels = {
            "floor1_displacement_m": sign * x + 1e-6 * rng.standard_normal(len(x)),
            "ground_acceleration_m_s2": np.zeros(len(x)),
            "command": u,
            "force_N": fault(x, u) + NOISE * rng.standard_normal(len(x)),
        }
        records.append(Record(f"{k}", None, DT, channels))
    frame = ShearFrame(np.array([500.0]), np.array([4e5]), np.array([800.0]), between)
    case = Case("a", Path(), Model("bingham", LAW, rig="frame", structure=frame), tuple(records), ())
    block = Block("damper", None, 0.2, 0.01, np.full(DRAWS, 0.04))
    clean, storey = replace(block, gap=0.01), Block("storey", 1, 0.2, 0.01, np.full(DRAWS, 0.04))
    assert damper_evidence(case, [clean, storey]) is None
    assert damper_evidence(case, [clean]) is not None  # what no block shows may be the damper's all the same
    evidence = damper_evidence(case, [block])
    problem = Problem(toy({}))
    search = Search(problem, 1e-3)
    shares, ends = shares_by_stage(search, search.base, "unknown", [block], evidence)
    assert sum(shares.values()) == pytest.approx(1.0)
    assert max(shares, key=lambda s: shares[s]) == stage
    assert shares["sensor"] == 0
    low, high = ends[stage]
    assert 0.5 < low <= high <= 1
