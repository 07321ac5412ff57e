"""Records that hardly move, or only for a while: where a single one is cut, and what a fit to such a one says."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from mrdamp.cli import main
from mrdamp.model.core import Array
from mrdamp.records import read_records
from mrdamp.records.motion import cut, path, share_of_stroke

DT = 0.002


def write(file: Path, x: Array, v: Array, seed: int = 0, noise: float = 2e-6) -> Path:
    """A Bingham damper's record with noise in displacement (2 um) and force (2 N), written out in NumPy."""
    rng, t = np.random.default_rng(seed), DT * np.arange(len(x))
    force = 300 * v + 200 * np.tanh(v / 0.01) + 15 + rng.normal(0, 2, len(t))
    columns = np.column_stack([t, x + rng.normal(0, noise, len(t)), np.full(len(t), 0.5), force])
    names = "time_s,displacement_m,command,force_N"
    np.savetxt(file, columns, delimiter=",", header=names, comments="", fmt="%.12g")
    return file


def burst(seconds: float, begin: float, end: float) -> tuple[Array, Array]:
    """At rest but for a burst of 2 Hz, whose displacement (m) and velocity (m/s) are given."""
    t = DT * np.arange(round(seconds / DT))
    size = np.where((t > begin) & (t < end), np.sin(math.pi * (t - begin) / (end - begin)) ** 2, 0.0)
    x = 0.01 * size * np.sin(4 * math.pi * (t - begin))
    return x, np.gradient(x, DT)


def identify(capsys: pytest.CaptureFixture[str], out: Path, *records: Path) -> tuple[int, str, str]:
    command = ["identify", *map(str, records), "--law", "bingham", "--starts", "1", "-o", str(out)]
    code = main(command)
    said = capsys.readouterr()
    return code, said.out, said.err


def test_path_counts_motion_and_not_noise() -> None:
    x = burst(9, 6.2, 8)[0] + np.random.default_rng(1).normal(0, 2e-6, 4500)
    travelled = path(x)
    assert travelled[3000] == 0.0
    assert travelled[-1] == travelled[4100]
    sine = np.sin(np.linspace(0, 20 * math.pi, 4000))
    assert path(sine)[-1] == pytest.approx(40, rel=0.03)
    assert cut(sine) == pytest.approx(4000 * 2 / 3, rel=0.02)
    assert cut(np.zeros(301)) == 200  # where nothing moves, in its time


@pytest.mark.parametrize(("begin", "end"), [(6.2, 8.0), (0.0, 2.0), (3.0, 5.0)])
def test_a_single_record_is_cut_where_both_parts_move(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], begin: float, end: float
) -> None:
    # Cut at two thirds of its time, the first of these was fitted at rest: errors of 5.59 and 0.998.
    file = write(tmp_path / "r.csv", *burst(9, begin, end), noise=0.0)
    parts = read_records(file)
    spans = [np.ptp(record.displacement) for record in parts]
    assert min(spans) > 0.3 * max(spans)
    code, out, _ = identify(capsys, tmp_path / "m.json", file)
    assert code == 0
    errors = out.splitlines()[1].replace(",", "").split()
    # Its own law: what is left is the force's noise, 2 N of 57 to 118 N.
    assert float(errors[2]) < 0.06
    assert float(errors[5]) < 0.06


@pytest.mark.parametrize(
    ("what", "said"),
    [
        ("ramp", "the loop never closes: the rod never turns back"),
        ("little", "too little motion: 0.0"),
        ("constant", "the force is constant but for its noise (1"),
    ],
)
def test_a_record_that_shows_no_law_gets_a_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], what: str, said: str
) -> None:
    t = DT * np.arange(4000)
    x = {"ramp": 2e-4 * t, "little": 4e-6 * np.sin(6 * t), "constant": 0.01 * np.sin(6 * t)}[what]
    file = write(tmp_path / "r.csv", x, np.zeros(len(t)))
    code, out, err = identify(capsys, tmp_path / "m.json", file)
    assert code == 2
    assert all(line.startswith("check: ") for line in out.splitlines())
    assert not (tmp_path / "m.json").exists()
    last = err.splitlines()[-1]
    assert last.startswith(f"mrdamp: {file}: the law explains this force no better than a constant")
    assert said in last


def test_held_out_records_that_say_nothing_get_a_sentence_and_no_table(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for half in ("train", "validation"):
        (tmp_path / half).mkdir()
    write(tmp_path / "train" / "a.csv", *burst(4, 0, 4))
    still = write(tmp_path / "validation" / "b.csv", np.zeros(2000), np.zeros(2000))
    code, out, _ = identify(capsys, tmp_path / "m.json", tmp_path)
    assert code == 0
    assert (tmp_path / "m.json").exists()
    assert "the held-out records do not judge it" in out
    assert f"{still}: the law explains this force worse than a constant" in out
    assert "held out" not in out


def test_the_share_of_a_stroke_grows_from_each_turn() -> None:
    """Over a triangle: up by 10, back by 10; a turn back by a hundredth of the range is none."""
    up = np.linspace(0, 10, 101)
    x = np.concatenate([up, up[::-1][1:]])
    share = share_of_stroke(x)
    assert share[:101] == pytest.approx(up / 10)
    assert share[125:] == pytest.approx(up[25:] / 10)
    bent = x.copy()
    bent[50] -= 0.2
    assert share_of_stroke(bent)[60:100] == pytest.approx(up[60:100] / 10)
