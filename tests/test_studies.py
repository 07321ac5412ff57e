"""The studies run, and their figures are those worked out by hand; sealing, judging and reporting of a blind test."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from modules import ROOT, STUDIES, loaded
from mrdamp.identify import identify
from mrdamp.model import Model
from mrdamp.records import RecordSet, embedded
from refusals import refuses
from studies.blindtest import score, seal
from studies.blindtest.score import Row, Share
from studies.blindtest.sizing import OWN
from studies.other_rig import NAMES, RATE, STEP, forces


@pytest.mark.slow
def test_right_single_causes_with_a_comparable_parameter_count(tmp_path: Path) -> None:
    """The label of a rig's gain is its change; a place is part of the name; a wrong cause does not count."""
    study = loaded(STUDIES / "interval_coverage.py")
    cases = {
        "1": ("sensor_gain@2", {"floor2.gain": 0.25}, ("sensor_gain", 2, "g", 1.2, [1.15, 1.3])),
        "2": ("sensor_leakage", {"tau": 0.5}, ("sensor_leakage", None, "tau", 0.4, [0.38, 0.42])),
        "3": ("sensor_leakage", {"tau": 0.5}, ("sensor_gain", None, "g", 1.2, [1.1, 1.3])),
    }
    labels = {case: {"label": label, "size": size} for case, (label, size, _) in cases.items()}
    (tmp_path / "labels.json").write_text(json.dumps(labels))
    for case, (_, _, (name, place, key, value, interval)) in cases.items():
        effect = {"name": name, "place": place, "parameters": {key: value}, "intervals": {key: interval}}
        (tmp_path / "answers" / case).mkdir(parents=True)
        (tmp_path / "answers" / case / "diagnosis.json").write_text(json.dumps({"effects": [effect]}))
    lines = study.table(list(study.values(tmp_path))).splitlines()
    assert lines[2] == "| sensor_gain | 1 of 1 | 4.0 % |"  # 1.2 for 1.25
    assert lines[-1].startswith("| all | 1 of 2 (0.50;")
    assert lines[-1].endswith("| 12.0 % |")  # the median of 4 and 20


@pytest.mark.slow
def test_the_chance_of_a_proposed_test() -> None:
    """Of four tests of each case two and one settle it: the chance of one or more of two is 1 - (1/2) (3/4)."""
    study = loaded(STUDIES / "next_test_study.py")
    assert study.at_least([np.array([0.5, 0.5])] * 4, 3) == pytest.approx(5 / 16)

    def outcome(resolved: bool, margin: float, behind: float) -> object:
        return study.Outcome("driver_lag" if resolved else "none", resolved, margin, behind)

    def row(proposed: object, *others: object) -> object:
        left_open = outcome(False, -5.0, 1.0)
        return study.Row("c", "driver_lag", "none", "6 s", ("driver_lag",), left_open, proposed, others)

    good = row(outcome(True, 9, 4), outcome(False, 1, 1), outcome(True, 3, 2), outcome(False, -2, 1))
    poor = row(outcome(False, -1, 1), outcome(True, 2, 2), outcome(False, -1, 2), outcome(False, -3, 1))
    text = study.table([good, poor])
    assert "proposed: 1 of 2 resolved, 0.50" in text
    assert "random: 2 of 6 resolved, 0.33" in text
    assert f"p = {1 - 0.5 * 0.75:.2g}" in text
    assert "1.41 (" in text  # geometric mean of 4 and 1/2


@pytest.mark.slow
def test_the_other_rig_is_its_equations() -> None:
    """A fifth of a second of the rig as it is, against SciPy's integrator."""
    t = STEP * np.arange(10001)
    speed = 2 * np.pi * 4
    x, current = 0.008 * np.sin(speed * t), np.full(len(t), 1.2)
    plain = {name: np.zeros(1) for name in NAMES}
    found = forces(x[None], current[None], plain)[0]
    field = math.tanh(0.96) / math.tanh(1.6)

    def rate(time: float, z: Any) -> Any:
        v = 0.008 * speed * math.cos(speed * time)
        return (v - 0.55 * abs(v) * np.abs(z) ** 0.4 * z - 0.45 * v * np.abs(z) ** 1.4) / (7e-4 * 1.15)

    every = t[:: round(1 / (STEP * RATE))]
    z = solve_ivp(rate, (0, t[-1]), [0.0], t_eval=every, rtol=1e-8, atol=1e-10).y[0]
    v = 0.008 * speed * np.cos(speed * every)
    wanted = (850 + 520 * field) * v + (110 + 1150 * field) * z + 500 * 0.008 * np.sin(speed * every)
    np.testing.assert_allclose(found[1:-1], wanted[1:-1], atol=2e-3 * np.abs(wanted).max())


