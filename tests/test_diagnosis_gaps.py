"""Gaps of an answer against arithmetic by hand on what `mrdamp predict` writes, and what is told of effects."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from bingham_rig import force, write_case
from mrdamp import cli
from mrdamp.diagnosis.case.folder import read_case
from mrdamp.diagnosis.form import form_of
from mrdamp.diagnosis.report.sentence import table
from mrdamp.diagnosis.run import diagnose
from mrdamp.identify import identify
from mrdamp.model.core import Array
from mrdamp.records import Record

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


def lagging(seed: int, amplitude: float, hz: float, level: float | None) -> Record:
    """Six seconds of a damper whose viscosity bends, with a driver's lag of 30 ms and 40 N of friction; a level of None
    stands for steps."""
    rng = np.random.default_rng(seed)
    t = DT * np.arange(1500)
    x = amplitude * (np.sin(2 * np.pi * hz * t) + 0.2 * np.sin(2 * np.pi * 0.37 * hz * t + 1))
    v = np.gradient(x, DT)
    levels = rng.choice([0.0, 0.3, 0.6, 1.0], 24)
    u = levels[(t / 0.25).astype(int)] if level is None else np.full(len(t), level)
    left = np.exp(-DT / 0.03)
    current = lfilter([1 - left], [1, -left], u, zi=[left * u[0]])[0]
    made = (380 + 320 * current) * np.sign(v) * np.abs(v) ** 0.72 + (45 + 400 * current) * np.tanh(v / 0.01)
    made += 40 * np.tanh(v / 0.0008) + rng.normal(0, 2, len(t))
    return Record(f"r{seed}", None, DT, {"displacement_m": x, "command": u, "force_N": made})


@pytest.mark.slow
def test_every_effect_that_a_file_gains_is_told_with_its_numbers() -> None:
    tests = [(0.01, 1.0, None), (0.006, 2.5, None), (0.01, 1.3, 0.0), (0.008, 1.5, 1.0), (0.012, 0.8, 0.5)]
    records = [lagging(k, *test) for k, test in enumerate(tests)]
    alone = identify("bingham", records, starts=1).model
    form = form_of(alone, records)
    added = {e.name: e.parameters for e in form.model.effects if e.name not in {own.name for own in alone.effects}}
    assert set(added) == {"driver_lag", "seal_friction"}
    assert 0 < form.beside["seal_friction"] < 0.9
    told = "\n".join(form.lines())
    for name, parameters in added.items():
        (line,) = (line for line in form.lines() if line.startswith(f"  {name}: "))
        assert all(f"{k} = {v:.4g}" in line for k, v in parameters.items())
    assert f"it leaves {100 * form.beside['seal_friction']:.0f} % of that" in told
