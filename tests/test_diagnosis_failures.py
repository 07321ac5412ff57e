"""What goes wrong in a diagnosis is told in a line: ends of ranges, fits that fail."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mrdamp import cli
from mrdamp.commands import diagnosis as command
from mrdamp.diagnosis.case.folder import read_case
from mrdamp.diagnosis.fits import table
from mrdamp.diagnosis.fits.least_squares import Fit, fit
from mrdamp.diagnosis.fits.limits import Limits
from mrdamp.diagnosis.hypotheses.terms import Hypothesis
from mrdamp.diagnosis.problem.residuals import Problem
from mrdamp.diagnosis.run import diagnose
from mrdamp.model.core import Array
from mrdamp.records.csv_file import render

LAW = {"c0a": 700.0, "c0b": 800.0, "fya": 70.0, "fyb": 620.0, "v_ref": 0.03}
NONE = Limits(singles=0, forms=0, depth=1, polished=0)  # no effect is fitted


def bingham(x: Array, u: Array, dt: float, **changed: float) -> Array:
    """N, as the law's equation has it: dry friction of the field and a dashpot."""
    p = LAW | changed
    v = np.gradient(x, dt)
    return np.asarray((p["fya"] + p["fyb"] * u) * np.tanh(v / p["v_ref"]) + (p["c0a"] + p["c0b"] * u) * v)


def write(folder: Path, offset: float = 0.0, **changed: float) -> Path:
    """Three tests and a repeat, at constant and at changing commands."""
    folder.mkdir()
    rng, dt = np.random.default_rng(6), 0.002
    t: Array = np.linspace(0, 699 * dt, 700)
    tests = [
        (1.0, np.full(700, 0.2)),
        (2.2, np.full(700, 0.8)),
        (1.6, 0.5 + 0.4 * np.sin(9 * t)),
        (2.2, np.full(700, 0.8)),
    ]
    names = ["1_low.csv", "2_high.csv", "3_both.csv", "4_repeat.csv"]
    for name, (hz, u) in zip(names, tests, strict=True):
        x = 0.008 * np.sin(2 * np.pi * hz * t)
        force = bingham(x, u, dt, **changed) + offset + 3 * rng.standard_normal(700)
        columns: dict[str, Array] = {
            "time_s": t,
            "displacement_m": np.asarray(x),
            "command": u,
            "force_N": force,
        }
        (folder / name).write_text(render(columns))
    case: dict[str, Any] = {
        "name": "small", "format": 1, "rig": "damper", "sample_rate_hz": 500.0,
        "nominal": {"law": "bingham", "parameters": LAW},
        "channels": ["time_s", "displacement_m", "command", "force_N"], "records": names,
    }  # fmt: skip
    (folder / "case.json").write_text(json.dumps(case))
    return folder


def test_a_repeat_at_a_constant_command_belongs_to_the_test_with_that_command(tmp_path: Path) -> None:
    """Two tests with one motion at two commands: the repeat is of the one with its command."""
    folder = write(tmp_path / "case")
    low, high = (folder / name for name in ("1_low.csv", "2_high.csv"))
    t: Array = np.linspace(0, 1.398, 700)
    x = 0.008 * np.sin(2 * np.pi * 2.2 * t)
    force = bingham(x, np.full(700, 0.2), 0.002)
    low.write_text(
        render({"time_s": t, "displacement_m": np.asarray(x), "command": np.full(700, 0.2), "force_N": force})
    )
    assert high.is_file()
    assert [k for _, k in read_case(folder).repeats] == [1]


def test_a_parameter_at_the_end_of_its_range_is_told(tmp_path: Path) -> None:
    found = diagnose(read_case(write(tmp_path / "case", fyb=620.0 * 12)), limits=NONE)
    assert any(n.startswith("fyb is at a limit of its range") for n in found.notes), found.notes
    low, high = found.intervals["fyb"]
    assert high == pytest.approx(8 * 620.0)
    assert low <= high


def test_a_fit_that_fails_is_told_and_the_others_go_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(problem: Problem, hypothesis: Hypothesis, *a: Any, **more: Any) -> Fit:
        if "trapped_gas" in hypothesis.causes:
            raise np.linalg.LinAlgError("singular matrix")
        return fit(problem, hypothesis, *a, **more)

    monkeypatch.setattr(table, "fit", fails)
    found = diagnose(
        read_case(write(tmp_path / "case", offset=60.0)), limits=Limits(singles=20, forms=1, depth=1)
    )
    failed = [n for n in found.notes if "failed" in n]
    assert failed
    for note in failed:
        assert note.startswith("trapped_gas")
        assert note.endswith("the fit failed (singular matrix)")
    assert found.gap.corrected < 0.2 * found.gap.nominal


def test_an_interrupt_is_one_line_and_leaves_no_answer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def stop(what: str, share: float) -> None:
        if share >= 0.05:
            raise KeyboardInterrupt

    monkeypatch.setattr(command, "show_progress", stop)
    out = tmp_path / "out"
    assert cli.main(["diagnose", str(write(tmp_path / "case")), "-o", str(out), "--jobs", "1"]) == 130
    assert capsys.readouterr().err == "mrdamp: interrupted; run the same command again\n"
    assert list(out.iterdir()) == []