def test_a_sensors_effect_is_put_in_after_a_force_on_the_rod() -> None:
    """A regression of the added force on the acceleration finds the mass; in the other order it is off by the gain."""
    study = loaded(STUDIES / "spike_bench.py")
    every = study.records_of("embedded")
    records = RecordSet("embedded", every.train[:4], every.validation[:2])
    simulator = identify("bouc_wen", embedded().train[:4], dependence="linear", starts=1, threads=1).model
    own = records.train[0]
    acceleration = np.gradient(np.gradient(own.displacement)) / own.sample_time**2
    ratios = []
    for effects in (("moving_mass",), ("sensor_gain", "moving_mass")):
        case = study.make("embedded", effects, simulator, records, "all", np.random.default_rng(3))
        size = case.label["size"]
        force = np.asarray(case.records[0].channel("force_N")) / size.get("g", 1.0)
        added = (force - np.asarray(own.channel("force_N")))[50:-50]
        ratios.append(float(np.polyfit(acceleration[50:-50], added, 1)[0]) / float(size["m"]))
    assert abs(np.log(size["g"])) > 0.1
    assert ratios[0] == pytest.approx(0.85, abs=0.05)  # below 1 by the displacement's noise
    assert ratios[1] == pytest.approx(ratios[0], rel=0.03)


tool = loaded(STUDIES / "bench_table.py")

LAG = ("driver_lag", None)
RIGHT = Row(
    "case_001", "damper", "driver_lag", ("driver",), False, "effect", frozenset({LAG}),
    (frozenset({"driver_lag", "command_delay"}),), "driver", 0.9, 0.2, 0.1, 20.0, also=frozenset({"saturation"}),
    base=0.1, misfit=0.05,
)  # fmt: skip
PLACED = replace(
    RIGHT, case="case_002", rig="frame", label="floor_mass@2", named=frozenset({("floor_mass", "1")}), after=0.25,
    seconds=40.0, misfit=0.1,
)  # fmt: skip
OWN_CAUSE = replace(RIGHT, case="case_003", label="~own", verdict="unknown", named=frozenset(), misfit=0.1)
FAILED = replace(OWN_CAUSE, case="case_004", verdict="failed", probability=math.nan, after=math.nan, stage=None)
ROWS = [replace(RIGHT, baseline=True), PLACED, OWN_CAUSE, FAILED]


def test_table_counts_by_group() -> None:
    lines = dict(line.strip("| ").split(" | ", 1) for line in tool.table(ROWS).splitlines()[2:])
    assert lines["single effects named"].split(" | ") == [
        "1 of 2 (.50; .09 to .91)", *("1 of 1 (1.00)", "0 of 1 (.00)") * 3
    ]  # fmt: skip
    assert lines["of these, base of 6 % and more"].startswith("0 of 1 (.00")
    assert lines["controls without an invented cause"].startswith("1 of 2 (.50; .09 to .91)")
    assert lines["gap on held-out tests over the base, median and worst"].startswith("1.00, 2.50")
    assert lines["corrected simulator worse than the nominal one on held-out tests"].startswith("2 of 4")
    assert lines["seconds, median and worst"].startswith("20, 40")
    assert "pairs named" not in lines
    assert tool.table([replace(r, misfit=math.nan) for r in ROWS]).startswith("| figure | all |\n")


def test_answers_of_a_measured_bench_are_scored(tmp_path: Path) -> None:
    """Two tests of one sample time; the handed-over simulator has half of the rig's yield force, the nominal none."""
    law = {"c0a": 0.0, "c0b": 0.0, "fya": 50.0, "fyb": 0.0, "v_ref": 1e-4}
    t = np.arange(600) * 0.002
    own = {"time_s": t, "displacement_m": 0.01 * np.sin(9 * t), "command": np.ones_like(t)}
    force = 2 * Model("bingham", law).simulate(0.002, own)["force_N"]
    tests = {f"{k}/{n}": v for k in "ab" for n, v in {**own, "force_N": force, "nominal_N": 0 * force}.items()}
    (tmp_path / "tests").mkdir()
    np.savez(tmp_path / "tests" / "c.npz", **tests)
    labels = {"c": {"label": "seal_friction", "stages": ["mechanics"], "gap": 1.0, "base": 0.5}}
    (tmp_path / "labels.json").write_text(json.dumps(labels))
    (tmp_path / "answers" / "c").mkdir(parents=True)
    Model("bingham", law).write(tmp_path / "answers" / "c" / "corrected.json")
    answer = {"verdict": "unknown", "effects": [], "where": {"stages": {"mechanics": 1.0}}, "probabilities": {}}
    (tmp_path / "answers" / "c" / "diagnosis.json").write_text(json.dumps(answer))
    (row,) = tool.of_folder(tmp_path)
    assert (row.verdict, row.right, row.stage_right) == ("unknown", False, True)
    assert row.before == pytest.approx(math.sqrt(2))
    assert row.after == pytest.approx(math.sqrt(2) / 2, rel=1e-3)
    assert row.base == pytest.approx(math.sqrt(2) / 2)
    assert "seconds" not in tool.table([row])


