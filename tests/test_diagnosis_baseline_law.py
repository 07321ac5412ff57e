"""The law identified again on the rig's baseline.

The rig is a Bouc-Wen damper whose hysteretic force bends with the current, integrated by SciPy, with noise. Its
simulator has straight lines.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import lfilter

from mrdamp.diagnosis import damper_run
from mrdamp.diagnosis.answer import beside_given
from mrdamp.diagnosis.case.folder import Case
from mrdamp.diagnosis.problem import baseline_law as module
from mrdamp.diagnosis.problem.baseline_law import BaselineLaw, baseline_law
from mrdamp.diagnosis.problem.damper import DamperRig
from mrdamp.diagnosis.problem.noise import channel_noise
from mrdamp.diagnosis.report.result import Diagnosis, Gap
from mrdamp.diagnosis.run import diagnose
from mrdamp.diagnosis.signatures.loops import compared
from mrdamp.errors import InputError
from mrdamp.identify import identify
from mrdamp.identify.laws import DEPENDENCES, Scales
from mrdamp.model import Effect, Model
from mrdamp.model.core import Array
from mrdamp.records import Record

DT = 0.002
#: Amplitude (m), frequency (Hz) and command of a test.
TESTS = [
    (0.008, 1.1, 0.0), (0.008, 1.1, 1.0), (0.014, 0.8, 0.35), (0.005, 2.3, 0.6), (0.011, 1.6, -1.0), (0.006, 1.9, -1.0)
]  # fmt: skip


def record(name: str, test: tuple[float, float, float], seed: int, *, lag: float = 0.0) -> Record:
    """Three seconds; a command below 0 stands for steps between levels."""
    amplitude, hz, level = test
    rng = np.random.default_rng(seed)
    t = DT * np.arange(1500)
    x = amplitude * (np.sin(2 * np.pi * hz * t) + 0.2 * np.sin(2 * np.pi * 0.41 * hz * t + 1 + seed))
    v = np.gradient(x, DT)
    u = np.full(len(t), level)
    if level < 0:
        u = rng.choice([0.0, 0.25, 0.5, 0.75, 1.0], 12)[np.minimum((t / 0.25).astype(int), 11)]
    current = u
    if lag:
        a = np.exp(-DT / lag)
        current = np.asarray(lfilter([1 - a], [1, -a], u, zi=[a * u[0]])[0])

    def rate(when: float, z: Array) -> Array:
        w = np.interp(when, t, v)
        return np.asarray(1500.0 * w - 650.0 * np.abs(w) * z - 350.0 * w * np.abs(z))

    z = solve_ivp(rate, (0, t[-1]), [0.0], t_eval=t, max_step=DT, rtol=1e-6).y[0]
    force = (500 + 400 * current) * v + (60 + 620 * current**0.55) * z + 20
    force = force + rng.normal(0, 2.0, len(t))
    return Record(name, None, DT, {"displacement_m": x, "command": u.astype(float), "force_N": force})


@cache
def baseline() -> tuple[Record, ...]:
    return tuple(record(f"baseline_{k}", test, 20 + k) for k, test in enumerate(TESTS))


@cache
def records(lag: float = 0.0) -> tuple[Record, ...]:
    return tuple(record(f"test_{k}", test, 40 + k, lag=lag) for k, test in enumerate(TESTS))


@cache
def lines() -> Model:
    """The simulator that was commissioned with straight lines."""
    fit = identify("bouc_wen", baseline(), dependence="linear", starts=2, threads=1)
    return replace(fit.model, name="nominal")


def rig(model: Model, lag: float = 0.0) -> DamperRig:
    return DamperRig(model, records(lag)).with_motion()


@pytest.mark.slow
def test_a_law_with_a_curve_is_found_on_the_baseline(monkeypatch: pytest.MonkeyPatch) -> None:
    fitted: list[tuple[Model, set[str]]] = []
    judged: list[tuple[Model, set[str]]] = []
    own_gap = module.gap_of

    def fit(law: str, some: Sequence[Record], **options: Any) -> Any:
        made = identify(law, some, **options)
        fitted.append((made.model, {r.name for r in some}))
        return made

    def gap(given: DamperRig, model: Model, some: Sequence[Record]) -> float:
        judged.append((model, {r.name for r in some}))
        return own_gap(given, model, some)

    monkeypatch.setattr(module, "identify", fit)
    monkeypatch.setattr(module, "gap_of", gap)
    found = baseline_law(rig(lines()), baseline())
    # Each half is judged by the fit to the other one.
    halves = [(model, names) for model, names in fitted if len(names) < len(baseline())]
    assert len(halves) == 2
    for model, names in halves:
        seen = [other for one, other in judged if one.parameters == model.parameters]
        assert len(seen) == 1
        assert not names & seen[0]
        assert len(names | seen[0]) == len(baseline())
    assert found is not None
    assert found.given is not found.model
    assert found.model.name == "nominal"
    assert found.after < 0.5 * found.before
    assert f"{100 * found.after:.1f} %" in found.note()


@pytest.mark.slow
def test_a_simulator_is_kept_if_nothing_is_gained_or_cannot_be_tried() -> None:
    few, unfitted = baseline()[:3], replace(lines(), effects=(Effect("moving_mass", {"m": 1.0}),))
    assert baseline_law(rig(lines()), few) is None
    cell_only = tuple(
        Record(r.name, None, DT, {k.replace("force_N", "reference_force_N"): v for k, v in r.channels.items()})
        for r in baseline()
    )
    assert baseline_law(rig(lines()), cell_only) is None
    assert baseline_law(rig(unfitted), baseline()) is None
    best = identify("bouc_wen", baseline(), dependence="quadratic_saturating", starts=2, threads=1).model
    assert baseline_law(rig(best), baseline()) is None


@pytest.mark.slow
def test_a_law_is_not_extrapolated_to_commands_that_the_baseline_lacks() -> None:
    low = [r for r in baseline() if r.command.max() < 0.9]
    low += [Record(f"{r.name} again", None, DT, r.channels) for r in low]
    assert len(low) >= 4
    assert baseline_law(rig(lines()), low) is None
    within = [r for r in records() if r.command.max() < 0.9]
    assert baseline_law(DamperRig(lines(), tuple(within)).with_motion(), low) is not None


@pytest.mark.parametrize(("found", "left"), [(0.3, 0.2), (0.1, 0.1)])
def test_the_given_simulator_is_handed_over_where_the_law_of_the_baseline_predicts_worse(
    found: float, left: float
) -> None:
    given, other = lines(), replace(lines(), name="found")
    again = BaselineLaw(given, other, "linear", 0.2, 0.1, 0.15)
    model, gap = beside_given(again, other, Gap(0.5, 0.4, found, 0.0, (0.0, 1.0), left_out=found), 0.2)
    assert model is (given if found > 0.2 else other)
    assert (gap.nominal, gap.corrected, gap.left_out, gap.baseline) == (0.2, left, left, 0.15)


def test_the_dependence_on_the_command_is_one_that_each_half_shows(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever the order of the files: four constant commands are two in each half, with steps there are more."""
    asked: list[str] = []

    def fit(law: str, some: Sequence[Record], *, dependence: str, **_: Any) -> Any:
        asked.append(dependence)
        raise InputError(f"{law} of {len(some)}")

    monkeypatch.setattr(module, "identify", fit)
    given, constant = rig(lines()), baseline()[:4]
    mixed = [baseline()[k] for k in (0, 4, 1, 5, 2, 3)]
    for some, levels in ((constant, 2), (constant[::-1], 2), (baseline(), 4), (mixed, 4)):
        asked.clear()
        assert baseline_law(given, some) is None
        assert {DEPENDENCES[name] for name in asked} == {levels}
    assert Scales.of(constant).levels == 4


