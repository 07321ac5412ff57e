"""Causes outside the catalogue as rivals: what each does, and when the answer is `unknown` because of one."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from mrdamp.diagnosis.attribution.stages import stage_shares
from mrdamp.diagnosis.case.folder import read_case
from mrdamp.diagnosis.damper_run import judge
from mrdamp.diagnosis.evidence.verdict import Decision, Scored, decide
from mrdamp.diagnosis.fits.search import Search
from mrdamp.diagnosis.hypotheses import outside
from mrdamp.diagnosis.run import diagnose
from mrdamp.records.csv_file import render
from test_diagnosis_cases import make_case
from toy_rig import FIFTH, search_of, toy

Array = NDArray[np.float64]


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


def test_a_cause_that_free_numbers_could_stand_in_for_is_named() -> None:
    """A small part of the third power beside a gain that is far off."""
    search, decision = judged({"gain": 2.3, "cubic": 0.008}, rivals=False)
    assert search.solved(search.base)
    assert decision.verdict == "effect"


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
    force, x = np.array([-400.0, -30.0, 30.0, 400.0]), np.array([-0.008, -0.004, 0.004, 0.008])
    np.testing.assert_allclose(outside.forced(settings, force, x, np.sign(x)), want, rtol=1e-5)


def test_settled_particles_are_stirred_up_over_the_path() -> None:
    x = np.array([0.0, 0.002, -0.001, -0.001])
    settled = {"outside_settled_loss": 0.4, "outside_settled_path": 0.005}
    lost = 0.4 * np.exp(-np.array([0.0, 0.002, 0.005, 0.005]) / 0.005)
    np.testing.assert_allclose(outside.forced(settled, np.full(4, 10.0), x, 0 * x), 10 * (1 - lost))


def test_the_command_is_heard_by_the_own_sensor_alone() -> None:
    force, command = np.array([5.0, -5.0]), np.array([0.5, 1.0])
    np.testing.assert_allclose(outside.read({"outside_talk": 20.0}, "force", force, command), [15.0, 15.0])
    np.testing.assert_array_equal(outside.read({"outside_talk": 20.0}, "reference", force, command), force)
    np.testing.assert_array_equal(outside.read({}, "force", force, command), force)


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


def bingham(v: Array, command: Array) -> Array:
    """The law of `make_case`, without the chain."""
    return np.asarray((800 + 200 * command) * v + (40 + 300 * command) * np.tanh(v / 0.02))


def write_case(folder: Path, stop: float) -> Path:
    """Sines with steps of the command; stop: stiffness (N/m^1.5) of a Hertzian stop at 7 mm, on both sides."""
    case = make_case(
        folder,
        records=["01.csv", "02.csv", "03.csv", "03_repeat.csv"],
        sample_rate_hz=500.0,
    )
    rng = np.random.default_rng(5)
    t = 0.002 * np.arange(1500)
    for name, hertz, size in (
        ("01.csv", 1.0, 0.010), ("02.csv", 2.0, 0.008), ("03.csv", 0.6, 0.009), ("03_repeat.csv", 0.6, 0.009)
    ):  # fmt: skip
        phase = 2 * np.pi * hertz * t
        x, v = size * np.sin(phase), size * 2 * np.pi * hertz * np.cos(phase)
        command = np.where(np.floor(t * 1.7) % 2 == 0, 0.3, 1.2)
        force = bingham(v, command) + stop * np.sign(x) * np.maximum(np.abs(x) - 0.007, 0.0) ** 1.5
        columns = {
            "time_s": t,
            "displacement_m": x,
            "command": command,
            "force_N": force + 1.5 * rng.standard_normal(len(t)),
        }
        (folder / name).write_text(render(columns))
    return case


@pytest.mark.slow
def test_an_end_stop_is_owned_to_be_none_of_the_catalogue(tmp_path: Path) -> None:
    found = diagnose(read_case(write_case(tmp_path / "stop", 1.2e6)))
    assert found.verdict == "unknown"
    assert found.outside is not None
    assert (found.outside["cause"], found.outside["stage"]) == ("end_stop", "mechanics")
    assert found.where.stages["mechanics"] == 1.0
    assert outside.PLAIN["end_stop"] in found.sentence
    assert found.probabilities["unknown"] > 0.8
    assert found.to_dict()["outside_catalogue"] == found.outside
    assert not any(name.startswith("outside") for e in found.corrected.effects for name in e.parameters)
