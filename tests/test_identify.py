"""A first identification against data of another code, errors on records held out, and what it says besides."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares

import mrdamp
from excitation import random_steps, sine
from laboratory import TRUE, identifiable, rig_tests
from modules import CASES, needs
from mrdamp.cli import main
from mrdamp.diagnosis.form import form_with
from mrdamp.identify import Fit, error, identify
from mrdamp.identify.findings import findings
from mrdamp.identify.intervals import intervals
from mrdamp.identify.least_squares import bounded_least_squares
from mrdamp.model import Model
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


def test_steps_grow_with_slow_motions() -> None:
    t = np.linspace(0, 1, 10_001)
    for period, times in ((1.0, 1.0), (10.0, 1.0), (200.0, 20.0)):
        w = 2 * math.pi / period
        assert slowness([(np.sin(w * period * t), w * np.cos(w * period * t))]) == pytest.approx(times, rel=1e-3)
    # A force that depends on the path alone: the same numbers, fifty times as slow.
    p, (fast,) = TRUE["bouc_wen"], rig_tests("bouc_wen", duration=2.0, chosen=(1,))
    force = fast.channel("force_N") - (p["c0a"] + p["c0b"] * fast.command) * fast.velocity()
    channels = {**fast.channels, "force_N": force}
    del channels["time_s"]
    made = [Record("a", None, dt, channels) for dt in (fast.sample_time, 0.05)]
    one, slow = (identify("bouc_wen", [r], starts=1).model.parameters for r in made)
    assert slow["A"] == pytest.approx(p["A"], rel=0.1)
    for name in ("A", "alpha_a"):
        assert slow[name] == pytest.approx(one[name], rel=0.02), name


@needs(CASES)
def test_a_law_does_not_depend_on_where_its_records_were_cut() -> None:
    """Four cuts of one test of one damper, whose loops differ by .6 %."""
    folder = CASES / "faults" / "03_start_in_motion"
    first, *others = [read_record(f) for which in ("base", "new") for f in sorted((folder / which).glob("*.csv"))]
    fit = identify("bouc_wen", [first], others, starts=4, extras=("offset",))
    assert fit.held_out_nrmse < 1.25 * error(fit.model, first).nrmse


#: What the records determine well: the rest is weak in them, or trades against it.
SURE: Mapping[str, tuple[str, ...]] = {
    "bingham": ("c0a", "c0b", "fya", "fyb", "v_ref"),
    "bouc_wen": ("c0a", "c0b", "alpha_a", "alpha_b", "A", "k0"),
    "modified_bouc_wen": ("c0a", "c0b", "alpha_a", "alpha_b", "k1"),
    "hyperbolic_tangent": ("c0a", "c0b", "f0a", "f0b", "k1a", "k0a", "v_ref"),
}


@pytest.mark.parametrize("factor", [pytest.param(0.6, marks=pytest.mark.slow), 1.4])
@pytest.mark.parametrize("law", SURE)
def test_a_start_forty_percent_off_arrives(law: str, factor: float) -> None:
    true = identifiable(law)
    start = {name: value if name in ("n", "x0") else factor * value for name, value in true.items()}
    if "n" in true:
        start["n"] = 1.0 + factor * (true["n"] - 1.0)
    records = rig_tests(law, noise=0.005, dt=0.002)
    held = [records.pop(4)]
    fit = identify(law, records, held, extras=(), start=start, starts=1)
    assert fit.held_out_nrmse < 0.01
    for name in SURE[law]:
        assert fit.model.parameters[name] == pytest.approx(true[name], rel=0.1), name


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


DT = 1e-3


def said(train: Sequence[Record], held_out: Sequence[Record] = (), **options: object) -> tuple[Fit, str]:
    fit = identify("bouc_wen", train, held_out, starts=1, **options)  # type: ignore[arg-type]
    return fit, "\n".join(findings(fit, train, held_out))


def varying(lag: float, delay: float = 0.0) -> list[Record]:
    """A command that jumps while the rod moves, with a lag of the driver and a delay of the command (s)."""
    out = []
    for k, (amplitude, frequency) in enumerate(((0.006, 2.0), (0.012, 1.0))):
        t: Array = np.asarray(DT * np.arange(4001), dtype=np.float64)
        rng = np.random.default_rng(k)
        command = random_steps(0.0, 1.0, 0.237, 17, seed=k)
        p = TRUE["bouc_wen"] | {"driver_lag_tau": lag, "command_delay_d": delay}
        motion = sine(amplitude, frequency)
        force = simulate("bouc_wen", p, motion, t, command)["force"]
        force += 0.01 * np.std(force) * rng.standard_normal(len(t))
        channels = {"displacement_m": motion.sample(t)[0], "command": command.sample(t), "force_N": force}
        out.append(Record(f"jumps_{k}", None, DT, channels))
    return out


def test_a_current_of_both_signs_acts_by_its_size() -> None:
    signs = np.random.default_rng(5).choice([-1.0, 1.0], 3)
    records = enumerate(rig_tests("bouc_wen"))
    train = [r.with_channels({"command": signs[k % 3] * r.command}) for k, r in records]
    fit, lines = said(train)
    assert fit.train_nrmse == pytest.approx(0.01, rel=0.1)
    assert fit.model.parameters["alpha_b"] == pytest.approx(TRUE["bouc_wen"]["alpha_b"], rel=0.02)
    assert lines == ""


def test_a_delay_that_was_fitted_as_a_lag_is_told_and_parted() -> None:
    train = varying(0.008, 0.004)
    assert "a delay of the command of about" in said(train, extras=("offset", "driver_lag"))[1]
    fit, lines = said(train, extras=("offset", "driver_lag", "command_delay"))
    assert "delay of the command" not in lines
    assert fit.model.attributes["driver_lag_tau"] == pytest.approx(0.008, rel=0.02)
    assert fit.model.attributes["command_delay_d"] == pytest.approx(0.004, rel=0.02)


@pytest.mark.parametrize(("samples", "told"), [(5, False), (40, True)])
def test_a_value_at_its_limit_is_told(samples: int, told: bool) -> None:
    train = [
        r.with_channels({"force_N": np.roll(r.channel("force_N"), samples)}).part(0.1, 3.9)
        for r in rig_tests("bouc_wen", chosen=(0, 4, 8))
    ]
    fit, lines = said(train, extras=("channel_shift",))
    assert ("channel_shift_d is at the end of its range" in lines) is told
    if not told:
        assert fit.model.attributes["channel_shift_d"] == pytest.approx(-0.001 * samples, abs=2e-4)


def test_one_command_alone_is_told_and_kept() -> None:
    train = rig_tests("bouc_wen", chosen=(1, 4, 7))
    fit, lines = said(train)
    assert "one command, 0.5" in lines
    assert "c0b" not in {row.name for row in intervals(fit, train)}
    # At another command it predicts what it knows: the force at .5 A.
    inputs = {name: train[0].channel(name) for name in ("displacement_m", "command")}
    known, other = (
        fit.model.simulate(DT, inputs | {"command": np.full(train[0].n, u)})["force_N"] for u in (0.5, 1.0)
    )
    np.testing.assert_array_equal(known, other)


def test_a_held_out_command_beyond_the_fitted_ones_is_told() -> None:
    records = rig_tests("bouc_wen")
    lines = said(records[::3] + records[1::3], records[2::3])[1]
    told = "its command runs from 1 to 1, the model holds for 0 to 0.5: 100 % of the samples are clamped"
    assert told in lines


@pytest.mark.slow
def test_long_records_are_fitted_with_all_of_their_motion() -> None:
    # 11 records at 5 kHz, as a data logger writes them.
    train = rig_tests("bouc_wen", dt=2e-4, duration=3.0)
    train += [
        replace(r, name=f"{r.name} again") for r in rig_tests("bouc_wen", dt=2e-4, duration=3.0, seed=1)[:2]
    ]
    fit, _ = said(train)
    p = fit.model.parameters
    assert fit.train_nrmse == pytest.approx(0.01, rel=0.1)
    for name in ("beta", "k0", "c0a"):  # 800, 500, 650
        assert p[name] == pytest.approx(TRUE["bouc_wen"][name], rel=0.05), name


def _bingham(frequency: float, preload: float) -> Record:
    """8 N tanh(v / 5 mm/s) + 30 N s/m v + a preload (N) in a sine of 10 mm."""
    t = DT * np.arange(3001)
    turn = 2 * np.pi * frequency
    v = 0.01 * turn * np.cos(turn * t)
    channels = {"displacement_m": 0.01 * np.sin(turn * t), "command": 0 * t, "velocity_m_s": v}
    return Record(f"sine_{frequency}", None, DT, channels | {"force_N": 8 * np.tanh(v / 0.005) + 30 * v + preload})


def test_a_preload_of_many_times_the_loop_is_fitted() -> None:
    records = [_bingham(1.0, 360.0), _bingham(2.0, 360.0)]
    fit = identify("bingham", records, (), extras=["offset"], starts=2)
    assert fit.model.attributes["gas_spring_f0"] == pytest.approx(360, abs=0.05)
    assert fit.train_nrmse < 0.01


def test_any_effect_is_fitted_along_by_its_name(tmp_path: Path) -> None:
    """12 kg beyond the damper, added to the force of SciPy's integrator."""
    for part in ("train", "validation"):
        (tmp_path / part).mkdir()
    for k, r in enumerate(rig_tests("bingham", duration=2.0)):
        force = r.channel("force_N") + 12 * np.gradient(r.velocity(), r.sample_time)
        r.with_channels({"force_N": force}).save(tmp_path / ("validation" if k == 4 else "train") / f"{r.name}.csv")
    fit = mrdamp.identify(tmp_path, "bingham", extras=["moving_mass"], starts=1)
    assert [e.name for e in fit.model.effects] == ["moving_mass"]
    assert fit.model.attributes["moving_mass_m"] == pytest.approx(12, rel=0.05)
    assert fit.held_out_nrmse < 0.02
    refuses(lambda: mrdamp.identify(tmp_path, "bingham", extras=["ghost"]), "allowed: auto, offset, .*, seal_friction")
    refuses(lambda: mrdamp.identify(tmp_path, "bingham", extras=["auto", "backlash"]), "finds the effects itself")


