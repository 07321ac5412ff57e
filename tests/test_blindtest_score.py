"""Sealing, judging and reporting of a blind test."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from modules import ROOT, loaded
from mrdamp.errors import InputError
from studies.blindtest import run, score, seal
from studies.blindtest.score import Row, Share
from studies.blindtest.sizing import OWN

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


# --- seal -----------------------------------------------------------------------------------
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
    with pytest.raises(InputError, match="not those whose hash"):
        seal.open_labels(tmp_path, "labels")
    path.write_text("nothing")
    with pytest.raises(InputError, match="damaged"):
        seal.open_labels(tmp_path, "labels")


# --- rows --------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("label", "given", "right", "tied"),
    [
        ("driver_lag", answer("effect", "driver_lag"), True, True),
        ("driver_lag", answer("effect", "command_delay"), False, False),
        ("driver_lag", answer("effect", "backlash", ties=(("driver_lag", "backlash"),)), False, True),
        ("driver_lag", answer("effect", "driver_lag", "sensor_lag"), False, False),
        ("driver_lag+backlash", answer("effect", "backlash", "driver_lag"), True, True),
        ("driver_lag+backlash", answer("effect", "backlash"), False, False),
        ("floor_mass@2", answer("effect", "floor_mass@2"), True, True),
        ("floor_mass@2", answer("effect", "floor_mass@1"), False, False),
        ("none", answer("none"), True, True),
        ("none", answer("parameters"), False, False),
        ("parameters", answer("effect", "saturation"), False, False),
        ("~hum", answer("unknown"), True, True),
        ("~hum", answer("effect", "sensor_lag"), False, False),
    ],
)
def test_right_or_wrong(label: str, given: dict[str, Any], right: bool, tied: bool) -> None:
    row = judged(label, given)
    assert (row.right, row.right_or_tied) == (right, tied)


def apart(label: str, verdict: str, *named: str) -> Row:
    """Of a rig whose own law is named saturation by some."""
    told: dict[str, Any] = {"also": ("saturation",), "base": 0.1, "misfit": 0.05, "rig": "damper"}
    return replace(judged(label, answer(verdict, *named), **told), after=0.11)


@pytest.mark.parametrize(
    ("label", "verdict", "named", "right"),
    [
        (OWN, "none", "", True),
        (OWN, "unknown", "", True),
        (OWN, "effect", "saturation", True),
        (OWN, "effect", "driver_lag", False),
        (OWN, "effect", "saturation driver_lag", False),
        ("driver_lag", "effect", "driver_lag saturation", True),
        ("driver_lag", "effect", "saturation", False),
        ("driver_lag", "effect", "driver_lag backlash", False),
        ("driver_lag", "unknown", "", False),
    ],
)
def test_what_is_the_rigs_own_law_may_be_named_besides(
    label: str, verdict: str, named: str, right: bool
) -> None:
    assert apart(label, verdict, *named.split()).right is right


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


# --- figures ------------------------------------------------------------------------------------
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


# --- page and command -------------------------------------------------------------------------------


@pytest.mark.parametrize(("seconds", "verdict"), [(60.0, "failed"), (0.01, "timeout")])
def test_diagnosis_that_fails_or_is_late_is_a_row(seconds: float, verdict: str, tmp_path: Path) -> None:
    (tmp_path / "case").mkdir()
    run.diagnose_one(tmp_path / "case", tmp_path / "answer", seconds)
    row = run.judge("case", LABELS["case_001"], tmp_path / "answer", tmp_path / "none.npz")
    assert (row.verdict, row.right) == (verdict, False)
    assert row.seconds < 20
