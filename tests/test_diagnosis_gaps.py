"""Gaps of an answer against arithmetic by hand on what `mrdamp predict` writes, and what is told of effects."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bingham_rig import force, write_case
from mrdamp import cli
from mrdamp.diagnosis.case.folder import read_case
from mrdamp.diagnosis.report.sentence import table
from mrdamp.diagnosis.run import diagnose
from mrdamp.model.core import Array

#: s, sample time; m, step of the encoder.
DT, STEP = 0.004, 2e-5


def encoded(seed: int, amplitude: float, hz: float, u: float) -> dict[str, Array]:
    """A sine whose displacement is read in steps, with noise of the force."""
    t = DT * np.arange(800)
    angle = 2 * np.pi * hz * t
    v = amplitude * 2 * np.pi * hz * np.cos(angle)
    command = np.full(len(t), u)
    noise = np.random.default_rng(seed).normal(0, 2.0, len(t))
    steps = STEP * np.round(amplitude * np.sin(angle) / STEP)
    return {"time_s": t, "displacement_m": steps, "command": command, "force_N": force(v, command) + noise}


def by_hand(simulator: Path, records: list[Path], folder: Path) -> float:
    """RMS over records of the error over the force, without the first tenth of a second and the last eight samples."""
    squares = []
    for record in records:
        written = folder / "predicted.csv"
        assert cli.main(["predict", str(simulator), str(record), "-o", str(written)]) == 0
        made, true = (np.genfromtxt(f, delimiter=",", names=True)["force_N"] for f in (written, record))
        kept = slice(round(0.1 / DT), -8)
        squares.append(np.mean((made - true)[kept] ** 2) / np.mean(true[kept] ** 2))
    return float(np.sqrt(np.mean(squares)))


def test_what_is_not_fitted_has_one_figure_on_the_records_and_on_the_baseline(tmp_path: Path) -> None:
    """An encoder's steps are half of the file's gap; a search smoothes them away."""
    tests = [(0.01, 1.0, 0.0), (0.008, 1.4, 1.0), (0.005, 2.0, 0.5)]
    names = [f"{part}_{k}.csv" for part in ("now", "before") for k in range(3)]
    made = {name[:-4]: encoded(k, *tests[k % 3]) for k, name in enumerate(names)}
    folder = write_case(tmp_path / "case", made, records=names[:3], baseline=names[3:])
    halves = ([folder / name for name in some] for some in (names[:3], names[3:]))
    now, before = (by_hand(folder / "case.json", half, tmp_path) for half in halves)
    found = diagnose(read_case(folder))
    assert found.verdict == "none"
    assert found.gap.recalibrated < 0.7 * now
    assert found.gap.baseline == pytest.approx(before, rel=1e-4)
    assert found.gap.nominal == found.gap.corrected == found.gap.left_out == pytest.approx(now, rel=1e-4)
    assert {s.gap for s in found.waterfall if s.name in ("nominal", "unchanged")} == {found.gap.nominal}
    assert found.waterfall[0].interval == found.gap.interval
    assert [c.heldout_gap for c in found.candidates if not c.causes] == [found.gap.nominal]
    said = f"{100 * now:.1f} % on these records and {100 * before:.1f} % on the baseline's"
    assert said in found.sentence
    assert table(found).count(f"{100 * now:.1f} %") >= 3
