"""A first identification: known parameters from data of another code, and errors on records held out."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares
from threadpoolctl import threadpool_info  # type: ignore[import-untyped]

from excitation import from_rest, multisine, wave
from laboratory import TRUE, rig_tests
from mrdamp.identify import RecordError, error, identify, pooled
from mrdamp.identify.least_squares import bounded_least_squares
from mrdamp.model.core import Array
from mrdamp.records import Record, embedded, read_record
from mrdamp.records.motion import slowness
from refusals import refuses
from twins import simulate


def test_embedded_records_and_the_same_answer_for_any_threads() -> None:
    records = embedded()
    train = [r.part(0.0, min(3.0, r.duration)) for r in records.train[:5]]
    held = list(records.validation[:3])
    extras = ("offset", "driver_lag", "saturation")
    fits = [identify("bouc_wen", train, held, extras=extras, starts=1, threads=n) for n in (1, 2)]
    assert fits[0] == fits[1]
    plain = identify("bingham", train, held, starts=1)
    assert fits[0].held_out_nrmse < 0.3
    # A law without hysteresis, lag and saturation must be worse on these.
    assert plain.held_out_nrmse > 1.3 * fits[0].held_out_nrmse


def test_errors_are_pooled_by_their_squares() -> None:
    errors = (RecordError("a", 3.0, 0.3), RecordError("b", 4.0, 0.1))
    assert pooled(errors) == pytest.approx(math.sqrt((9 + 16) / (100 + 1600)))


def test_the_error_is_that_of_the_free_run() -> None:
    """What is left of SciPy's records are the noise put in."""
    train = rig_tests("bingham", chosen=(0, 4, 8))
    fit = identify("bingham", train, starts=1)
    e = error(fit.model, train[1])
    assert e.nrmse == pytest.approx(0.01, rel=0.1)
    assert e.rmse == pytest.approx(e.nrmse * float(np.std(train[1].channel("force_N")[20:])), rel=1e-6)


def test_bad_input_is_told() -> None:
    (r,) = rig_tests("bingham", chosen=(4,))
    still = r.with_channels({**r.channels, "displacement_m": np.zeros(r.n)})
    silent = Record("s", None, r.sample_time, {k: v for k, v in r.channels.items() if k != "force_N"})
    refuses(lambda: identify("bingham", [still]), "constant")
    refuses(lambda: identify("bingham", [silent]), "force_N")
    refuses(lambda: identify("maxwell", [r]), "bouc_wen")
    refuses(lambda: identify("bingham", [r], extras=("ghost",)), "driver_lag")


def test_steps_grow_with_slow_motions() -> None:
    t = np.linspace(0, 1, 10_001)
    for period, times in ((1.0, 1.0), (10.0, 1.0), (200.0, 20.0)):
        w = 2 * math.pi / period
        assert slowness([(np.sin(w * period * t), w * np.cos(w * period * t))]) == pytest.approx(times, rel=1e-3)
    # A force that depends on the path alone: the same numbers, fifty times as slow.
    p, (fast,) = TRUE["bouc_wen"], rig_tests("bouc_wen", duration=2.0, chosen=(1,))
    force = fast.channel("force_N") - (p["c0a"] + p["c0b"] * fast.command) * fast.velocity()
    made = [Record("a", None, dt, {**fast.channels, "force_N": force}) for dt in (fast.sample_time, 0.05)]
    one, slow = (identify("bouc_wen", [r], starts=1).model.parameters for r in made)
    assert slow["A"] == pytest.approx(p["A"], rel=0.1)
    for name in ("A", "alpha_a"):
        assert slow[name] == pytest.approx(one[name], rel=0.02), name


FAULT = Path(__file__).parents[2] / "shared" / "cases" / "faults" / "03_start_in_motion"


@pytest.mark.skipif(not FAULT.is_dir(), reason="shared/cases is not there")
def test_a_law_does_not_depend_on_where_its_records_were_cut() -> None:
    """Four cuts of one test of one damper, whose loops differ by .6 %."""
    first, *others = [read_record(f) for which in ("base", "new") for f in sorted((FAULT / which).glob("*.csv"))]
    fit = identify("bouc_wen", [first], others, starts=4, extras=("offset",))
    assert fit.held_out_nrmse < 1.25 * error(fit.model, first).nrmse


# --- a fit that starts 40 % off: records of SciPy ------------------------------------------------------

