"""Fits: in rough runs they end where full runs alone would, along a number whose cost jumps, in threads."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from threading import Barrier

import numpy as np
import pytest

from mrdamp.diagnosis.fits.least_squares import Fit, fit
from mrdamp.diagnosis.hypotheses.terms import Coordinate, Hypothesis, Settings, Term
from mrdamp.diagnosis.problem.damper import DamperRig
from mrdamp.diagnosis.problem.residuals import Problem
from mrdamp.errors import InputError
from mrdamp.model import Model
from mrdamp.model.core import Array
from mrdamp.records import Record
from toy_rig import ToyRig, toy

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


def test_good_rough_runs_spare_full_ones() -> None:
    want, full = fitted()
    got, spared = fitted(1.02)
    assert spared.runs < 0.2 * full.runs
    assert got.cost == pytest.approx(want.cost, rel=5e-3)


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


def test_rough_runs_of_a_damper_stay_near_and_are_left_out_where_they_spare_nothing() -> None:
    rig = damper(0.002)
    rough = rig.rougher(())
    assert rough is not None
    assert rough.rougher(()) is None
    settings: list[Settings] = [{}, {"c0a": 1400.0}]
    full, near = (r.simulate(settings, 1, coarse=True) for r in (rig, rough))
    size = np.sqrt(np.mean(full[0] ** 2))
    apart = np.sqrt(np.mean((full - near) ** 2, axis=(1, 2))) / size
    assert np.all((apart > 1e-6) & (apart < 0.01))
    # What a coordinate does is told apart far better than that.
    signature = (full[1] - full[0]) - (near[1] - near[0])
    assert np.sqrt(np.mean(signature**2)) < 3e-3 * np.sqrt(np.mean((full[1] - full[0]) ** 2))
    np.testing.assert_array_equal(rig.simulate(settings, 1), rough.simulate(settings, 1))
    quick = damper(0.001)
    assert quick.rougher(()) is None
    mount = next(t for t in quick.terms if t.stage == "mount")
    assert quick.rougher((mount,)) is not None
    late = next(t for t in rig.terms if t.cause == "command_delay")
    assert rig.rougher((late,)) is None
    assert rig.rougher((late, mount)) is not None


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


def test_differences_over_a_small_step_would_not_find_it() -> None:
    assert jumped(replace(RUGGED, rugged=False), 0.15).cost > 3 * jumped(RUGGED, 0.15).cost


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


def test_a_record_that_is_refused_is_so_in_threads_too() -> None:
    alone = Together(toy({}).records)
    one, two = Problem(alone).outputs(SETTINGS), Problem(replace(alone, threads=2)).outputs(SETTINGS)
    np.testing.assert_array_equal(two, one)
    assert np.isnan(one[1]).any()
    assert not np.isnan(one[0]).any()