SHARED = ROOT.parent / "shared" / "cases"
LABELS = {"case_001": {"label": "driver_lag", "stages": ["driver"]}}


def answer(
    verdict: str, *effects: str, probability: float = 0.9, ties: tuple[tuple[str, ...], ...] = ()
) -> dict[str, Any]:
    parts = [(name, place or None) for name, _, place in (e.partition("@") for e in effects)]
    return {
        "verdict": verdict,
        "effects": [{"name": n, "place": p and int(p), "probability": probability} for n, p in parts],
        "candidates": [{"effects": list(effects), "probability": probability, "heldout_gap": 0.01}],
        "probabilities": {verdict: probability},
        "indistinguishable": [list(t) for t in ties],
        "where": {"stages": {"driver": 0.7, "sensor": 0.3}},
    }


def judged(label: str, given: dict[str, Any], stages: tuple[str, ...] = ("driver",), **told: object) -> Row:
    return score.row("c", {"label": label, "stages": list(stages), **told}, given, (0.2, 0.01), 12.0)


def test_seal_is_opened_with_what_was_sealed(tmp_path: Path) -> None:
    digest = seal.seal(tmp_path, "labels", LABELS)
    assert seal.open_labels(tmp_path, "labels")[1] == LABELS
    assert seal.digest_of(tmp_path, "labels") == digest
    assert seal.seal(tmp_path, "labels", LABELS) != digest  # salted
    text = (tmp_path / "labels.sealed").read_bytes()
    assert b"driver" not in text
    assert b"driver" not in bytes.fromhex(text.decode().split("\n")[1])


def test_changed_labels_are_found_out(tmp_path: Path) -> None:
    seal.seal(tmp_path, "labels", LABELS)
    path = tmp_path / "labels.sealed"
    digest, masked = path.read_text().split()
    path.write_text(f"{digest}\n{masked[:-2]}{'00' if masked[-2:] != '00' else '01'}\n")
    refuses(lambda: seal.open_labels(tmp_path, "labels"), "not those whose hash")
    path.write_text("nothing")
    refuses(lambda: seal.open_labels(tmp_path, "labels"), "damaged")


#: A rig whose own law some call a saturation.
ALSO: dict[str, Any] = {"also": ("saturation",), "base": 0.1, "misfit": 0.05, "rig": "damper"}


@pytest.mark.parametrize(
    ("label", "verdict", "named", "told", "right"),
    [
        ("driver_lag", "effect", "driver_lag", {}, True),
        ("driver_lag", "effect", "command_delay", {}, False),
        ("driver_lag", "effect", "driver_lag sensor_lag", {}, False),
        ("driver_lag+backlash", "effect", "backlash driver_lag", {}, True),
        ("driver_lag+backlash", "effect", "backlash", {}, False),
        ("floor_mass@2", "effect", "floor_mass@2", {}, True),
        ("floor_mass@2", "effect", "floor_mass@1", {}, False),
        ("none", "none", "", {}, True),
        ("none", "parameters", "", {}, False),
        ("parameters", "effect", "saturation", {}, False),
        ("~hum", "unknown", "", {}, True),
        ("~hum", "effect", "sensor_lag", {}, False),
        # What is the rig's own law may be named besides.
        (OWN, "none", "", ALSO, True),
        (OWN, "unknown", "", ALSO, True),
        (OWN, "effect", "saturation", ALSO, True),
        (OWN, "effect", "driver_lag", ALSO, False),
        (OWN, "effect", "saturation driver_lag", ALSO, False),
        ("driver_lag", "effect", "driver_lag saturation", ALSO, True),
        ("driver_lag", "effect", "saturation", ALSO, False),
        ("driver_lag", "effect", "driver_lag backlash", ALSO, False),
        ("driver_lag", "unknown", "", ALSO, False),
    ],
)
def test_right_or_wrong(label: str, verdict: str, named: str, told: dict[str, Any], right: bool) -> None:
    row = replace(judged(label, answer(verdict, *named.split()), **told), after=0.11)
    assert row.right is right