def test_a_law_gives_back_what_it_took_of_an_effect() -> None:
    """60 N of seal friction, added to the force of SciPy's integrator: a hysteresis stands in for most of it."""
    records = [
        r.with_channels({"force_N": r.channel("force_N") + 60 * np.tanh(r.velocity() / 0.002)})
        for r in rig_tests("bouc_wen", duration=2.0)
    ]
    alone = identify("bouc_wen", records, extras=("offset",), starts=1)
    found = form_with(alone, records, ["seal_friction"]).model.attributes
    assert found["seal_friction_coulomb"] == pytest.approx(60, rel=0.03)
    assert found["n"] == pytest.approx(TRUE["bouc_wen"]["n"], rel=0.03)


@pytest.mark.slow
@pytest.mark.parametrize("lag", [0.0, 0.012])
def test_the_effects_that_the_records_pay_for_are_fitted_along(
    lag: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Records of SciPy's integrator with and without a lag of the driver."""
    files = []
    for record in (*varying(lag), *rig_tests("bouc_wen")[:3]):
        record.save(tmp_path / f"{record.name}.csv")
        files.append(str(tmp_path / f"{record.name}.csv"))
    out = tmp_path / "model.json"
    assert main(["identify", *files, "--law", "bouc_wen", "--starts", "2", "--extras", "auto", "-o", str(out)]) == 0
    told = capsys.readouterr().out
    if not lag:
        assert "no effect of the catalogue pays for itself" in told
        return
    assert "fitted along: driver_lag (probability" in told
    assert Model.read(out).attributes["driver_lag_tau"] == pytest.approx(lag, rel=0.03)
    assert main(["identify", *files, "--law", "bouc_wen", "--extras", "auto", "--intervals", "-o", str(out)]) == 2


def test_noise_of_the_displacement_in_a_prediction_is_that_of_central_differences(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A dashpot c turns noise s of positions dt apart into c s / (sqrt(2) dt)."""
    dt, c, s = 1e-4, 2000.0, 5e-6
    t = dt * np.arange(20001)
    x = 0.01 * np.sin(2 * np.pi * 2 * t) + s * np.random.default_rng(1).standard_normal(len(t))
    dashpot = {"c0a": c, "c0b": 0.0, "fya": 0.0, "fyb": 0.0, "v_ref": 0.01}
    Model("bingham", dashpot).write(tmp_path / "model.json")
    table = np.column_stack([t, x, 0 * t])
    np.savetxt(tmp_path / "record.csv", table, delimiter=",", header="time_s,displacement_m,command", comments="")
    main(["predict", str(tmp_path / "model.json"), str(tmp_path / "record.csv"), "-o", str(tmp_path / "p.csv")])
    found = re.search(r"displacement, ([\d.]+) um, are ([\d.e+]+) N", capsys.readouterr().err)
    assert found is not None
    assert float(found[1]) == pytest.approx(1e6 * s, rel=0.1)
    assert float(found[2]) == pytest.approx(c * s / (np.sqrt(2) * dt), rel=0.1)
