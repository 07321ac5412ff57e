"""Fits and a search of causes on the toy: rough runs, rugged numbers, threads, forms of causes, the last fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from threading import Barrier

import numpy as np
import pytest

from mrdamp.diagnosis.attribution.stages import Changes, stage_shares
from mrdamp.diagnosis.fits import alternative_forms, screening
from mrdamp.diagnosis.fits.final import final_fit, least_left_out
from mrdamp.diagnosis.fits.least_squares import Fit, fit
from mrdamp.diagnosis.fits.limits import Limits
from mrdamp.diagnosis.fits.search import Search
from mrdamp.diagnosis.hypotheses.terms import Coordinate, Hypothesis, Settings, Term
from mrdamp.diagnosis.problem.damper import DamperRig
from mrdamp.diagnosis.problem.residuals import Problem
from mrdamp.errors import InputError
from mrdamp.model import Model
from mrdamp.model.core import Array
from mrdamp.records import Record
from toy_rig import ToyRig, search_of, toy

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


def fitted(factor: float | None = None, square: float = 0.0, foreign: float = 0.0) -> tuple[Fit, Problem]:
    plain = toy(TRUTH)
    rough = None if factor is None else Bent(plain.records, factor=factor, square=square, foreign=foreign)
    rig = Stepped(plain.records, rough=rough)
    hypothesis = Hypothesis(rig.nominal, tuple(t for t in rig.terms if t.effect in ("cubic", "sign")))
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
    got, problem = fitted(factor, square, foreign)
    assert got.cost == pytest.approx(want.cost, rel=0.02)
    np.testing.assert_allclose(got.point, want.point, atol=0.15)
    # What is told of the fit is the full run's.
    np.testing.assert_array_equal(got.residual, problem.residuals(got.hypothesis, got.point)[0])
    assert got.cost == float(got.residual @ got.residual)


LAW = {"c0a": 700.0, "c0b": 800.0, "alpha_a": 9e3, "alpha_b": 3e4, "k0": 900.0, "x0": 0.0, "k1": 400.0}
LAW |= {"c1a": 2e4, "c1b": 5e4, "gamma": 2e6, "beta": 2e6, "A": 120.0, "n": 2.0}


def damper(sample_time: float, threads: int = 1) -> DamperRig:
    """A damper on a machine: two sines, the command a ramp."""
    t = sample_time * np.arange(600)
    model, records = Model("modified_bouc_wen", LAW), []
    for k in range(2):
        channels = {
            "displacement_m": 8e-3 * np.sin(2 * np.pi * (k + 1) * t),
            "command": np.linspace(0, 1, 600),
        }
        force = model.simulate(sample_time, channels)["force_N"]
        records.append(Record(f"{k}", None, sample_time, channels | {"time_s": t, "force_N": 1.1 * force}))
    return DamperRig(model, tuple(records), threads=threads)


def test_threads_change_nothing() -> None:
    settings: list[Settings] = [{"c0a": c} for c in (500.0, 700.0, 900.0, 1100.0, 1300.0)]
    one, three = (damper(0.002, threads).simulate(settings, 0, coarse=True) for threads in (1, 3))
    np.testing.assert_array_equal(one, three)


@pytest.mark.parametrize("square", [0.0, 0.05])
def test_what_is_told_of_a_fit_that_looked_along_rugged_coordinates_is_the_full_runs(square: float) -> None:
    plain = toy(TRUTH)
    rig = Stepped(plain.records, rough=Bent(plain.records, factor=1.05, square=square))
    terms = []
    for term in (t for t in rig.terms if t.effect in ("cubic", "sign")):
        terms.append(replace(term, coordinates=tuple(replace(c, rugged=True) for c in term.coordinates)))
    hypothesis, problem = Hypothesis(rig.nominal, tuple(terms)), Problem(rig, coarse=True)
    for most in (3, 6, 20):
        got = fit(problem, hypothesis, hypothesis.start(), most=most, tolerance=1e-2)
        np.testing.assert_array_equal(got.residual, problem.residuals(hypothesis, got.point)[0])
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


SETTINGS: list[Settings] = [{"gain": 2.2}, {"gain": 2.2, "cubic": 0.3}]


@dataclass(frozen=True)
class Together(ToyRig):
    """A toy whose records are only simulated two at a time."""

    barrier: Barrier | None = None

    def simulate(self, settings: Sequence[Settings], record: int, *, coarse: bool = False) -> Array:
        if self.barrier is not None:
            self.barrier.wait(timeout=20)
        if record == 4 and "cubic" in settings[-1]:
            raise InputError("not this one")
        return super().simulate(settings, record)


def test_records_are_simulated_side_by_side_with_the_same_outcome() -> None:
    alone = Together(toy({}).records)
    both = replace(alone, threads=2, barrier=Barrier(2))
    one, two = Problem(alone), Problem(both)
    np.testing.assert_array_equal(two.of_settings(SETTINGS[:1]), one.of_settings(SETTINGS[:1]))
    assert two.runs == one.runs == len(alone.records)


NOISE = 0.005


def of_term(search: Search, name: str, *, free: bool = False, most: int = 12) -> Fit:
    """A fit of one term from a small start, kept in the table."""
    rig = search.problem.rig
    hypothesis = Hypothesis(rig.nominal if free else (), tuple(t for t in rig.terms if t.name == name))
    search.keep(fit(search.problem, hypothesis, hypothesis.start(), most=most))
    return search.fits[hypothesis.key]


@pytest.mark.parametrize(("established", "parent"), [("late", "late"), ("cubic", "cubic")])
def test_a_cause_that_channels_establish_is_extended_first_beside_a_wrong_law(
    established: str, parent: str
) -> None:
    search = Search(Problem(toy({"cubic": 0.6, "late": 6.0, "outside": 0.3})), 1e-6)
    search.direct = {established: 100.0}
    search.extend(False, 1)
    assert search.inexact
    search.extend(False, 2, Limits(beam=1, additions=1))
    (pair,) = (f.hypothesis.causes for f in search.ranked(False) if len(f.hypothesis.causes) == 2)
    assert pair[0] == parent


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
    found = Changes.of(search, chosen).table.sum(axis=0)
    assert found / found.sum() == pytest.approx(expected / expected.sum(), abs=0.02)
    assert found[0] > 10 * found[1]