def test_a_tie_is_not_right() -> None:
    row = judged("driver_lag", answer("effect", "backlash", ties=(("driver_lag", "backlash"),)))
    assert (row.right, row.right_or_tied) == (False, True)


def test_stage_and_stated_probability() -> None:
    assert judged("driver_lag", answer("effect", "driver_lag")).stage_right
    assert not judged("backlash", answer("effect", "backlash"), ("mount",)).stage_right
    assert not score.failed("c", LABELS["case_001"], "timeout", 300.0, "").stage_right
    given = answer("effect", "driver_lag", probability=0.7)
    given["candidates"] = [
        {"effects": ["sensor_lag"], "probability": 0.2},
        {"effects": ["driver_lag"], "probability": 0.65},
    ]
    assert score.stated(given) == 0.65
    assert score.stated(answer("unknown", probability=0.8)) == 0.8
    assert math.isnan(score.stated({"verdict": "none", "effects": []}))


def test_gaps(tmp_path: Path) -> None:
    """Relative errors, summed in squares over tests; the first 50 samples do not count."""
    t = np.arange(400) * 0.002
    force = 100 * np.sin(40 * t)
    wild = np.where(np.arange(400) < 50, 1e6, 0.0)
    arrays = {"time_s": t, "force_N": force, "nominal_N": 0.7 * force + wild}
    arrays |= {"command": 0 * t, "displacement_m": 0 * t}
    np.savez(tmp_path / "t.npz", **{f"{test}/{k}": v for test in ("h1", "h2") for k, v in arrays.items()})
    found = score.gaps(tmp_path / "t.npz", lambda inputs: {"force_N": 1.03 * inputs["force_N"]})
    assert found == pytest.approx((0.3 * math.sqrt(2), 0.03 * math.sqrt(2)), rel=1e-6)


def rows() -> list[Row]:
    return [
        judged("driver_lag", answer("effect", "driver_lag", probability=0.95)),
        judged("driver_lag", answer("effect", "sensor_lag", probability=0.95)),
        judged("driver_lag+backlash", answer("effect", "driver_lag", "backlash", probability=0.85)),
        judged("none", answer("none", probability=0.85)),
        judged("parameters", answer("effect", "heating", probability=0.3)),
        judged("~hum", answer("unknown", probability=0.3)),
        score.failed("c", {"label": "heating", "stages": ["fluid"]}, "timeout", 300.0, ""),
    ]


def test_shares() -> None:
    found = score.shares(rows())
    assert found["single effects named"] == Share(1, 3)
    assert found["pairs named"] == Share(1, 1)
    assert found["no false alarm (none, parameters)"] == Share(1, 2)
    assert found["unknown recognised"] == Share(1, 1)
    assert found["stage"] == Share(4, 5)
    assert found["all"] == Share(4, 7)
    low, high = Share(19, 20).interval  # Newcombe 1998, table I: 0.764 to 0.991
    assert [low, high] == pytest.approx([0.764, 0.991], abs=1e-3)
    n = score.numbers(rows())
    assert (n.shrink_median, n.shrink_count, n.seconds_worst) == pytest.approx((0.95, 3, 300.0))


def test_calibration_error() -> None:
    """Bins of a tenth: (0.95: 1 of 2), (0.85: 2 of 2), (0.3: 1 of 2) of six answers."""
    bins = score.reliability(rows())
    assert [b.stated for b in bins] == pytest.approx([0.3, 0.85, 0.95])
    assert [b.share for b in bins] == [Share(1, 2), Share(2, 2), Share(1, 2)]
    assert score.calibration_error(rows()) == pytest.approx((2 * 0.2 + 2 * 0.15 + 2 * 0.45) / 6)


@pytest.mark.skipif(not SHARED.is_dir(), reason="needs the folder ../shared/cases")
def test_definitions_are_the_shared_scorer_s() -> None:
    shared = loaded(SHARED / "score.py")
    for label in ("none", "parameters", "~hum", "driver_lag", "driver_lag+backlash", "floor_mass@2"):
        row = judged(label, answer("none"))
        assert (row.want, set(row.causes)) == shared.truth(label)