# z ends at 1 (A = beta + gamma), as the search has it.
AIMED: Mapping[str, Mapping[str, float]] = {
    "bingham": {"c0a": 400.0, "c0b": 250.0, "fya": 40.0, "fyb": 300.0, "v_ref": 0.01},
    "bouc_wen": {"c0a": 500.0, "c0b": 400.0, "alpha_a": 60.0, "alpha_b": 500.0, "gamma": 900.0, "beta": 600.0}
    | {"A": 1500.0, "n": 1.5, "k0": 4000.0, "x0": 0.0},
    "modified_bouc_wen": {"c0a": 400.0, "c0b": 500.0, "c1a": 5e3, "c1b": 2e4, "alpha_a": 60.0, "alpha_b": 500.0}
    | {"gamma": 900.0, "beta": 600.0, "A": 1500.0, "n": 1.5, "k0": 1500.0, "k1": 2000.0, "x0": 0.0},
    "hyperbolic_tangent": {"k1a": 1.5e5, "k1b": 1e5, "k0a": 4000.0, "k0b": 0.0, "c0a": 400.0, "c0b": 300.0}
    | {"c1a": 400.0, "c1b": 200.0, "m0": 0.5, "f0a": 60.0, "f0b": 500.0, "v_ref": 0.006},
}
#: What the records determine well: the rest is weak in them, or trades against it.
SURE: Mapping[str, tuple[str, ...]] = {
    "bingham": ("c0a", "c0b", "fya", "fyb", "v_ref"),
    "bouc_wen": ("c0a", "c0b", "alpha_a", "alpha_b", "A", "k0"),
    "modified_bouc_wen": ("c0a", "c0b", "alpha_a", "alpha_b", "k1"),
    "hyperbolic_tangent": ("c0a", "c0b", "f0a", "f0b", "k1a", "k0a", "v_ref"),
}


@cache
def multisines(law: str) -> tuple[Record, ...]:
    """Three records of 2 s at 500 Hz, noise of 0.5 %, of a motion from rest."""
    out = []
    for seed in range(3):
        t = 0.002 * np.arange(1000, dtype=np.float64)
        motion, command = from_rest(multisine(0.004, 0.5, 5.0, seed=seed), 0.3), wave(0.0, 1.0, 0.7 + 0.2 * seed)
        force = simulate(law, AIMED[law], motion, t, command, rtol=1e-6)["force"]
        force = force + np.random.default_rng(seed).normal(0.0, 0.005 * float(force.std()), len(t))
        x, v, _ = motion.sample(t)
        channels = {"displacement_m": x, "velocity_m_s": v, "command": command.sample(t), "force_N": force}
        out.append(Record(f"{law}_{seed}", None, 0.002, channels))
    return tuple(out)


@pytest.mark.parametrize("factor", [0.6, 1.4])
@pytest.mark.parametrize("law", AIMED)
def test_a_start_forty_percent_off_arrives(law: str, factor: float) -> None:
    true = AIMED[law]
    start = {name: value if name in ("n", "x0") else factor * value for name, value in true.items()}
    if "n" in true:
        start["n"] = 1.0 + factor * (true["n"] - 1.0)
    train, held = multisines(law)[:2], multisines(law)[2:]
    fit = identify(law, train, held, extras=(), start=start, starts=1)
    assert fit.held_out_nrmse < 0.01
    for name in SURE[law]:
        assert fit.model.parameters[name] == pytest.approx(true[name], rel=0.1), name


# --- least squares that run no simulation twice -----------------------------------------------------------

TIME = np.linspace(0.0, 3.0, 400)
MEASURED = 0.8 * np.exp(-1.3 * TIME) * np.cos(7 * TIME) + 0.02 * np.sin(50 * TIME)


def residual(p: Array) -> Array:
    return np.asarray(p[0] * np.exp(-2 * p[1] * TIME) * np.cos(10 * p[2] * TIME) - MEASURED)


def jacobian(p: Array, r: Array) -> Array:
    wave, decay = np.cos(10 * p[2] * TIME), np.exp(-2 * p[1] * TIME)
    turned = -10 * TIME * p[0] * decay * np.sin(10 * p[2] * TIME)
    return np.column_stack([decay * wave, -2 * TIME * (r + MEASURED), turned])


@pytest.mark.parametrize("start", [(0.5, 0.4, 0.62), (0.95, 0.9, 0.75), (0.2, 0.05, 0.68)])
def test_steps_are_those_of_scipy(start: tuple[float, float, float]) -> None:
    whole = least_squares(residual, start, lambda p: jacobian(p, residual(p)), bounds=(0, 1), max_nfev=7)
    found = bounded_least_squares(
        residual, jacobian, np.array(start), bounds=(0, 1), most=7, ftol=1e-8, xtol=1e-8
    )
    assert found.x == pytest.approx(whole.x, abs=1e-12)
    assert (found.nfev, found.status) == (whole.nfev, whole.status)


def test_no_residual_is_computed_twice_and_blas_keeps_to_a_thread() -> None:
    seen: list[bytes] = []
    threads: set[int] = set()

    def counted(p: Array) -> Array:
        seen.append(p.tobytes())
        threads.update(pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas")
        return residual(p)

    found = bounded_least_squares(
        counted, jacobian, np.array([0.5, 0.4, 0.62]), bounds=(0, 1), most=20, ftol=1e-8, xtol=1e-8
    )
    assert found.success
    assert len(seen) == len(set(seen)) == found.nfev
    assert threads <= {1}