@pytest.mark.slow
def test_the_given_simulator_stands_first_in_the_answer() -> None:
    case = Case("rig", Path(), lines(), records(0.04), (), baseline())
    found: Diagnosis = diagnose(case)
    assert [e.effect for e in found.effects] == ["driver_lag"]
    assert found.gap.corrected < 1.5 * found.gap.noise_floor
    assert found.baseline_law is not None
    assert [s.name for s in found.waterfall[:2]] == ["nominal", "law of the baseline"]
    assert found.gap.corrected < found.baseline_law["gap"] < found.gap.nominal
    assert found.waterfall[0].gap == pytest.approx(found.gap.nominal, rel=0.02)
    assert "identified again on the baseline" in found.sentence
    assert found.to_dict()["baseline_law"]["law"] == found.corrected.law
    # The loops' nominal row is the given simulator's too.
    forces = [lines().simulate(DT, r.channels)["force_N"] for r in case.records]
    kinds = dict.fromkeys(("measured", "nominal", "corrected"), forces)
    expected = compared([r.displacement for r in case.records], kinds)
    for own, other in zip(found.signatures, expected, strict=True):
        assert own.nominal == pytest.approx(other.nominal, rel=0.02, abs=0.02)
    shown = found.pictures["nominal"]
    assert len(shown) == len(found.pictures["measured"])


def test_a_simulator_that_reaches_the_noise_of_its_baseline_is_not_identified_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    best = identify("bouc_wen", baseline(), dependence="quadratic_saturating", starts=2, threads=1).model
    def never(*_: object) -> None:
        raise AssertionError("identified again")

    monkeypatch.setattr(damper_run, "baseline_law", never)
    monkeypatch.setattr(damper_run, "INEXACT", 1e6)
    case = Case("rig", Path(), best, records(), (), baseline())
    noise = channel_noise(case, rig(best))
    assert damper_run.law_of_baseline(case, rig(best), noise, lambda *_: None) is None
