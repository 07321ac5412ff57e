"""A first identification: known parameters from data of another code, and errors on records held out."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from mrdamp.errors import InputError
from mrdamp.identify import RecordError, error, identify, pooled
from mrdamp.model.core import Array
from mrdamp.records import Record, embedded, read_record
from mrdamp.records.motion import slowness

TRUE = {"c0a": 400.0, "c0b": 250.0, "fya": 40.0, "fyb": 300.0, "alpha_a": 60.0, "alpha_b": 400.0}


def record(name: str, law: str, amplitude: float, frequency: float, seed: int) -> Record:
    """Two seconds at 500 Hz of a law integrated by SciPy, with noise; the command steps at random."""
    rng = np.random.default_rng(seed)
    dt = 0.002
    t = dt * np.arange(1000)
    levels = rng.choice([0.0, 0.5, 1.0, 1.5], 8)
    command = np.repeat(levels, 125)
    w = 2 * math.pi * frequency
    x = amplitude * np.sin(w * t)
    v = amplitude * w * np.cos(w * t)
    if law == "bingham":
        force = (TRUE["c0a"] + TRUE["c0b"] * command) * v
        force += (TRUE["fya"] + TRUE["fyb"] * command) * np.tanh(v / 0.01)
    else:
        slope, share = 1 / 4e-4, 0.3

        def rhs(time: float, z: Array) -> Array:
            rate = amplitude * w * math.cos(w * time)
            return slope * (rate - (1 - share) * abs(rate) * z * np.abs(z) - share * rate * z * z)

        z = solve_ivp(rhs, (0, t[-1]), [0.0], t_eval=t, rtol=1e-8, atol=1e-10, max_step=dt).y[0]
        force = (TRUE["c0a"] + TRUE["c0b"] * command) * v + (TRUE["alpha_a"] + TRUE["alpha_b"] * command) * z
    force = force + rng.normal(0, 0.005 * force.std(), len(t)) + 12.0
    return Record(name, None, dt, {"displacement_m": x, "command": command, "force_N": force})


@pytest.mark.parametrize(
    ("law", "names"),
    [("bingham", ("c0a", "c0b", "fya", "fyb")), ("bouc_wen", ("c0a", "c0b", "alpha_a", "alpha_b"))],
)
def test_known_parameters_are_found(law: str, names: tuple[str, ...]) -> None:
    train = [
        record("a", law, 0.004, 2.0, 1),
        record("b", law, 0.008, 1.0, 2),
        record("c", law, 0.002, 4.0, 3),
    ]
    held = [record("d", law, 0.006, 3.0, 4)]
    fit = identify(law, train, held, starts=2)
    assert fit.held_out_nrmse < 0.02
    for name in names:
        assert fit.model.parameters[name] == pytest.approx(TRUE[name], rel=0.05, abs=5.0), name
    assert fit.model.attributes["gas_spring_f0"] == pytest.approx(12.0, abs=1.5)
    if law == "bouc_wen":
        assert fit.model.parameters["A"] == pytest.approx(1 / 4e-4, rel=0.1)
        assert fit.model.parameters["beta"] / fit.model.parameters["A"] == pytest.approx(0.3, abs=0.1)
    assert fit.model.parameters["command_max"] == 1.5


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
    r = record("a", "bingham", 0.004, 2.0, 1)
    fit = identify("bingham", [r], starts=1)
    e = error(fit.model, r)
    assert e.nrmse == pytest.approx(0.005, rel=0.5)  # the noise put in
    assert e.rmse == pytest.approx(e.nrmse * float(np.std(r.channel("force_N")[10:])), rel=1e-6)


def test_bad_input_is_told() -> None:
    r = record("a", "bingham", 0.004, 2.0, 1)
    still = r.with_channels({**r.channels, "displacement_m": np.zeros(r.n)})
    silent = Record("s", None, r.sample_time, {k: v for k, v in r.channels.items() if k != "force_N"})
    with pytest.raises(InputError, match="constant"):
        identify("bingham", [still])
    with pytest.raises(InputError, match="force_N"):
        identify("bingham", [silent])
    with pytest.raises(InputError, match="bouc_wen"):
        identify("maxwell", [r])
    with pytest.raises(InputError, match="driver_lag"):
        identify("bingham", [r], extras=("ghost",))


def test_steps_grow_with_slow_motions() -> None:
    t = np.linspace(0, 1, 10_001)
    for period, times in ((1.0, 1.0), (10.0, 1.0), (200.0, 20.0)):
        w = 2 * math.pi / period
        assert slowness([(np.sin(w * period * t), w * np.cos(w * period * t))]) == pytest.approx(times, rel=1e-3)
    # A force that depends on the path alone: the same numbers, fifty times as slow.
    fast = record("a", "bouc_wen", 0.004, 2.0, 1)
    force = fast.channel("force_N") - (TRUE["c0a"] + TRUE["c0b"] * fast.command) * fast.velocity()
    made = [Record("a", None, dt, {**fast.channels, "force_N": force}) for dt in (fast.sample_time, 0.1)]
    one, slow = (identify("bouc_wen", [r], starts=1).model.parameters for r in made)
    assert 1 / slow["A"] == pytest.approx(4e-4, rel=0.1)
    for name in ("A", "alpha_a", "alpha_b"):
        assert slow[name] == pytest.approx(one[name], rel=0.02), name


FAULT = Path(__file__).parents[2] / "shared" / "cases" / "faults" / "03_start_in_motion"


@pytest.mark.skipif(not FAULT.is_dir(), reason="shared/cases is not there")
def test_a_law_does_not_depend_on_where_its_records_were_cut() -> None:
    """Four cuts of one test of one damper, whose loops differ by .6 %."""
    first, *others = [read_record(f) for which in ("base", "new") for f in sorted((FAULT / which).glob("*.csv"))]
    fit = identify("bouc_wen", [first], others, starts=4, extras=("offset",))
    assert fit.held_out_nrmse < 1.25 * error(fit.model, first).nrmse
