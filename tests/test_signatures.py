"""Signatures of loops against loops whose size is known, and against a measured clearance."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from mrdamp.diagnosis.signatures.loops import compared, midline, plateau, stall, strokes
from mrdamp.model.core import Array
from mrdamp.records import read_record

DATA = Path(os.environ.get("MRDAMP_DATA", Path(__file__).resolve().parents[2] / "shared" / "data"))


def sine(amplitude: float = 0.01, n: int = 4000, cycles: float = 5.0) -> Array:
    return np.asarray(amplitude * np.sin(2 * np.pi * cycles * np.arange(n) / n + 0.3))


def loop(x: Array, friction: float, preload: float = 0.0, gap: float = 0.0) -> Array:
    """Dry friction behind a clearance: no force for the travel `gap` after a turn, then all of it."""
    play = np.empty_like(x)
    play[0] = x[0]
    for k in range(1, len(x)):
        play[k] = min(max(play[k - 1], x[k] - gap / 2), x[k] + gap / 2)
    moved = np.concatenate([[0.0], np.diff(play)])
    return preload + friction * np.sign(np.round(moved, 12))


@pytest.mark.parametrize("gap", [0.0, 0.002, 0.005])
def test_a_clearance_is_the_travel_without_force(gap: float) -> None:
    x = sine()
    assert stall(x, loop(x, 100.0, gap=gap)) == pytest.approx(gap, abs=1.5e-4)


def test_preload_and_friction_are_read_from_the_middle_of_the_strokes() -> None:
    x = sine()
    f = loop(x, 80.0, preload=35.0)
    assert midline(x, f) == pytest.approx(35, abs=0.01)
    assert plateau(x, f) == pytest.approx(80, abs=0.01)
    assert len(list(strokes(x, f))) == 9  # of five cycles: begun and ended between turns


def test_a_rod_that_does_not_turn_twice_shows_nothing() -> None:
    x = np.linspace(0, 0.01, 500)
    assert np.isnan(stall(x, x))
    assert np.isnan(midline(x, x))
    assert compared([x], {kind: [x] for kind in ("measured", "nominal", "corrected")}) == ()


def test_signatures_stand_side_by_side() -> None:
    x = sine()
    forces = {"measured": [loop(x, 100, gap=0.003)], "nominal": [loop(x, 100)], "corrected": [loop(x, 90, 5, 0.003)]}
    first, middle, force = compared([x], forces)
    assert first.unit == "mm"
    assert [first.measured, first.nominal] == pytest.approx([3, 0], abs=0.15)
    assert [middle.measured, middle.corrected] == pytest.approx([0, 5], abs=0.1)
    assert [force.nominal, force.corrected] == pytest.approx([100, 90])


@pytest.mark.skipif(not (DATA / "arts").is_dir(), reason="no measured records of the friction damper here")
def test_the_documented_clearance_of_a_friction_damper_is_seen() -> None:
    """A fit by hand gives 3.66 mm, at every frequency and stroke (shared/design/natural_gaps.md); a damper without a
    clearance has a hundredth of that."""
    for file in sorted((DATA / "arts" / "train").glob("*.csv*")):
        r = read_record(file)
        assert 2.5e-3 < stall(np.asarray(r.displacement), np.asarray(r.channel("force_N"))) < 4e-3
    for file in sorted((DATA / "utfpr" / "train").glob("*V_ensaio.*")):
        r = read_record(file)
        assert stall(np.asarray(r.displacement), np.asarray(r.channel("force_N"))) < 4e-4
