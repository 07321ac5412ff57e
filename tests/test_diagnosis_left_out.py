"""Data left out of a fit: whole records and folds, and the evidence that they give."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mrdamp.diagnosis.constants import CELL_SCALE
from mrdamp.diagnosis.evidence import judgement
from mrdamp.diagnosis.fits.least_squares import fit
from mrdamp.diagnosis.fits.left_out import cells, folds, predicted, ratio
from mrdamp.diagnosis.fits.search import Search
from mrdamp.diagnosis.hypotheses.terms import Hypothesis
from mrdamp.diagnosis.problem.residuals import Problem
from mrdamp.model.core import Array
from mrdamp.records import Record
from toy_rig import ToyRig, parts, toy


def test_folds_do_not_depend_on_the_order_of_the_files() -> None:
    rig = toy({"cubic": 0.3}, noise=0.3, records=7)

    def together(records: tuple[Record, ...]) -> set[frozenset[int]]:
        """Records, by their identity, that are left out in one go."""
        problem = Problem(replace(rig, records=records))
        return {
            frozenset(id(records[b.record]) for b in problem.blocks if mask[b.span].all()) for mask in folds(problem)
        }

    assert together(rig.records) == together(rig.records[::-1]) == together(rig.records[3:] + rig.records[:3])


@pytest.mark.parametrize("records", [3, 6])
def test_folds_are_predicted_from_all_other_samples(records: int) -> None:
    """The toy is linear in its terms: least squares over what is not left out, thirds in time or groups of records."""
    rig = toy({"cubic": 0.3, "offset": 0.1}, noise=0.3, records=records)
    problem = Problem(rig)
    hypothesis = Hypothesis((), tuple(t for t in rig.terms if t.effect in ("cubic", "offset")))
    found = fit(problem, hypothesis, hypothesis.start(), tolerance=1e-9)
    tables, rests, thirds = [], [], []
    for b in problem.blocks:
        take = problem.taken(b.record)
        made = {k: v[take] for k, v in parts(np.asarray(rig.records[b.record].displacement)).items()}
        n = b.span.stop - b.span.start
        scale = b.size * np.sqrt(n)
        tables.append(np.column_stack([made["cubic"], made["offset"]]) / scale)
        rests.append((rig.measured(b.record)[0, take] - 2 * made["gain"]) / scale)
        thirds.append(np.repeat([0, 1, 2], [-(-n // 3), -(-2 * n // 3) - -(-n // 3), n - -(-2 * n // 3)]))
    table, rest = np.vstack(tables), np.concatenate(rests)
    left = folds(problem)
    assert np.array_equal(np.sum(left, axis=0), np.ones(problem.samples))
    if records == 3:
        assert np.array_equal(np.argmax(left, axis=0), np.concatenate(thirds))
    else:
        assert len(left) == 4
        assert all(m[b.span].all() or not m[b.span].any() for m in left for b in problem.blocks)
    expected = np.empty(problem.samples)
    for mask in left:
        numbers = np.linalg.lstsq(table[~mask], rest[~mask])[0]
        expected[mask] = (table @ numbers - rest)[mask]
    assert predicted(problem, found, left) == pytest.approx(expected, abs=0.02 * np.abs(expected).max())


def test_a_cell_is_an_eighth_of_a_stroke_in_one_direction() -> None:
    """A triangle of eight units to and fro: each unit is an eighth of a stroke, in each direction one cell."""
    up = np.arange(0.5, 800.5) / 100
    x = np.tile(np.concatenate([up, up[::-1]]), 3)
    rig = ToyRig((Record("a", None, 0.01, {"displacement_m": x, "command": 0 * x, "force_N": x}),))
    problem = Problem(rig)
    cell = cells(problem)
    assert len(np.unique(cell)) == 16
    taken = problem.taken(0)
    unit, forward = np.floor(x).astype(int)[taken], (np.gradient(x) > 0)[taken]
    inner = (np.abs(x[taken] - np.round(x[taken])) > 0.2) & (np.arange(len(x))[taken] > 1600)
    where = {(u, f): set(cell[inner & (unit == u) & (forward == f)]) for u in range(8) for f in (True, False)}
    assert all(len(found) == 1 for found in where.values())
    assert len(set.union(*where.values())) == 16


def test_a_ratio_is_a_geometric_mean_over_cells_and_none_counts_without_limit() -> None:
    """By hand: reference squares 1 and 3; one is halved, the other is gone; the best fit leaves 2 and 6."""
    cell, before = np.array([0, 0, 1, 1]), np.array([1.0, -1.0, np.sqrt(3), np.sqrt(3)])
    after = np.array([np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0])
    best, scale = before * np.sqrt(2), 4 * CELL_SCALE
    expected = np.sqrt((0.5 + scale) / (1 + scale) * scale / (3 + scale))
    assert ratio(after, before, cell, best) == pytest.approx(np.sqrt(expected))  # two cells are shrunk to one half
    assert ratio(before, before, cell, best) == pytest.approx(1.0)


class CommandedToy(ToyRig):
    """The toy with a command of three levels along each record."""

    def conditions(self, record: int) -> dict[str, Array]:
        return {**super().conditions(record), "command": levels(self.records[record].n)}


def levels(n: int) -> Array:
    return np.asarray(np.arange(n) // 20 % 3, dtype=float)


@pytest.mark.parametrize(("cubic", "curve"), [(0.0, 0.4), (0.4, 0.4), (0.4, 0.0)])
def test_what_a_curve_of_the_command_explains_is_no_evidence_for_a_cause(cubic: float, curve: float) -> None:
    """The gain follows the square of the command, which the law lacks; a cubic term is there or not."""
    plain = toy({"cubic": cubic}, noise=0.02).records
    forces = [r.channel("force_N") + curve * levels(r.n) ** 2 * np.asarray(r.displacement) for r in plain]
    rig = CommandedToy(
        tuple(replace(r, channels={**r.channels, "force_N": f}) for r, f in zip(plain, forces, strict=True))
    )
    search = Search(Problem(rig), 1e-6)
    (term,) = (t for t in rig.terms if t.effect == "cubic")
    free = search.fitted(Hypothesis(rig.nominal, (term,)), np.zeros(2), most=9)
    search.keep(free)
    left = judgement.left_out_ratios(search, [search.base, free])[id(free)]
    alone = search.ratio(search.predicted(free), search.predicted(search.base))
    assert (left < 0.2) == bool(cubic)
    if curve:
        # Beside the curves nothing but noise is left where the cubic term is there, and where it is not.
        noise = sum(float(np.sum(0.02**2 * search.problem.weights[b.span] ** 2)) for b in search.problem.blocks)
        both = search.versions(free)[1][0]
        assert float(both @ both) == pytest.approx(noise, rel=0.15)
        assert float(search.predicted(free) @ search.predicted(free)) > 20 * noise
    else:
        assert left == pytest.approx(alone, rel=0.05)
