"""Fits and a search of causes on the toy: rough runs, rugged numbers, forms of causes; and data left out of a fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pytest
from numpy.typing import NDArray

from mrdamp.diagnosis.attribution.stages import changes, stage_shares
from mrdamp.diagnosis.evidence import judgement
from mrdamp.diagnosis.fits import alternative_forms, screening
from mrdamp.diagnosis.fits.final import final_fit, least_left_out
from mrdamp.diagnosis.fits.least_squares import Fit, fit
from mrdamp.diagnosis.fits.left_out import Curves, folds, predicted
from mrdamp.diagnosis.fits.search import Search
from mrdamp.diagnosis.hypotheses.terms import Coordinate, Hypothesis, Settings, Term
from mrdamp.diagnosis.problem.residuals import Problem
from mrdamp.model.core import Array
from mrdamp.records import Record
from toy_rig import ToyRig, parts, search_of, toy

TRUTH = {"gain": 2.3, "cubic": 0.4, "sign": 0.3}


@dataclass(frozen=True)
class Bent(ToyRig):
    """The toy as longer steps may see it: a factor, a part of the square, noise that has nothing to do with it."""

    factor: float = 1.0
    square: float = 0.0
    foreign: float = 0.0

    def simulate(self, settings: Sequence[Settings], record: int, *, coarse: bool = False) -> Array:
        out = super().simulate(settings, record)
        noise = np.random.default_rng(7).standard_normal(out.shape[-1])
        return np.asarray(self.factor * out + self.square * out**2 + self.foreign * noise)


@dataclass(frozen=True)
class Stepped(ToyRig):
    """A toy with rough runs."""

    rough: ToyRig | None = None

    def rougher(self, terms: Sequence[Term]) -> ToyRig | None:
        return self.rough


def fitted(
    factor: float | None = None, square: float = 0.0, foreign: float = 0.0, rugged: bool = False
) -> tuple[Fit, Problem]:
    plain = toy(TRUTH)
    rough = None if factor is None else Bent(plain.records, factor=factor, square=square, foreign=foreign)
    rig = Stepped(plain.records, rough=rough)
    terms = []
    for term in (t for t in rig.terms if t.effect in ("cubic", "sign")):
        terms.append(replace(term, coordinates=tuple(replace(c, rugged=rugged) for c in term.coordinates)))
    hypothesis = Hypothesis(rig.nominal, tuple(terms))
    problem = Problem(rig, coarse=True)
    return fit(problem, hypothesis, hypothesis.start(), most=20, tolerance=1e-4), problem


@pytest.mark.parametrize(
    ("factor", "square", "foreign"),
    [
        (1.05, 0.0, 0.0),
        (1.0, 0.05, 0.0),
        (1.0, 0.0, 0.2),  # what is off by a constant is taken off wholly
        (1.3, 0.2, 1.0),
        (-1.0, 0.0, 0.0),  # leads the wrong way
    ],
)
def test_rough_runs_end_where_full_ones_do(factor: float, square: float, foreign: float) -> None:
    want, _ = fitted()
    got, _ = fitted(factor, square, foreign)
    assert got.cost == pytest.approx(want.cost, rel=0.02)
    np.testing.assert_allclose(got.point, want.point, atol=0.15)


@pytest.mark.parametrize("rugged", [False, True])
def test_what_is_told_of_a_fit_is_the_full_runs(rugged: bool) -> None:
    got, problem = fitted(1.05, 0.05, rugged=rugged)
    np.testing.assert_array_equal(got.residual, problem.residuals(got.hypothesis, got.point)[0])
    assert got.cost == float(got.residual @ got.residual)


LEVEL, LOST = 0.4, 0.7
RUGGED = Coordinate("level", 0.1, 0.02, 1.0, 2.0, log=True, rugged=True)


@dataclass(frozen=True)
class Jumping(ToyRig):
    """The toy, whose force falls by a share where the displacement is above a level."""

    def simulate(self, settings: Sequence[Settings], record: int, *, coarse: bool = False) -> Array:
        x = np.asarray(self.records[record].displacement)
        above = np.array([[x > s.get("level", 2.0)] for s in settings])
        lost = np.array([s.get("lost", 0.0) for s in settings])[:, None, None]
        law = [{k: v for k, v in s.items() if k not in ("level", "lost")} for s in settings]
        return np.asarray(super().simulate(law, record) * (1 - lost * above))


def jumping() -> Jumping:
    plain = toy({}, noise=0.0)
    rig, noise = Jumping(plain.records), np.random.default_rng(2)
    made = []
    for k, record in enumerate(plain.records):
        force = rig.simulate([{"level": LEVEL, "lost": LOST}], k)[0, 0]
        channels = dict(record.channels) | {"force_N": force + 0.02 * noise.standard_normal(record.n)}
        made.append(replace(record, channels=channels))
    return Jumping(tuple(made))


def jumped(level: Coordinate, start: float) -> Fit:
    rig = jumping()
    term = Term("lost", "fluid", (Coordinate("lost", 0.0, 0.0, 1.0, 0.1), level), ((0.3, start),))
    hypothesis = Hypothesis(rig.nominal, (term,))
    return fit(Problem(rig), hypothesis, hypothesis.start(), most=15)


@pytest.mark.parametrize("start", [0.05, 0.15, 0.9])
def test_a_rugged_number_is_found_from_afar(start: float) -> None:
    found = jumped(RUGGED, start)
    assert found.settings["level"] == pytest.approx(LEVEL, rel=0.02)
    assert found.settings["lost"] == pytest.approx(LOST, rel=0.02)
    assert found.settings["gain"] == pytest.approx(2.0, rel=0.02)


NOISE = 0.005


def of_term(search: Search, name: str, *, free: bool = False, most: int = 12) -> Fit:
    """A fit of one term from a small start, kept in the table."""
    rig = search.problem.rig
    hypothesis = Hypothesis(rig.nominal if free else (), tuple(t for t in rig.terms if t.name == name))
    search.keep(fit(search.problem, hypothesis, hypothesis.start(), most=most))
    return search.fits[hypothesis.key]


@dataclass(frozen=True)
class Formed(ToyRig):
    """The toy with a cubic that may be of the fifth power."""

    @property
    def terms(self) -> tuple[Term, ...]:
        fifth = Coordinate("fifth", 0.0, -50.0, 50.0, 0.1)
        return (*super().terms, Term("cubic", "fluid", (fifth,), ((0.2,),), form="fifth"))


@pytest.mark.parametrize(("truth", "name"), [({"cubic": 0.4}, "cubic"), ({"fifth": 0.4}, "cubic:fifth")])
def test_the_better_form_of_a_cause_stands(truth: Settings, name: str) -> None:
    search = search_of(Formed(toy(truth, NOISE).records), NOISE)
    screening.screen(search, search.base, search.problem.rig.terms)
    alternative_forms.reform(search, of_term(search, "cubic"))
    best = search.best(False)
    assert best is not None
    assert best.hypothesis.name == name
    assert "cubic:fifth" in {f.hypothesis.name for f in search.fits.values()}


def test_a_fit_that_was_broken_off_is_continued() -> None:
    search = search_of(toy({"sign": 0.6}, NOISE), NOISE)
    begun = of_term(search, "sign", most=0)
    object.__setattr__(begun, "converged", False)
    assert begun.settings["sign"] != pytest.approx(0.6, abs=0.05)
    final = final_fit(search, begun)
    assert final.fit.settings["sign"] == pytest.approx(0.6, abs=0.01)
    assert np.all(final.heldout < 0.1 * search.problem.gaps(search.residual))


@pytest.mark.parametrize(("gain", "free"), [(2.0, False), (2.4, True)])
def test_parameters_are_freed_where_left_out_records_need_it(gain: float, free: bool) -> None:
    search = search_of(toy({"sign": 0.6, "gain": gain}, NOISE), NOISE)
    held = of_term(search, "sign")
    of_term(search, "sign", free=True)
    assert bool(least_left_out(search, held).hypothesis.nominal) == free


def test_a_free_law_gets_what_it_changed_and_not_what_it_could_take() -> None:
    """Alone the gain takes up nearly all of a cubic part; beside the cause it moves little, and that is its share."""
    rig = toy({"cubic": 0.5, "gain": 2.02}, NOISE)
    search = search_of(rig, NOISE)
    problem = search.problem
    chosen = of_term(search, "cubic", free=True)
    assert search.base.cost < 0.3 * search.nominal_cost  # alone, the law does most of it
    shares, _ = stage_shares(search, chosen, "effect")
    assert shares["fluid"] == pytest.approx(1.0)  # the toy's cubic part and the law are of one stage
    x = np.concatenate([np.asarray(rig.records[k].displacement)[problem.taken(k)] for k in problem.records])
    cubic, gain = 0.5 * x**3 * problem.weights, 0.02 * x * problem.weights
    expected = np.array([cubic @ (cubic + gain), gain @ (cubic + gain)])
    found = changes(search, chosen).sum(axis=0)
    assert found / found.sum() == pytest.approx(expected / expected.sum(), abs=0.02)
    assert found[0] > 10 * found[1]


# --- data left out of a fit -------------------------------------------------------------------------------
def linear(records: int) -> tuple[Problem, Fit, Array, Array]:
    """A toy that is linear in its terms, fitted; the matrix (samples, 2) and the right side of its least squares."""
    rig = toy({"cubic": 0.3, "offset": 0.1}, noise=0.3, records=records)
    problem = Problem(rig)
    hypothesis = Hypothesis((), tuple(t for t in rig.terms if t.effect in ("cubic", "offset")))
    found = fit(problem, hypothesis, hypothesis.start(), tolerance=1e-9)
    tables, rests = [], []
    for b in problem.blocks:
        take = problem.taken(b.record)
        made = {k: v[take] for k, v in parts(np.asarray(rig.records[b.record].displacement)).items()}
        scale = b.size * np.sqrt(b.span.stop - b.span.start)
        tables.append(np.column_stack([made["cubic"], made["offset"]]) / scale)
        rests.append((rig.measured(b.record)[0, take] - 2 * made["gain"]) / scale)
    return problem, found, np.vstack(tables), np.concatenate(rests)


def without(mask: NDArray[np.bool_], table: Array, rest: Array) -> Array:
    """Errors of the samples in the mask, predicted by least squares over all others."""
    numbers = np.linalg.lstsq(table[~mask], rest[~mask])[0]
    return np.asarray((table @ numbers - rest)[mask])


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
    """What is left out: thirds in time, or groups of records."""
    problem, found, table, rest = linear(records)
    left = folds(problem)
    assert np.array_equal(np.sum(left, axis=0), np.ones(problem.samples))
    if records == 3:
        lengths = [b.span.stop - b.span.start for b in problem.blocks]
        thirds = [np.repeat([0, 1, 2], np.diff([-(-k * n // 3) for k in range(4)])) for n in lengths]
        assert np.array_equal(np.argmax(left, axis=0), np.concatenate(thirds))
    else:
        assert len(left) == 4
        assert all(m[b.span].all() or not m[b.span].any() for m in left for b in problem.blocks)
    expected = np.empty(problem.samples)
    for mask in left:
        expected[mask] = without(mask, table, rest)
    assert predicted(problem, found, left) == pytest.approx(expected, abs=0.02 * np.abs(expected).max())


@pytest.mark.parametrize(("slope", "left"), [(1.0, 0.0), (0.2, 0.0), (-0.2, 1.0)])
def test_no_step_makes_the_kept_records_worse(slope: float, left: float) -> None:
    """With a fifth of the true slope a step is five times too long: a quarter of it leaves a quarter of the error, and
    four of them less than a hundredth. With a slope of the wrong sign no step is taken."""
    problem = Problem(toy({"offset": 1.0}, noise=0.0))
    hypothesis = Hypothesis((), (Term("offset", "sensor", (Coordinate("offset", 0.0, -50.0, 50.0, 1.0),), ((0.0,),)),))
    residual = problem.residuals(hypothesis, np.zeros(1))[0]
    slopes = slope * problem.jacobian(hypothesis, np.zeros(1), residual)
    found = Fit(hypothesis, np.zeros(1), float(residual @ residual), residual, slopes)
    ratio = np.linalg.norm(predicted(problem, found, folds(problem))) / np.linalg.norm(residual)
    assert ratio == pytest.approx(left, abs=0.02)


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


@pytest.mark.parametrize(("before", "left"), [((1.0, 0.8), 0.5 * 1.35), ((1.0, 0.4), 0.5 / 0.4)])
def test_curves_pay_for_their_numbers(
    before: tuple[float, float], left: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Mean squares without and with 20 numbers of curves, which cost exp(.45 x 20 / 30) = 1.35: a fit goes from 0.9 to
    0.5. One that they take from 1.0 to 0.8 is better without them, one that they take to 0.4 with them."""
    search = search_of(toy(TRUTH))
    n = search.problem.samples
    search.curves = Curves(np.zeros((n, 20)), np.ones(20))
    squares = {"found": (0.9, 0.5), "before": before}
    monkeypatch.setattr(
        Search, "versions", lambda _, of: [(np.full(n, s), c) for s, c in zip(squares[of], (False, True), strict=True)]
    )
    search.residual = np.ones(n)
    monkeypatch.setattr(Search, "ratio", lambda _, own, other: own[0] / other[0])
    assert search.remains("found", "before") == pytest.approx(left, rel=1e-3)  # type: ignore[arg-type]
