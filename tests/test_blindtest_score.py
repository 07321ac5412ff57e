"""Sealing, judging and reporting of a blind test."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from modules import loaded
from mrdamp.errors import InputError
from studies.blindtest import report, run, score, seal
from studies.blindtest.__main__ import main
from studies.blindtest.score import Row, Share

SHARED = Path(__file__).parents[2] / "shared" / "cases"
LABELS = {"case_001": {"label": "driver_lag", "stages": ["driver"]}}


def answer(
    verdict: str, *effects: str, probability: float = 0.9, ties: tuple[tuple[str, ...], ...] = ()
) -> dict[str, object]:
    parts = [(name, place or None) for name, _, place in (e.partition("@") for e in effects)]
    return {
        "verdict": verdict,
        "effects": [{"name": n, "place": p and int(p), "probability": probability} for n, p in parts],
        "candidates": [{"effects": list(effects), "probability": probability, "heldout_gap": 0.01}],
        "probabilities": {verdict: probability},
        "indistinguishable": [list(t) for t in ties],
        "where": {"stages": {"driver": 0.7, "sensor": 0.3}},
    }


def judged(label: str, given: dict[str, object], stages: tuple[str, ...] = ("driver",)) -> Row:
    return score.row("c", {"label": label, "stages": list(stages)}, given, (0.2, 0.01), 12.0)


# --- seal -----------------------------------------------------------------------------------
def test_seal_is_opened_with_what_was_sealed(tmp_path: Path) -> None:
    digest = seal.seal(tmp_path, "labels", LABELS)
    assert seal.open_labels(tmp_path, "labels")[1] == LABELS
    assert seal.digest_of(tmp_path, "labels") == digest
    assert len(digest) == 64
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
        (
            "driver_lag",
            answer("effect", "command_delay", ties=(("driver_lag", "command_delay"),)),
            False,
            True,
        ),
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
def test_right_or_wrong(label: str, given: dict[str, object], right: bool, tied: bool) -> None:
    row = judged(label, given)
    assert (row.right, row.right_or_tied) == (right, tied)


def test_stage() -> None:
    assert judged("driver_lag", answer("effect", "driver_lag")).stage_right
    assert not judged("backlash", answer("effect", "backlash"), ("mount",)).stage_right
    assert judged("none", answer("none"), ()).stage_right
    assert not score.failed("c", LABELS["case_001"], "timeout", 300.0, "").stage_right


def test_stated_probability_is_that_of_the_answer() -> None:
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
    arrays = {
        "time_s": t,
        "force_N": force,
        "nominal_N": 0.7 * force + wild,
        "command": 0 * t,
        "displacement_m": 0 * t,
    }
    np.savez(tmp_path / "t.npz", **{f"{test}/{k}": v for test in ("h1", "h2") for k, v in arrays.items()})
    before, after = score.gaps(tmp_path / "t.npz", lambda inputs: {"force_N": 1.03 * inputs["force_N"]})
    assert before == pytest.approx(0.3 * math.sqrt(2))
    assert after == pytest.approx(0.03 * math.sqrt(2), rel=1e-6)


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


def test_calibration_error() -> None:
    """Bins of a tenth: (0.95: 1 of 2), (0.85: 2 of 2), (0.3: 1 of 2) of six answers."""
    bins = score.reliability(rows())
    assert [b.stated for b in bins] == pytest.approx([0.3, 0.85, 0.95])
    assert [b.share for b in bins] == [Share(1, 2), Share(2, 2), Share(1, 2)]
    assert score.calibration_error(rows()) == pytest.approx((2 * 0.2 + 2 * 0.15 + 2 * 0.45) / 6)


def test_calibration_error_of_exact_probabilities() -> None:
    """Two answers that state one half are off by one half, equally often as by nothing."""

    def stating(*probabilities: float) -> list[Row]:
        return [replace(rows()[0], probability=p) for p in probabilities]

    assert score.exact_calibration_error(stating(0.5, 0.5)) == pytest.approx((0.25, 0.5), abs=0.02)
    assert score.exact_calibration_error(stating(0.9))[0] == pytest.approx(0.9 * 0.1 + 0.1 * 0.9, abs=0.02)
    assert score.exact_calibration_error(stating(*[0.5] * 400))[1] < 0.06
    assert all(np.isnan(score.exact_calibration_error(stating(np.nan))))


def test_numbers() -> None:
    n = score.numbers(rows())
    assert n.shrink_median == pytest.approx(0.95)
    assert n.shrink_count == 3
    assert n.seconds_worst == 300.0


@pytest.mark.skipif(not SHARED.is_dir(), reason="needs the folder ../shared/cases")
def test_definitions_are_the_shared_scorer_s() -> None:
    shared = loaded(SHARED / "score.py")
    for label in ("none", "parameters", "~hum", "driver_lag", "driver_lag+backlash", "floor_mass@2"):
        verdict, effects = shared.truth(label)
        row = judged(label, answer("none"))
        assert (row.want, set(row.causes)) == (verdict, effects)


# --- page and command -------------------------------------------------------------------------------
def test_page(tmp_path: Path) -> None:
    report.write(tmp_path, rows(), "ab" * 32, {"nominal only": rows()[:3]})
    page, text = (tmp_path / "index.html").read_text(), (tmp_path / "results.md").read_text()
    assert "ab" * 32 in page
    assert "| single effects named | 1 | 3 | 0.333 |" in text
    assert "| nominal only |" in text
    names, columns, counts = report.confusion(rows())
    at = names.index("driver_lag")
    assert dict(zip(columns, counts[at], strict=True))["sensor_lag"] == 1
    assert sum(map(sum, counts)) == 6  # the pair is not in it
    assert (tmp_path / "rows.csv").read_text().count("\n") == 8


def test_misplaced_effect_is_not_on_the_diagonal() -> None:
    names, columns, counts = report.confusion([judged("floor_mass@2", answer("effect", "floor_mass@1"))])
    assert names == ["floor_mass"]
    assert dict(zip(columns, counts[0], strict=True)) == {"floor_mass": 0, "floor_mass, elsewhere": 1}


def test_failed_diagnosis_is_a_row(tmp_path: Path) -> None:
    (tmp_path / "case").mkdir()
    run.diagnose_one(tmp_path / "case", tmp_path / "answer", 60.0)
    row = run.judge("case", LABELS["case_001"], tmp_path / "answer", tmp_path / "none.npz")
    assert (row.verdict, row.right) == ("failed", False)
    assert row.error


def test_late_diagnosis_is_stopped(tmp_path: Path) -> None:
    (tmp_path / "case").mkdir()
    run.diagnose_one(tmp_path / "case", tmp_path / "answer", 0.01)
    told = json.loads((tmp_path / "answer" / "run.json").read_text())
    assert told["verdict"] == "timeout"
    assert told["seconds"] < 20


@pytest.mark.parametrize(
    ("arguments", "told"),
    [(["--cases", "0"], "--cases"), (["--seed", "-1"], "--seed"), (["--jobs", "0"], "--jobs")],
)
def test_bad_arguments(
    arguments: list[str], told: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([str(tmp_path / "out"), *arguments]) == 2
    assert told in capsys.readouterr().err


@pytest.mark.slow
def test_cases_are_sealed_and_gone_on_with(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "blind"
    arguments = [str(out), "--cases", "1", "--rig", "frame", "--cases-only", "--seed", "1"]
    assert main(arguments) == 0
    digest = (out / "labels.sha256").read_text().strip()
    assert digest in capsys.readouterr().out
    assert not (out / "labels.json").exists()
    assert main(arguments) == 0
    assert digest in capsys.readouterr().out
    other = [*arguments[:2], "2", *arguments[3:]]
    (out / "sealed" / "labels.sealed").unlink()
    assert main(other) == 2
    assert "another folder" in capsys.readouterr().err
