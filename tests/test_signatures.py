"""Signatures of loops against loops whose size is known, and against a measured clearance."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from mrdamp.diagnosis.constants import EVIDENCE_GAIN, STALL_GAIN
from mrdamp.diagnosis.fits.left_out import ratio
from mrdamp.diagnosis.fits.search import Search
from mrdamp.diagnosis.fits.stall import Stalls
from mrdamp.diagnosis.problem.residuals import Problem
from mrdamp.diagnosis.signatures.loops import Strokes, compared
from mrdamp.model.core import Array
from mrdamp.records import Record, read_record
from toy_rig import ToyRig

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
    assert Strokes.of([x]).stalls(loop(x, 100.0, gap=gap)) == pytest.approx(gap, abs=1.5e-4)


def test_preload_and_friction_are_read_from_the_strokes_of_both_directions() -> None:
    x = sine()
    strokes = Strokes.of([x, np.zeros(5), x[::-1]])
    up, down = strokes.levels(np.concatenate([loop(x, 80.0, preload=35.0), np.zeros(5), loop(x[::-1], 20.0)]))
    assert up == pytest.approx([115, np.nan, 20], nan_ok=True)
    assert down == pytest.approx([-45, np.nan, -20], nan_ok=True)
    assert list(strokes.record) == [0] * 9 + [2] * 9  # of five cycles: begun and ended between turns
    assert strokes.sizes == pytest.approx(0.02, rel=1e-3)


def test_a_rod_that_does_not_turn_twice_shows_nothing() -> None:
    x = np.linspace(0, 0.01, 500)
    assert Strokes.of([x]).stalls(x).size == 0
    assert compared([x], {kind: [x] for kind in ("measured", "nominal", "corrected")}) == ()


def test_what_a_law_without_the_clearance_lacks_by_hand() -> None:
    """3 mm of a stroke of 20 mm, of which .2 mm are not resolved; one record is worth a third."""
    x = sine()
    strokes, measured = Strokes.of([x]), loop(x, 100, gap=0.003)
    median, square = np.array([0.003]), np.array([0.0002**2])
    stalls = Stalls(strokes, measured, np.full(len(x), 0.5), median, square)
    without, within = (0.5 * (loop(x, 100, gap=gap) - measured) for gap in (0.0, 0.003))
    left = (0.04 / 9.04) ** (1 / 3)
    assert stalls.left(within, without) == pytest.approx(left, rel=0.05)
    travel, share = stalls.missed(without)
    assert travel == pytest.approx(0.003, abs=5e-5)
    assert share == pytest.approx(left, rel=0.05)


def test_a_travel_has_its_own_share_in_the_evidence() -> None:
    """As above, beside what the cells say."""
    x = sine()

    class Moved(ToyRig):
        def conditions(self, record: int) -> dict[str, Array]:
            return {"displacement (m)": x, "velocity (m/s)": np.gradient(x)}

    record = Record(
        "r", None, 0.01, {"displacement_m": x, "command": 0 * x, "force_N": loop(x, 100, gap=0.003)}
    )
    search = Search(Problem(Moved((record,))), 1e-6)
    within = np.zeros(search.problem.samples)
    without = (loop(x, 100) - record.channel("force_N"))[search.problem.taken(0)] * search.problem.weights
    alone = ratio(within, without, search.cells, search.versions(search.base, fitted=True)[-1][0])
    travel = (0.04 / 9.04) ** (1 / 3)
    assert search.ratio(within, without) == pytest.approx(
        alone * travel ** (STALL_GAIN / EVIDENCE_GAIN), rel=0.02
    )


def test_signatures_stand_side_by_side() -> None:
    x = sine()
    forces = {
        "measured": [loop(x, 100, gap=0.003)],
        "nominal": [loop(x, 100)],
        "corrected": [loop(x, 90, 5, 0.003)],
    }
    first, middle, force = compared([x], forces)
    assert first.unit == "mm"
    assert [first.measured, first.nominal] == pytest.approx([3, 0], abs=0.15)
    assert [middle.measured, middle.corrected] == pytest.approx([0, 5], abs=0.1)
    assert [force.nominal, force.corrected] == pytest.approx([100, 90])


@pytest.mark.skipif(not (DATA / "arts").is_dir(), reason="no measured records of the friction damper here")
def test_the_documented_clearance_of_a_friction_damper_is_seen() -> None:
    """A fit by hand gives 3.66 mm, at every frequency and stroke (shared/design/natural_gaps.md); a damper without a
    clearance has a hundredth of that."""

    def travel(file: Path) -> float:
        r = read_record(file)
        return float(
            np.median(Strokes.of([np.asarray(r.displacement)]).stalls(np.asarray(r.channel("force_N"))))
        )

    for file in sorted((DATA / "arts" / "train").glob("*.csv*")):
        assert travel(file) == pytest.approx(3.66e-3, rel=0.35)
    for file in sorted((DATA / "utfpr" / "train").glob("*V_ensaio.*")):
        assert travel(file) < 4e-4
